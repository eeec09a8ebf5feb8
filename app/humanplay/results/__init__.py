"""What brings people back: the daily terrain and the leaderboard.

The leaderboard shows people, policies and rules on one scale, for each configuration and each closed study. People's
figures come from the database. Policies are evaluated in a process of low priority, and their figures are kept.
"""
