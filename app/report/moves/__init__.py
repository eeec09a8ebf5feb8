"""What single moves say of players: the regret of each move, and how much a policy moves like people.

`analysis` has the regret for a study's report, and the `_validation` and `_rates` modules measure what it is worth.
"""
