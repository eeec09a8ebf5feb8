"""Rules from elsewhere beside ours: `python -m research.baselines`."""
