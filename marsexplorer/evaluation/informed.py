"""A long search that is shown the true map: the yardstick for what is left to gain. Never a policy.

It looks for the shortest walk from the start that discovers the target. The length of what it finds is an upper bound of the
optimum. It knows where the obstacles lie before it sees them, so no policy can be expected to reach it; a policy's ratio to
it says how much hindsight would save.

The tour is improved by simulated annealing (Kirkpatrick, Gelatt and Vecchi 1983) of length + DEAR x (cells short of the
target). A change moves a viewpoint by up to three cells, takes one out, puts one in where it costs least (mostly in sight of
a cell not yet seen), breaks ties on its way otherwise, turns a stretch round (2-opt), carries one elsewhere (or-opt), or
swaps two. The budget is a number of changes and the draws follow from the seed, so a terrain has one answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import FREE, OBSTACLE, UNKNOWN, EnvConfig
from marsexplorer.evaluation.tours import FAR16, anneal, sights, survey, walk
from marsexplorer.policies.kernels.visibility import VisibilityMap
from marsexplorer.random_numbers import mix

MAX_CELLS = 128 * 128
"""Distances between all pairs of cells are held: half a gigabyte for so many."""


@dataclass(frozen=True)
class Search:
    """How long and how boldly to look; the defaults are those of the published yardstick.

    changes     tried in one annealing
    runs        annealings, each from nothing; the shortest walk counts
    warm, cold  temperatures of the first and the last change (moves)
    """

    changes: int = 300_000
    runs: int = 2
    warm: float = 3.0
    cold: float = 0.12


def check_size(config: EnvConfig) -> None:
    """Return when the grid is small enough for the search; ValueError otherwise."""
    if config.n > MAX_CELLS:
        raise ValueError(f"the informed planner takes grids of up to {MAX_CELLS} cells, got {config.rows}x{config.cols}")


class Ground:
    """A terrain wholly known: who is next to whom, how far it is, and what is seen from where (see `tours`)."""

    def __init__(self, config: EnvConfig, terrain: NDArray[np.bool_]) -> None:
        check_size(config)
        n, self.words = config.n, (config.n + 63) // 64
        self.near = np.zeros((n, 4), np.int32)
        self.distance = np.zeros((n, n), np.uint16)
        survey(terrain, self.near, self.distance, np.zeros(n, np.int32))
        self.free = np.flatnonzero(self.distance[0] != FAR16).astype(np.int32)
        known, unknown = (VisibilityMap(terrain.shape, config.sensor_radius) for _ in range(2))
        known.fill(np.where(terrain, np.uint8(OBSTACLE), np.uint8(FREE)))
        unknown.fill(np.full(terrain.shape, UNKNOWN, np.uint8))
        self.views = np.zeros((n, self.words), np.uint64)
        self.low, self.high = np.zeros(n, np.int64), np.zeros(n, np.int64)
        view = (unknown.view[0], known.view[1], *unknown.view[2:])
        sights(view, terrain, self.views, self.low, self.high)


def informed_walk(config: EnvConfig, terrain: NDArray[np.bool_], seed: int, search: Search | None = None) -> bytes:
    """Return the actions (codes 0..3) of the shortest walk found from (0, 0) that discovers the target.

    terrain  bool[rows, cols], True where blocked
    seed     of the search's own draws

    ValueError when no walk was found: on a solvable terrain that takes a budget of very few changes.
    """
    ground, search = Ground(config, np.ascontiguousarray(terrain)), search or Search()
    found = [_one_walk(config, ground, mix(seed ^ mix(run)), search) for run in range(search.runs)]
    walks = [cells for cells in found if cells is not None]
    if not walks:
        raise ValueError(f"no walk found in {search.runs} x {search.changes} changes; give the search more")
    moves = np.diff(min(walks, key=len))
    actions = {-config.cols: 0, 1: 1, config.cols: 2, -1: 3}
    return bytes(actions[int(move)] for move in moves)


def _one_walk(config: EnvConfig, ground: Ground, seed: int, search: Search) -> NDArray[np.int32] | None:
    """Return the cells of one annealing's best walk up to where the target is reached, or None when it reached it never."""
    room = 32 + config.n // 8
    points, leans = np.zeros((3, room), np.int32), np.zeros((3, room), np.int8)
    covered, path = np.zeros((2, ground.words), np.uint64), np.zeros(8 * config.n, np.int32)
    sight = (ground.distance, ground.near, ground.views, ground.low, ground.high)
    count = anneal(
        0, config.target, search.changes, search.warm, search.cold, *sight, ground.free, config.n,
        points, leans, covered, path, np.array([seed], np.uint64),
    )  # fmt: skip
    if count < 0:
        return None
    length = walk(0, points[2], leans[2], count, *sight, covered[0], path)
    shown = np.bitwise_count(np.bitwise_or.accumulate(ground.views[path[: length + 1]], axis=0)).sum(axis=1, dtype=np.int64)
    return path[: int(np.argmax(shown >= config.target)) + 1].copy()
