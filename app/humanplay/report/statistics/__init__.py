"""The statistics of studies and of the playground's volunteers.

There are intervals, comparisons with policies, learning and sample sizes. Every function works on
tables of one metric by player, so that report, leaderboard and operator print the same numbers.
`python -m research.coverage` measures how often the printed intervals cover the truth.
"""
