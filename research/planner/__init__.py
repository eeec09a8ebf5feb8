"""How many moves does following imagined tours save? `python -m research.planner`."""
