"""How many moves knowing the map would save: a long search on the true map, as a bound for policies.

`python -m research.informed` compares policies with it.
"""
