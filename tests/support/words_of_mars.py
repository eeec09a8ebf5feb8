"""Words of MarsExplorer's world, which no other environment's output says."""

import re

MARS = re.compile(
    r"\b(Mars\w*|rovers?|terrains?|lidar|driv(es?|ing|en)|drove|collid\w+|collisions?|discover\w*|explor\w+|"
    r"mapped|Koutras)\b",
    re.IGNORECASE,
)
PRODUCT = re.compile(r"MarsExplorer Playground|exploratory")
"""What the software is called, and what statistics calls a figure that was not planned."""


def words_of_mars(text):
    """The lines of a text that speak of MarsExplorer's world."""
    return [line for line in PRODUCT.sub("", text).splitlines() if MARS.search(line)]
