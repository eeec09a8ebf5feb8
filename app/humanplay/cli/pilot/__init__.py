"""A pilot: people play an environment of a program or a notebook, and are scored.

Their plays are recorded and replayed like those of a server; how often they play is theirs to choose, which a study's
protocol fixes.
"""
