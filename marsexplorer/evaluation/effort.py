"""The effort check: an episode that explores no better than random moves would.

The measure is the mean number of cells known after each of an episode's moves. It rewards discovering early, so somebody who
has found nearly everything and then searches in vain for the last cells is far from random moves, which a count at the end
could not tell from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import OBSTACLE, RUNNING, EnvConfig, fewest_cells
from marsexplorer.observation import DISPLACEMENTS
from marsexplorer.rules import CELLS, DISCOVERED
from marsexplorer.world import Worlds, positions

SHORTEST = 1 / 8
"""Episodes of a smaller share of the limit's moves say nothing about effort."""
QUANTILE = 0.99
"""No more than this share of random episodes on the same configuration stays at or below the bound."""

EPISODES = 300
"""Of random valid moves, that an effort is measured from."""
FIRST_SEED = 9 * 10**12
"""Of the terrains: those of no study, of no training and of no evaluation."""
MOST_MOVES = 4096
"""Random episodes are followed for so many moves at most; longer ones are compared with these."""


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


@lru_cache(maxsize=8)
def random_mean_known(config: EnvConfig, quantile: float) -> NDArray[np.float64]:
    """Return float64[moves + 1]: below what a mean of cells known after 1..t moves stays in `quantile` of episodes.

    The quantile (0..1) is one over EPISODES episodes of random valid moves, each on a terrain of its own; the same each time.
    An episode that has ended keeps what it had. Entry 0 is 0.
    """
    moves = min(config.limit, MOST_MOVES)
    known = random_discoveries(config, moves)
    means = np.cumsum(known, axis=1) / np.arange(1, moves + 1)
    return np.concatenate([[0.0], np.quantile(means, quantile, axis=0)])


def random_discoveries(config: EnvConfig, moves: int) -> NDArray[np.float64]:
    """Return float64[EPISODES, moves], the cells known after 1, 2, ... random valid moves.

    Where only what can be discovered counts, its share of that is what n cells are multiplied by.
    """
    rng, worlds = np.random.default_rng(0), Worlds(config, EPISODES)
    worlds.start(np.arange(FIRST_SEED, FIRST_SEED + EPISODES))
    known = np.zeros((EPISODES, moves), np.int64)
    for move in range(moves):
        worlds.step(_random_valid(config, worlds, rng))
        known[:, move] = worlds.scalars[:, DISCOVERED]
        if not (worlds.outcomes == RUNNING).any():
            known[:, move:] = known[:, move : move + 1]
            break
    return known * (config.n / worlds.scalars[:, CELLS, None].astype(np.float64))


def _random_valid(config: EnvConfig, worlds: Worlds, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return int64[EPISODES], an action drawn from each rover's valid ones."""
    cells = positions(worlds.scalars)[:, None] + np.array(DISPLACEMENTS)
    limits = np.array([config.rows, config.cols])
    inside = ((cells >= 0) & (cells < limits)).all(2)
    row, col = np.clip(cells, 0, limits - 1).transpose(2, 0, 1)
    valid = inside & (worlds.codes[np.arange(worlds.num)[:, None], row, col] != OBSTACLE)
    chosen: NDArray[np.int64] = (rng.random(valid.shape) * valid).argmax(1)
    return chosen
