"""The moves that looking ahead saves: `python -m research.lookahead`."""
