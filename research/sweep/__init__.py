"""One training for every level, size and seed: `python -m research.sweep`."""
