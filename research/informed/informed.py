"""The informed planner: a long search on the true map, as a bound for policies.

It looks for the shortest walk from the start that discovers beta of the cells that count
(`world.cells_that_count`). The length of the walk that it finds is an upper bound of the optimum.
The search knows where the obstacles are before the rover sees them, so no policy can be expected to
reach this length; the ratio of a policy's steps to it says how much could be saved by knowing the
map.

The tour is improved by simulated annealing (Kirkpatrick, Gelatt and Vecchi 1983, "Optimization by
simulated annealing") of its length + MISSING_CELL_COST x (cells short of the target).
`tours.change_tour` lists the changes that are tried. The budget is a number of changes and the
random numbers follow from the seed, so a terrain has one answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import FREE, OBSTACLE, UNKNOWN, EnvConfig, fewest_cells
from marsexplorer.episode import Episode, steps_to_target
from marsexplorer.policies.kernels.visibility import VisibilityMap
from marsexplorer.random_numbers import mix
from marsexplorer.world import cells_that_count
from research.informed.annealing import anneal, empty_legs
from research.informed.tours import NO_PATH, fill_distances, fill_views, walk_tour

INFORMED = "informed"
"""Its name in results."""

MAX_CELLS = 128 * 128
"""Distances between all pairs of cells are held: half a gigabyte for so many."""


@dataclass(frozen=True)
class AnnealingConfig:
    """The length and the temperatures of the search; the defaults are the published.

    changes              tried in one annealing
    runs                 annealings, each from the empty tour; the shortest walk is taken
    initial_temperature  of the first change, moves
    final_temperature    of the last change, moves
    """

    changes: int = 300_000
    runs: int = 2
    initial_temperature: float = 3.0
    final_temperature: float = 0.12


def check_size(config: EnvConfig) -> None:
    """Raise ValueError if the grid is too large for the search."""
    if config.n > MAX_CELLS:
        raise ValueError(
            f"the informed planner takes grids of up to {MAX_CELLS} cells, got "
            f"{config.rows}x{config.cols}"
        )


class KnownTerrain:
    """A terrain whose map is known: neighbours, distances and views of its cells."""

    def __init__(
        self, config: EnvConfig, terrain: NDArray[np.bool_], start: tuple[int, int] = (0, 0)
    ) -> None:
        check_size(config)
        self.start = start[0] * config.cols + start[1]
        self.target = fewest_cells(cells_that_count(config, terrain, start), config.beta)
        n, self.words = config.n, (config.n + 63) // 64
        neighbours, distance = np.zeros((n, 4), np.int32), np.zeros((n, n), np.uint16)
        fill_distances(terrain, neighbours, distance, np.zeros(n, np.int32))
        self.free = np.flatnonzero(distance[self.start] != NO_PATH).astype(np.int32)
        obstacles, unknown = (VisibilityMap(terrain.shape, config.sensor_radius) for _ in range(2))
        obstacles.fill(np.where(terrain, np.uint8(OBSTACLE), np.uint8(FREE)))
        unknown.fill(np.full(terrain.shape, UNKNOWN, np.uint8))
        self.views = np.zeros((n, self.words), np.uint64)
        first_word, end_word = np.zeros(n, np.int64), np.zeros(n, np.int64)
        view = (unknown.view[0], obstacles.view[1], *unknown.view[2:])
        fill_views(view, terrain, self.views, first_word, end_word)
        self.arrays = (neighbours, distance, self.views, first_word, end_word)


def informed_actions(
    config: EnvConfig,
    terrain: NDArray[np.bool_],
    seed: int,
    annealing: AnnealingConfig | None = None,
    start: tuple[int, int] = (0, 0),
) -> bytes:
    """The actions (codes 0..3) of the shortest walk found that discovers enough.

    Enough is beta of the cells that count.

    Args:
        config: The configuration.
        terrain: bool[rows, cols], True where blocked.
        seed: Of the search's own random numbers.
        annealing: The length of the search; None: the published one.
        start: (row, col) of a free cell.

    Raises:
        ValueError: If no walk was found: on a solvable terrain that takes a budget of very few
            changes.
    """
    displacements = np.diff(
        min(informed_paths(config, terrain, seed, annealing or AnnealingConfig(), start), key=len)
    )
    actions = {-config.cols: 0, 1: 1, config.cols: 2, -1: 3}
    return bytes(actions[int(displacement)] for displacement in displacements)


def search(config: EnvConfig, seed: int) -> int:
    """The moves to 99 % of the search on a seed's terrain; the limit if it fails."""
    episode = Episode.begin(config, seed=seed)
    for action in informed_actions(config, episode.terrain, seed):
        episode.step(action)
    return steps_to_target(config, episode.outcome, episode.steps)


def informed_paths(
    config: EnvConfig,
    terrain: NDArray[np.bool_],
    seed: int,
    annealing: AnnealingConfig,
    start: tuple[int, int] = (0, 0),
) -> list[NDArray[np.int32]]:
    """The cells of the best walk of each annealing that found one.

    The arguments and errors are those of `informed_actions`.
    """
    known_terrain = KnownTerrain(config, np.ascontiguousarray(terrain), start)
    paths = [
        _anneal_path(config, known_terrain, mix(seed ^ mix(run)), annealing)
        for run in range(annealing.runs)
    ]
    walks = [path for path in paths if path is not None]
    if not walks:
        raise ValueError(
            f"no walk found in {annealing.runs} x {annealing.changes} changes; give the search more"
        )
    return walks


def _anneal_path(
    config: EnvConfig, known_terrain: KnownTerrain, seed: int, annealing: AnnealingConfig
) -> NDArray[np.int32] | None:
    """The cells of one annealing's best walk up to the target, or None."""
    start, capacity = known_terrain.start, 32 + config.n // 8
    points, tie_breaks = np.zeros((3, capacity), np.int32), np.zeros((3, capacity), np.int8)
    legs, proposed = empty_legs(capacity, known_terrain.words)
    covered, path = np.zeros((2, known_terrain.words), np.uint64), np.zeros(8 * config.n, np.int32)
    schedule = (annealing.changes, annealing.initial_temperature, annealing.final_temperature)
    place = (
        start,
        known_terrain.target,
        schedule,
        known_terrain.arrays,
        known_terrain.free,
        config.n,
    )
    scratch = (legs, proposed, covered, np.array([seed], np.uint64))
    count = anneal(*place, (points, tie_breaks), *scratch)
    if count < 0:
        return None
    length = walk_tour(
        start, points[2], tie_breaks[2], count, known_terrain.arrays, covered[0], path
    )
    views = np.bitwise_or.accumulate(known_terrain.views[path[: length + 1]], axis=0)
    discovered = np.bitwise_count(views).sum(axis=1, dtype=np.int64)
    return path[: int(np.argmax(discovered >= known_terrain.target)) + 1].copy()
