"""What makes the difference between PPO by the text of the paper and PPO by its code? README.md has the design."""
