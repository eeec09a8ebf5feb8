"""Training: PPO from nothing, its recipes, its logbook."""
