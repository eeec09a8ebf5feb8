"""Two rules that ours are compared with: distance advantage, and a U sweep.

**Distance advantage** (Ericson, Pedro and Jensfelt 2025, "Information Gain Is Not All You Need",
arXiv 2504.01980): go to the frontier cell that is near the rover and far from everywhere else. The
advantage of a candidate is the mean of its distances from all known free cells less its distance
from the rover, as in the authors' distilled program, without a prediction of the map. Here the
mean has a weight: 1 is theirs, 0 the nearest frontier. Candidates are those of `frontier-cost`.

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
from marsexplorer.policies.base import Memory
from marsexplorer.policies.frontier import FrontierCost
from marsexplorer.policies.kernels.grid import grid_scratch
from marsexplorer.policies.kernels.visibility import VisibilityMap
from research.baselines.kernels import most_advantageous, step_toward


class DistanceAdvantage:
    """Distance advantage with its memory; with no candidate it is `frontier-cost`.

    weight  of the mean distance from known free cells
    """

    def __init__(self, weight: float = 1.0, sensor_radius: int = 6) -> None:
        self.name = f"distance-advantage-{weight:g}"
        self.weight, self.sensor_radius = weight, sensor_radius
        self._nearest, self._memory = FrontierCost(sensor_radius), Memory()
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode; the rule draws nothing."""
        del seed
        self._memory.forget()
        self._goal, self._known = -1, -1
        self._shape = (0, 0)

    def act(self, observation: NDArray[Any]) -> int:
        """Choose an action 0..3."""
        memory = self._memory
        memory.observe(observation)
        codes = memory.codes
        if self._shape != codes.shape:
            self._shape = codes.shape
            self._scratch = grid_scratch(codes.shape)
            self._view = VisibilityMap(codes.shape, self.sensor_radius).view
            self._from_rover, self._candidates = np.zeros((2, codes.size), np.int32)
            self._bounds = np.zeros(codes.size)
        row, col = memory.position
        rover, known_cells = row * codes.shape[1] + col, int(np.count_nonzero(codes))
        # While the map stays as it is, each move makes the best candidate better by 1, and no other
        # by more.
        if known_cells != self._known or rover == self._goal:
            arrays = (self._view, self._scratch, self._from_rover, self._candidates, self._bounds)
            self._goal = most_advantageous(codes, memory.visited, rover, self.weight, *arrays)
            self._known = known_cells
        if self._goal < 0:
            return self._nearest.decide(memory)
        return int(step_toward(codes, rover, memory.heading, self._goal, False, self._scratch))


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
