"""The policy `lookahead`, "Expert that knows how terrains are made": goals are tried on terrains that agree with what is known.

Until a share of the cells is known it plays as `ppo` does: earlier, looking ahead gains nothing that could be measured. From
then on it draws terrains at every move (`kernels.posterior`) and compares candidates on all of them: the move of `ppo`, and
goals of the highest price that lie apart (`priced`), each by up to two shortest paths. On each terrain the rover walks a
candidate's path and the priced rule plays on until 99 % of the cells are known. Candidates that fall behind are dropped early,
and the first move of the one that takes the fewest moves on average is made. It is a rollout algorithm (Tesauro and Galperin
1996; Bertsekas, Tsitsiklis and Wu 1997) over the posterior.

It knows the generator of level `random`, which people do not: it is no measure of what a person could do. On every other level,
on grids of more than MOST_CELLS cells and where no terrain agrees with what is known, it plays as `ppo`.

Its draws follow from its name and the cells that the rover has stood on, and dropping counts terrains and never time: the same
observations give the same moves, on a busy machine too, whatever `reset` is given.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.policies.base import Memory, Policy, cell_at, goal_of
from marsexplorer.policies.kernels.grid import completion_target, neighbour
from marsexplorer.policies.kernels.posterior import move_chains, posterior_chains
from marsexplorer.policies.kernels.prices import SCREEN, PricedBoard, price_scratch, update_board
from marsexplorer.policies.kernels.rollouts import (
    MOST_CANDIDATES,
    compare,
    fill_truths,
    list_candidates,
)
from marsexplorer.policies.priced import TUNED, RuleTables
from marsexplorer.random_numbers import mix

TITLE = "Expert that knows how terrains are made"
"""What it is called where people read of it."""
LEVEL = "random"
"""The level whose generator it knows."""
MOST_CELLS = 84 * 84
FEWEST = 8
"""Terrains that must agree with what is known, or `ppo` plays."""


@dataclass(frozen=True)
class Settings:
    """How far and how carefully it looks ahead.

    cells    of the largest grid that they are for
    begins   share of the cells that is known when it begins, 0..1
    samples  terrains
    sweeps   Gibbs steps of each rectangle before each decision
    goals    candidates besides the move of `ppo` and the last goal
    margin   moves by which another candidate must be better than the last goal or the move of `ppo`
    drop     a candidate is dropped when it is more standard errors than this behind the best
    """

    cells: int
    begins: float
    samples: int
    sweeps: int
    goals: int
    margin: float
    drop: float


SETTINGS = (
    Settings(32 * 32, 0.6, 48, 4, 7, 0.25, 1.5),
    Settings(63 * 63, 0.8, 32, 4, 7, 0.5, 1.0),
    Settings(MOST_CELLS, 0.9, 24, 2, 7, 0.5, 1.0),
)
"""By the size of the grid: the first that is large enough."""


class LookaheadArrays:
    """What is kept of one board, and scratch arrays; `samples` terrains, or those of the settings."""

    def __init__(self, shape: tuple[int, int], radius: int, samples: int | None = None) -> None:
        rows, cols = shape
        n = rows * cols
        self.shape, self.settings = shape, next(each for each in SETTINGS if n <= each.cells)
        self.board, trial = PricedBoard(shape, radius), PricedBoard(shape, radius)
        self.rover: NDArray[np.int64] = np.zeros(3, np.int64)
        self.done: NDArray[np.uint8] = np.zeros(shape, np.uint8)
        self.trial = (trial.board, np.zeros(shape, np.uint8), np.zeros(3, np.int64))
        tables = RuleTables([TUNED.of(rows, cols, radius)], shape, radius)
        half_sides, closed = tables.prices[:2]
        squares = half_sides[: 1 + max(SCREEN, *(k for k in range(len(closed)) if closed[k].any()))]
        search = price_scratch(n), np.zeros(n, np.int32), np.zeros(n, np.int32)
        path = np.zeros(n, np.int32)
        self.half_sides = half_sides
        self.rule = (
            tables.prices, tables.highest, tables.limits, tables.weights, search, squares.copy(), path,
        )  # fmt: skip
        samples = samples or self.settings.samples
        self.chains = posterior_chains(shape, samples)
        self.truths = np.zeros((samples, len(self.board.board[2][0])), np.uint64)
        self.values, self.goals = np.zeros(n), np.zeros(MOST_CANDIDATES, np.int64)
        self.ways, self.lengths = np.zeros((MOST_CANDIDATES, n), np.int32), np.zeros(MOST_CANDIDATES, np.int64)  # fmt: skip
        self.costs, self.alive = np.zeros((MOST_CANDIDATES, samples)), np.zeros(MOST_CANDIDATES, np.uint8)  # fmt: skip


class Lookahead:
    """`ppo`, which looks ahead once most is known; it remembers its episode, terrains that agree with it included.

    base      `ppo` for the same sensor radius
    compared  after `act`: terrains on which the last move was decided, 0 where it is the base's
    """

    name = "lookahead"

    def __init__(self, base: Policy, sensor_radius: int = 6) -> None:
        self._base, self._radius, self._level = base, sensor_radius, LEVEL
        self._memory = Memory()
        self._arrays: LookaheadArrays | None = None
        self._state = np.zeros(1, np.uint64)
        self.reset(0)

    def set_level(self, level: str) -> None:
        """Say of which level the next episode is: on any but `random` it plays as its base, which is logged once."""
        if level != LEVEL:
            _say_fallback(level, self._base.name)
        self._level = level

    def reset(self, seed: int) -> None:
        """Forget the last episode; what it draws follows from its name, and `seed` is for the base."""
        self._base.reset(seed)
        self._memory.forget()
        self._goal, self.compared, self._compared_ways = -1, 0, (0, 0)
        self._key = mix(int.from_bytes(self.name.encode()))
        if self._arrays is not None:
            rectangles, covers, _, _ = self._arrays.chains
            rectangles[:], covers[:] = 0, 0

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3."""
        memory = self._memory
        memory.observe(observation)
        action, self.compared = self._base.act(observation), 0
        if self._level == LEVEL and memory.codes.size <= MOST_CELLS:
            found = self._look_ahead(memory, action)
            action = action if found is None else found
        if not self.compared:
            self._goal = -1
        return action

    def goal(self) -> tuple[int, int] | None:
        """Return the cell (row, col) that the last action leads towards, None where there is none."""
        if self._goal >= 0:
            return cell_at(self._goal, self._memory.codes.shape[1])
        return None if self.compared else goal_of(self._base)

    def _look_ahead(self, memory: Memory, action: int) -> int | None:
        """Bring the chains up to date; return the action found by looking ahead, None where the base's stands."""
        rows, cols = memory.codes.shape
        arrays = self._arrays
        if arrays is None or arrays.shape != (rows, cols):
            arrays = self._arrays = LookaheadArrays((rows, cols), self._radius)
        settings, board = arrays.settings, arrays.board
        cell = memory.position[0] * cols + memory.position[1]
        self._key = mix(self._key ^ (cell + 1))
        self._state[0] = self._key
        target = int(completion_target(rows * cols))
        left = update_board(memory.codes, board.board, arrays.half_sides, board.changed_columns)
        known = rows * cols - int(left)
        first = int(neighbour(cell, action, rows, cols))
        is_ahead = (
            settings.begins * rows * cols <= known < target
            and goal_of(self._base) is None  # else its loop guard chose
            and first >= 0
        )
        sweeps = settings.sweeps if is_ahead else 1
        count = move_chains(
            arrays.chains, board.board[0], rows, cols, target, sweeps, is_ahead, self._state
        )
        if not is_ahead or count < FEWEST:
            return None

        stride, radius = board.board[2][4:]
        fill_truths(arrays.chains, rows, cols, stride, radius, arrays.truths)
        arrays.rover[:] = cell, known, 0
        arrays.done[:] = memory.visited
        ways = (arrays.goals, arrays.ways, arrays.lengths)
        num = list_candidates(
            board.board, arrays.done, arrays.rover, arrays.rule, first, self._goal,
            1 + settings.goals, arrays.values, *ways,
        )  # fmt: skip
        if num < 2:
            return None
        real = (board.board, arrays.done, arrays.rover)
        self.compared = int(
            compare(
                real, arrays.trial, arrays.truths, count, settings.drop, arrays.rule, target, num,
                arrays.ways, arrays.lengths, arrays.costs, arrays.alive,
            )
        )  # fmt: skip
        means = arrays.costs[:num, : self.compared].mean(1)
        means[arrays.alive[:num] == 0] = np.inf
        means[0] -= settings.margin
        means[arrays.goals[:num] == self._goal] -= settings.margin * (self._goal >= 0)
        best = int(means.argmin())
        self._compared_ways = num, best
        self._goal = int(arrays.goals[best])
        moved = int(arrays.ways[best, 0]) - cell
        return (-cols, 1, cols, -1).index(moved)


@cache
def _say_fallback(level: str, base: str) -> None:
    said = "lookahead knows how terrains of level %s are made; on level %s it plays as %s"
    logging.getLogger(__name__).warning(said, LEVEL, level, base)
