"""What makes PPO by the text of the paper differ from PPO by its code?

README.md has the design.
"""
