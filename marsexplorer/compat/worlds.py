"""Episodes of one configuration side by side, all of which move at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compat import kernels
from marsexplorer.compat.config import CodeConfig, points_of_ray
from marsexplorer.compat.kernels import DISCOVERED, OUTCOME, STEPS, X, Y
from marsexplorer.compat.terrain import draw_terrain
from marsexplorer.observation import STATE_VALUES

OUTCOMES = (None, "explored", "collided", "out_of_bounds", "timed_out")
"""By the kernels' code; None while running."""
CHANGING = ("scalars", "seeds", "terrains", "known")
"""The arrays that change."""


class CodeWorlds:
    """`num` episodes of the authors' code.

    shifts    int64[4, 2], what the actions add to (x, y)
    scalars   int64[num, 5]: x, y, moves, discovered cells, outcome
    seeds     int64[num], of the terrains; -1 for a given one
    terrains  uint8[num, cells], 1 where blocked
    known     uint8[num, cells]: 0 unknown, 1 free, 2 rover, 3 obstacle
    """

    def __init__(self, config: CodeConfig, num: int, shifts: NDArray[np.int64]) -> None:
        self.config, self.shifts = config, shifts
        self.scalars: NDArray[np.int64] = np.zeros((num, 5), np.int64)
        self.seeds: NDArray[np.int64] = np.zeros(num, np.int64)
        self.terrains: NDArray[np.uint8] = np.zeros((num, config.n), np.uint8)
        self.known: NDArray[np.uint8] = np.zeros((num, config.n), np.uint8)
        self._is_started = np.zeros(num, np.bool_)
        channels, length = config.conf["lidar_channels"], float(config.conf["lidar_range"])
        angles = np.linspace(0, 2 * np.pi, channels, endpoint=False)
        self._directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        points = points_of_ray(config.conf)
        self._rays = np.full((config.n, channels, points), -1, np.int32)
        self._is_listed = np.zeros(config.n, np.uint8)
        self._line = np.zeros(kernels.POINTS, np.int32)
        limits = float(config.conf["max_steps"]), config.share * config.n
        self._numbers = np.array([length, config.cuts_distances, *config.rewards, *limits])

    def start(self, index: int, seed: int, start: tuple[int, int] | None = None) -> None:
        """Begin an episode on the terrain of a seed, from a start or the configuration's."""
        self.start_on(index, draw_terrain(self.config, seed), start)
        self.seeds[index] = seed

    def start_on(
        self, index: int, terrain: NDArray[Any], start: tuple[int, int] | None = None
    ) -> None:
        """Begin an episode on a terrain, True where blocked; its start may be blocked."""
        shape = self.config.rows, self.config.cols
        blocked = np.asarray(terrain, np.bool_)
        if blocked.shape != shape:
            raise ValueError(f"the terrain must have shape {shape}, got {blocked.shape}")
        x, y = self.config.initial if start is None else (int(number) for number in start)
        if not (0 <= x < shape[0] and 0 <= y < shape[1]):
            raise ValueError(f"the start must be a cell of the grid, got {(x, y)}")
        self._is_started[index] = True
        self.seeds[index] = -1
        self.terrains[index], self.known[index] = blocked.reshape(-1), 0
        self.scalars[index] = 0
        self.scalars[index, X], self.scalars[index, Y] = x, y
        kernels.scan(self.scalars[index], self.terrains[index], self.known[index], self._shared())

    def step(self, actions: NDArray[np.int64]) -> NDArray[np.float64]:
        """Make one move of every episode and return the rewards.

        Raises RuntimeError before each episode has begun.
        """
        if not self._is_started.all():
            raise RuntimeError("no episode is running: call reset() first")
        rewards = np.zeros(len(self.scalars))
        episodes = self.scalars, self.terrains, self.known
        kernels.step(actions, self.shifts, rewards, *episodes, self._shared())
        return rewards

    def _shared(self) -> tuple[Any, ...]:
        """Return what the kernels take of the configuration."""
        size = self.config.rows, self.config.cols
        beams = self._rays, self._is_listed, self._directions
        return (*beams, self._numbers, *size, self._line)

    @property
    def codes(self) -> NDArray[np.uint8]:
        """What the rovers know, uint8[num, rows, cols]: a view."""
        return self.known.reshape(-1, self.config.rows, self.config.cols)

    def info(self, index: int) -> dict[str, Any]:
        """Return an episode's state in words and numbers."""
        state = self.scalars[index]
        discovered = int(state[DISCOVERED])
        return {
            "position": (int(state[X]), int(state[Y])),
            "discovered": discovered,
            "coverage": discovered / self.config.n,
            "outcome": OUTCOMES[state[OUTCOME]],
            "terrain_seed": None if self.seeds[index] < 0 else int(self.seeds[index]),
        }

    def values(self, index: int) -> NDArray[np.float32]:
        """Return an episode's observation, float32[rows, cols]."""
        x, y = self.scalars[index, X], self.scalars[index, Y]
        matrix: NDArray[np.float32] = STATE_VALUES[self.codes[index]]
        if self.scalars[index, STEPS]:
            matrix[x, y] = self.config.rover
        return matrix

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of everything that changes with a move."""
        return {name: getattr(self, name).copy() for name in CHANGING}

    def restore(self, snapshot: dict[str, NDArray[Any]]) -> None:
        """Set everything as `snapshot` returned it."""
        for name in CHANGING:
            getattr(self, name)[:] = snapshot[name]
        self._is_started[:] = True
