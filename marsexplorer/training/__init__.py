"""Training: PPO from a warm start."""
