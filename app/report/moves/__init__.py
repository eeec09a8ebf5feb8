"""What single moves say of players: the regret of each.

`analysis` has the regret for a study's report, and the `_validation` and `_rates` modules measure what it is worth.
"""
