"""`lookahead`: compare goals by rollouts on terrains that agree with the map.

People read its name as "Expert that knows how terrains are made".

Until a share of the cells is known it plays as `ppo` does: earlier, looking ahead gains nothing
that could be measured. From then on it draws terrains at every move (`kernels.posterior`) that
agree with what is known, and compares candidates on all of them: the move of `ppo`, and goals of
the highest price that lie apart (`priced`), each by up to two shortest paths. On each terrain the
rover walks a candidate's path and the priced rule plays on until 99 % of the cells are known.
Candidates that fall behind are dropped early, and it makes the first move of the one that takes the
fewest moves on average. It is a rollout algorithm (Tesauro and Galperin 1996; Bertsekas, Tsitsiklis
and Wu 1997) over the posterior.

It knows the generator of level `random`, which people do not: it does not measure what a person
could do. On every other level, on grids of more than MOST_CELLS cells and where no terrain agrees
with what is known, it plays as `ppo`.

Its draws follow from its name and the cells that the rover has stood on, and dropping counts
terrains and never time: the same observations give the same moves, on a busy machine too, whatever
`reset` is given.
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
    drop     standard errors behind the best at which a candidate is dropped
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
    """One board's state from move to move, and scratch arrays.

    samples  terrains; None: those of the settings
    """

    def __init__(self, shape: tuple[int, int], radius: int, samples: int | None = None) -> None:
        rows, cols = shape
        n = rows * cols
        self.shape, self.settings = (
            shape,
            next(settings for settings in SETTINGS if n <= settings.cells),
        )
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
            tables.prices,
            tables.highest,
            tables.limits,
            tables.weights,
            search,
            squares.copy(),
            path,
        )
        samples = samples or self.settings.samples
        self.chains = posterior_chains(shape, samples)
        self.truths = np.zeros((samples, len(self.board.board[2][0])), np.uint64)
        self.values, self.goals = np.zeros(n), np.zeros(MOST_CANDIDATES, np.int64)
        self.ways, self.lengths = (
            np.zeros((MOST_CANDIDATES, n), np.int32),
            np.zeros(MOST_CANDIDATES, np.int64),
        )
        self.costs, self.alive = (
            np.zeros((MOST_CANDIDATES, samples)),
            np.zeros(MOST_CANDIDATES, np.uint8),
        )


class Lookahead:
    """`ppo`, which looks ahead once most is known.

    It remembers its episode, with terrains that agree with it.

    base      `ppo` for the same sensor radius
    compared  after `act`: terrains on which the last move was decided, 0 if it is the base's
    """

    name = "lookahead"

    def __init__(self, base: Policy, sensor_radius: int = 6) -> None:
        self._base, self._radius, self._level = base, sensor_radius, LEVEL
        self._memory = Memory()
        self._arrays: LookaheadArrays | None = None
        self._state = np.zeros(1, np.uint64)
        self.reset(0)

    def set_level(self, level: str) -> None:
        """Set the level of the next episode: on all but `random` it plays as its base.

        The log says so once.
        """
        if level != LEVEL:
            _say_fallback(level, self._base.name)
        self._level = level

    def reset(self, seed: int) -> None:
        """Forget the last episode; `seed` is for the base.

        Its own draws follow from its name.
        """
        self._base.reset(seed)
        self._memory.forget()
        self._goal, self.compared, self._compared_ways = -1, 0, (0, 0)
        self._key = mix(int.from_bytes(self.name.encode()))
        if self._arrays is not None:
            rectangles, covers, _, _ = self._arrays.chains
            rectangles[:], covers[:] = 0, 0

    def act(self, observation: NDArray[Any]) -> int:
        memory = self._memory
        memory.observe(observation)
        action, self.compared = self._base.act(observation), 0
        if self._level == LEVEL and memory.codes.size <= MOST_CELLS:
            better = self._look_ahead(memory, action)
            action = action if better is None else better
        if not self.compared:
            self._goal = -1
        return action

    def goal(self) -> tuple[int, int] | None:
        """The cell (row, col) that the last action leads towards, or None."""
        if self._goal >= 0:
            return cell_at(self._goal, self._memory.codes.shape[1])
        return None if self.compared else goal_of(self._base)

    def _look_ahead(self, memory: Memory, action: int) -> int | None:
        """Update the chains; return the better action, or None to keep the base's."""
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
        known_count = rows * cols - int(left)
        first = int(neighbour(cell, action, rows, cols))
        is_ahead = (
            settings.begins * rows * cols <= known_count < target
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
        arrays.rover[:] = cell, known_count, 0
        arrays.done[:] = memory.visited
        ways = (arrays.goals, arrays.ways, arrays.lengths)
        num = list_candidates(
            board.board,
            arrays.done,
            arrays.rover,
            arrays.rule,
            first,
            self._goal,
            1 + settings.goals,
            arrays.values,
            *ways,
        )
        if num < 2:
            return None
        real = (board.board, arrays.done, arrays.rover)
        self.compared = int(
            compare(
                real,
                arrays.trial,
                arrays.truths,
                count,
                settings.drop,
                arrays.rule,
                target,
                num,
                arrays.ways,
                arrays.lengths,
                arrays.costs,
                arrays.alive,
            )
        )
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
    logging.getLogger(__name__).warning(
        "lookahead knows how terrains of level %s are made; on level %s it plays as %s",
        LEVEL,
        level,
        base,
    )
