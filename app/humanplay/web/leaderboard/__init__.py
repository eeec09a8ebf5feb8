"""The leaderboard: people, policies and rules of thumb on one scale, for each configuration and each closed study.

People's figures come from the database. Policies are evaluated in a process of low priority, and their figures are kept.
"""
