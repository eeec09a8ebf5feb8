"""The algorithms under way: PPO by our own trainer, A2C, Rainbow and discrete SAC through tianshou, and their settings."""
