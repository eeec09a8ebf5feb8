"""Rules that ours are compared with: four of other people, and a U sweep.

**Distance advantage** (Ericson, Pedro and Jensfelt 2025, "Information Gain Is Not All You Need",
arXiv 2504.01980): go to the frontier cell that is near the rover and far from everywhere else. The
advantage of a candidate is the mean of its distances from all known free cells less its distance
from the rover, as in the authors' distilled program, without a prediction of the map. Here the
mean has a weight: 1 is theirs, 0 the nearest frontier. Candidates are those of `frontier-cost`.

**Next best view** (Gonzalez-Banos and Latombe 2002, "Navigation Strategies for Exploring Indoor
Environments"; Bircher et al. 2016, "Receding Horizon Next-Best-View Planner for 3D Exploration"):
draw SAMPLES known free cells within reach, and go to the one with the most unknown cells in sight
times exp(-DISCOUNT moves). As in the second, the last goal is a candidate too. It simplifies both
and is neither: candidates are known free cells alone, and one is worth what one view there shows,
where the second adds up the views of a branch. SAMPLES is the same at any size, so a large map has
few for its cells, and visited cells, which are no goal, use up draws.

**Cluster tour** (Kulich, Faigl and Preucil 2011, "On Distance Utility in the Exploration Task"; as
in Zhou et al. 2021, "FUEL", arXiv 2010.11561, clusters are of connected frontier cells): plan the
shortest open tour from the rover over all clusters, by nearest insertion and 2-opt, with the true
distances on the known map, and go to its first one. A cluster is a candidate of `frontier-cost`
that shows most, its stop, and those connected with it within a radius; then the next.

**U sweep**: what a policy would do that learnt a path and not to explore. It drives along lanes
that are no further apart than the lidar's diameter, there and back, a radius away from the edges:
at 21x21 rows 6 and 14, those of the authors' videos. It takes unknown cells for free, and skips
the end of a lane that is an obstacle or out of reach. Then it goes to the nearest frontier.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import OBSTACLE
from marsexplorer.observation import Codes
from marsexplorer.policies.base import Memory
from marsexplorer.policies.frontier import FrontierCost
from marsexplorer.policies.kernels.grid import grid_scratch
from marsexplorer.policies.kernels.visibility import VisibilityMap
from marsexplorer.random_numbers import mix
from research.baselines.kernels import (
    MOST_CLUSTERS,
    find_clusters,
    measure_between,
    most_advantageous,
    next_best_view,
    order_tour,
    step_toward,
)

SAMPLES = 40
"""Viewpoints that a next best view is chosen from."""
DISCOUNT = 0.4
"""A move: the best of 0.1, 0.2, 0.4 and 0.8 on 100 terrains of other seeds at 21x21."""


class GoalRule:
    """Drives to a goal, and chooses another when there or when the map changes.

    Without a goal it is `frontier-cost`. While the map stays as it is so does the goal, so it is
    reached; then its cell is visited, and no candidate again.
    """

    name = ""

    def __init__(self, sensor_radius: int = 6) -> None:
        self.sensor_radius = sensor_radius
        self._nearest, self._memory = FrontierCost(sensor_radius), Memory()
        self._shape = (0, 0)
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode; `seed` is of what the rule draws."""
        self._memory.forget()
        self._goal, self._known = -1, -1
        self._stream = np.array([mix(seed)], np.uint64)

    def prepare(self, shape: tuple[int, int]) -> None:
        """Make the arrays of a shape of the grid."""
        self._scratch = grid_scratch(shape)
        self._view = VisibilityMap(shape, self.sensor_radius).view

    def choose(self, codes: Codes, visited: Codes, rover: int) -> int:
        """The cell to drive to, row * cols + col, or -1 without a candidate."""
        raise NotImplementedError

    def act(self, observation: NDArray[Any]) -> int:
        """Choose an action 0..3."""
        memory = self._memory
        memory.observe(observation)
        codes = memory.codes
        if self._shape != codes.shape:
            rows, cols = codes.shape
            self._shape = rows, cols
            self.prepare(self._shape)
        row, col = memory.position
        rover, known_cells = row * codes.shape[1] + col, int(np.count_nonzero(codes))
        if known_cells != self._known or rover == self._goal:
            self._goal = self.choose(codes, memory.visited, rover)
            self._known = known_cells
        if self._goal < 0:
            return self._nearest.decide(memory)
        return int(step_toward(codes, rover, memory.heading, self._goal, False, self._scratch))


class DistanceAdvantage(GoalRule):
    """Distance advantage: the frontier cell that is near here and far from elsewhere.

    While the map stays as it is, each move makes the best candidate better by 1, and no other by
    more.

    weight  of the mean distance from known free cells
    """

    def __init__(self, weight: float = 1.0, sensor_radius: int = 6) -> None:
        self.name = f"distance-advantage-{weight:g}"
        self.weight = weight
        super().__init__(sensor_radius)

    def prepare(self, shape: tuple[int, int]) -> None:
        super().prepare(shape)
        cells = shape[0] * shape[1]
        self._from_rover, self._candidates = np.zeros((2, cells), np.int32)
        self._bounds = np.zeros(cells)

    def choose(self, codes: Codes, visited: Codes, rover: int) -> int:
        arrays = (self._view, self._scratch, self._from_rover, self._candidates, self._bounds)
        return int(most_advantageous(codes, visited, rover, self.weight, *arrays))


class NextBestView(GoalRule):
    """The best of some viewpoints drawn at random: much to see, few moves away.

    discount  of a view, for each move to it
    """

    name = "next-best-view"

    def __init__(self, discount: float = DISCOUNT, sensor_radius: int = 6) -> None:
        self.discount = discount
        super().__init__(sensor_radius)

    def choose(self, codes: Codes, visited: Codes, rover: int) -> int:
        settings = (SAMPLES, self.discount, self._goal)
        arrays = (self._view, self._scratch, self._stream)
        return int(next_best_view(codes, visited, rover, *settings, *arrays))


class ClusterTour(GoalRule):
    """The first stop of a short tour over the clusters of frontier cells."""

    name = "cluster-tour"

    def prepare(self, shape: tuple[int, int]) -> None:
        super().prepare(shape)
        cells = shape[0] * shape[1]
        self._shown, self._candidates = np.zeros((2, cells), np.int32)
        self._stops, self._tour, self._gaps = np.zeros((3, MOST_CLUSTERS + 1), np.int32)
        self._between = np.zeros((MOST_CLUSTERS + 1, MOST_CLUSTERS + 1), np.int32)

    def choose(self, codes: Codes, visited: Codes, rover: int) -> int:
        reach = self.sensor_radius
        of_cells = (self._view, self._scratch, self._shown, self._candidates, self._stops)
        count = find_clusters(codes, visited, rover, reach, *of_cells)
        if count == 0:
            return -1
        measure_between(codes, count, self._stops, self._scratch, self._between)
        order_tour(count, self._between, self._tour, self._gaps)
        return int(self._stops[self._tour[0]])


def lanes(rows: int, cols: int, radius: int) -> Iterator[tuple[int, int]]:
    """Yield the ends (row, col) of the lanes in their order, there and back."""
    count = -(-rows // (2 * radius + 1))
    left, right = min(radius, cols // 2), max(cols - 1 - radius, cols // 2)
    first, last = min(radius, rows // 2), max(rows - 1 - radius, rows // 2)
    for number, row in enumerate(np.linspace(first, last, count).round().astype(int).tolist()):
        ends = [(row, left), (row, right)]
        yield from ends if number % 2 == 0 else ends[::-1]


class USweep:
    """The U sweep with its memory, and `frontier-cost` after it."""

    name = "u-sweep"

    def __init__(self, sensor_radius: int = 6) -> None:
        self.sensor_radius = sensor_radius
        self._nearest, self._memory = FrontierCost(sensor_radius), Memory()
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode; the rule draws nothing."""
        del seed
        self._memory.forget()
        self._ends: list[tuple[int, int]] | None = None

    def act(self, observation: NDArray[Any]) -> int:
        """Choose an action 0..3."""
        memory = self._memory
        memory.observe(observation)
        codes, (row, col) = memory.codes, memory.position
        rows, cols = codes.shape
        if self._ends is None:
            self._ends, self._scratch = (
                [*lanes(rows, cols, self.sensor_radius)],
                grid_scratch(codes.shape),
            )
        while self._ends:
            end = self._ends[0]
            if end != (row, col) and codes[end] != OBSTACLE:
                goal = end[0] * cols + end[1]
                rover = row * cols + col
                action = step_toward(codes, rover, memory.heading, goal, True, self._scratch)
                if action >= 0:
                    return int(action)
            self._ends.pop(0)
        return self._nearest.decide(memory)
