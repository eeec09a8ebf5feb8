"""The algorithms and their settings: our PPO, and three through tianshou."""
