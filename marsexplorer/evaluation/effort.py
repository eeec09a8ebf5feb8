"""The effort check: an episode that explores no better than random moves would.

The measure is the mean number of cells known after each of an episode's moves. It rewards discovering early, so somebody who
has found nearly everything and then searches in vain for the last cells is far from random moves, which a count at the end
could not tell from them.
"""

from __future__ import annotations

from collections.abc import Sequence

from marsexplorer.config import EnvConfig, fewest_cells
from marsexplorer.evaluation.random_reference import random_mean_known

SHORTEST = 1 / 8
"""Episodes of a smaller share of the limit's moves say nothing about effort."""
QUANTILE = 0.99
"""No more than this share of random episodes on the same configuration stays at or below the bound."""


def makes_no_effort(config: EnvConfig, discovered: Sequence[int], cells: int | None = None) -> bool:
    """Return whether an episode knew, in the mean over its moves, no more cells than random moves do in QUANTILE of episodes.

    An explored episode keeps what it had to the limit, as the random ones do; others are judged over the moves they made. One
    that was explored within half the limit is an effort on any board: on small ones a random walk is soon done as well.

    discovered  cells known after 1, 2, ... moves
    cells       that count on the terrain, where only those that can be discovered do; None: all. What is known on terrains that
                have more of them, and less, is compared by its share.
    """
    moves, counted = len(discovered), config.n if cells is None else cells
    is_explored = moves > 0 and discovered[-1] >= fewest_cells(counted, config.beta)
    if moves < SHORTEST * config.limit or (is_explored and moves <= config.limit // 2):
        return False
    bounds, total = random_mean_known(config, QUANTILE), sum(discovered)
    if is_explored:
        rest = max(0, len(bounds) - 1 - moves)
        moves, total = moves + rest, total + rest * discovered[-1]
    return bool(total * (config.n / counted) / moves <= bounds[min(moves, len(bounds) - 1)])
