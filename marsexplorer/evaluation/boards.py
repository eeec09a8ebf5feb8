"""The boards of real episodes, to try policies on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies.base import RandomPolicy

MOVES = 200
"""Boards that a policy file is tried on."""


def observations(
    size: tuple[int, int], count: int = MOVES
) -> Iterator[tuple[NDArray[np.uint8], bool]]:
    """Yield the codes of real episodes at random moves, and whether one begins."""
    walker, seed = RandomPolicy(), 0
    config = EnvConfig.of("random", size, max_steps=60)
    episode = Episode.begin(config, seed=seed)
    is_start = True
    for _ in range(count):
        yield episode.codes.copy(), is_start
        episode.step(walker.act(episode.codes))
        is_start = episode.ended
        if episode.ended:
            seed += 1
            walker.reset(seed)
            episode = Episode.begin(config, seed=seed)
