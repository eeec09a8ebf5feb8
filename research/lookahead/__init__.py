"""What looking ahead saves: `lookahead` beside `ppo` on the same terrains: `python -m research.lookahead`."""
