"""How many moves knowing the map would save: a search on the true map.

`python -m research.informed` compares policies with it.
"""
