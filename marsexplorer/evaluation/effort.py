"""The effort check: an episode that explores no better than random moves would.

The measure is the mean number of cells known after each of an episode's moves. It rewards
discovering early. So somebody who found nearly everything and then searches in vain for the last
cells is far from random moves, which a count at the end could not show.
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
"""Episodes of a smaller share of the limit's moves are not judged."""
QUANTILE = 0.99
"""No more than this share of random episodes on the same configuration stays at or below the
bound.
"""

EPISODES = 300
"""Of random valid moves, that an effort is measured from."""
FIRST_SEED = 9 * 10**12
"""Of the terrains: those of no study, of no training and of no evaluation."""
MOST_MOVES = 4096
"""The most moves of a random episode; longer episodes are compared with these."""


def makes_no_effort(config: EnvConfig, discovered: Sequence[int], cells: int | None = None) -> bool:
    """Whether an episode explored no better than nearly all random ones.

    It did if it knew, in the mean over its moves, at most the QUANTILE of random episodes. An
    explored episode keeps what it had to the limit, as the random ones do; others are judged over
    the moves they made. One that was explored within half the limit is an effort on any board: on
    small ones a random walk is soon done as well.

    Args:
        config: The configuration of the episode.
        discovered: Cells known after 1, 2, ... moves.
        cells: Cells that count on the terrain, if only those that can be discovered do; None: all.
            What is known is compared by its share of them.
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
    """The quantile of the mean of cells known after 1..t moves of random episodes.

    float64[moves + 1]; entry 0 is 0. The quantile (0..1) is one over EPISODES episodes of random
    valid moves, each on a terrain of its own; the same each time. An episode that has ended keeps
    what it had.
    """
    moves = min(config.limit, MOST_MOVES)
    discoveries = random_discoveries(config, moves)
    means = np.cumsum(discoveries, axis=1) / np.arange(1, moves + 1)
    return np.concatenate([[0.0], np.quantile(means, quantile, axis=0)])


def random_discoveries(config: EnvConfig, moves: int) -> NDArray[np.float64]:
    """The cells known after 1, 2, ... random valid moves, float64[EPISODES, moves].

    If only what can be discovered counts, its share is multiplied by n cells.
    """
    rng, worlds = np.random.default_rng(0), Worlds(config, EPISODES)
    worlds.start(np.arange(FIRST_SEED, FIRST_SEED + EPISODES))
    known_cells = np.zeros((EPISODES, moves), np.int64)
    for move in range(moves):
        worlds.step(_random_valid(config, worlds, rng))
        known_cells[:, move] = worlds.scalars[:, DISCOVERED]
        if not (worlds.outcomes == RUNNING).any():
            known_cells[:, move:] = known_cells[:, move : move + 1]
            break
    return known_cells * (config.n / worlds.scalars[:, CELLS, None].astype(np.float64))


def _random_valid(config: EnvConfig, worlds: Worlds, rng: np.random.Generator) -> NDArray[np.int64]:
    """An action drawn from each rover's valid ones: int64[EPISODES]."""
    cells = positions(worlds.scalars)[:, None] + np.array(DISPLACEMENTS)
    limits = np.array([config.rows, config.cols])
    inside = ((cells >= 0) & (cells < limits)).all(2)
    row, col = np.clip(cells, 0, limits - 1).transpose(2, 0, 1)
    valid = inside & (worlds.codes[np.arange(worlds.num)[:, None], row, col] != OBSTACLE)
    chosen: NDArray[np.int64] = (rng.random(valid.shape) * valid).argmax(1)
    return chosen
