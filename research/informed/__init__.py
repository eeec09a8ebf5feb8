"""How many moves knowing the map would save: a long search on the true map, as a bound for policies.

`python -m research.informed` compares policies with it.
"""

from research.informed.informed import (
    INFORMED,
    AnnealingConfig,
    KnownTerrain,
    check_size,
    informed_actions,
    informed_paths,
    search,
)

__all__ = [
    "INFORMED",
    "AnnealingConfig",
    "KnownTerrain",
    "check_size",
    "informed_actions",
    "informed_paths",
    "search",
]
