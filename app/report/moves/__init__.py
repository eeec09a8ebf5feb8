"""What single moves say of players: the regret of each move, and how much somebody moves like a policy.

`analysis` has both for a study's report, and the `_validation` and `_rates` modules measure what they are worth.
"""
