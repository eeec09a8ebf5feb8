"""What random valid moves discover on terrains of a configuration: the floor that an effort is measured from."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import OBSTACLE, RUNNING, EnvConfig
from marsexplorer.observation import DISPLACEMENTS
from marsexplorer.rules import CELLS, DISCOVERED
from marsexplorer.world import Worlds, positions

EPISODES = 300
FIRST_SEED = 9 * 10**12
"""Of the terrains: those of no study, of no training and of no evaluation."""
MOST_MOVES = 4096
"""Random episodes are followed for so many moves at most; longer ones are compared with these."""


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
