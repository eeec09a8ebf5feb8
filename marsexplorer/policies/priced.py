"""`frontier-priced`: `frontier-utility` with prices for unknown cells.

Exploration is cheap in the open, where a cell will be seen in passing, and expensive where
something was left behind and the rover has to come back. So the rule goes towards the candidate
(see `frontier`) of the highest

    min(prices of the unknown cells it is expected to show, limit) / (way + offset)^power

where way is the length of a shortest known path in moves, and decides again after every move.
`kernels.prices` defines the prices. Ties go to the nearer, then to the northernmost, then to the
westernmost candidate; of several shortest paths the rover takes one that begins straight on, else
the first of north, east, south, west.

The rule ends. While nothing new is seen the prices stay as they are, so each move towards the best
candidate raises its value, and the best value rises strictly. There are finitely many values, so
after finitely many moves the rover stands on the candidate, which is none from then on; and there
are finitely many candidates. As the candidates are those of `frontier-utility`, the rule ends only
when all is seen that can be. The loop guard stands behind it nevertheless.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.config import OBSTACLE, UNKNOWN
from marsexplorer.observation import valid_actions
from marsexplorer.policies.base import Memory, cell_at
from marsexplorer.policies.guard import GuardedRule
from marsexplorer.policies.kernels.grid import UNREACHABLE, neighbour
from marsexplorer.policies.kernels.prices import (
    FADE_UNIT,
    PRICE_UNIT,
    SCREEN,
    TUNED_RADIUS,
    PricedBoard,
    PriceParameters,
    PriceTables,
    forget_prices,
    sum_prices,
    update_board,
)
from marsexplorer.policies.kernels.visibility import count_visible


@dataclass(frozen=True)
class PricedRule:
    """The parameters of `frontier-priced`, for a sensor radius of 6 cells.

    prices  of unknown cells
    limit   the most that a view counts, in unknown cells in the open; it bounds how far away a goal
            can be
    offset  added to a way, moves, 0 or more; power: of the way, above 0
    """

    prices: PriceParameters
    limit: float
    offset: float
    power: float

    def __post_init__(self) -> None:
        if self.limit <= 0 or self.offset < 0 or self.power <= 0:
            raise ValueError(f"limit and power must be above 0 and offset 0 or more, got {self}")


SIDES = (21, 42, 84)
"""Sides of the square grids (cells, at a sensor radius of 6) that the rules of a `SizedRule` are
for.
"""


@dataclass(frozen=True)
class SizedRule:
    """Parameters for every size; `small`, `middle` and `large` are for grids of SIDES.

    Between them they change with the logarithm of the side, the side of another grid being the root
    of its cells. Smaller grids have those of `small`, larger ones those of `large`.
    """

    small: PricedRule
    middle: PricedRule
    large: PricedRule

    def of(self, rows: int, cols: int, radius: int = TUNED_RADIUS) -> PricedRule:
        """The parameters for a grid, measured in units of the sensor radius."""
        side = (rows * cols) ** 0.5 * TUNED_RADIUS / radius
        place = float(np.clip(np.log(side / SIDES[0]) / np.log(SIDES[1] / SIDES[0]), 0.0, 2.0))
        if place <= 1:
            return between(self.small, self.middle, place)
        return between(self.middle, self.large, place - 1)


def between(first: PricedRule, last: PricedRule, share: float) -> PricedRule:
    """The rule whose parameters lie between two others', by share.

    share  0 for the first rule, 1 for the last
    """

    def mix(one: Any, other: Any) -> Any:
        if isinstance(one, tuple):
            return tuple(map(mix, one, other))
        if isinstance(one, (PricedRule, PriceParameters)):
            return type(one)(*map(mix, vars(one).values(), vars(other).values()))
        return (1 - share) * one + share * other

    mixed: PricedRule = mix(first, last)
    return mixed


TUNED = SizedRule(
    PricedRule(PriceParameters((2.4, 10.5, 0.0), (3.8, 4.2, 2.6), 18.5, 18.0, 0.11), 150.0, 0.68, 1.345),
    PricedRule(PriceParameters((1.6, 17.25, 2.65), (5.0, 4.6, 2.925), 13.5, 18.75, 0.095), 225.0, 0.84, 1.2325),
    PricedRule(PriceParameters((3.1, 19.8, 5.3), (6.2, 4.45, 3.25), 8.5, 19.5, 0.05), 300.0, 1.0, 1.335),
)  # fmt: skip
"""The parameters that the policy has."""


class RuleTables:
    """The tables of several rules that kernels read, for grids of one shape.

    prices   `tables` of `prices`
    highest  int64[cells of a window + 1, rules]: the highest price of a view of so many cells
    limits   int64[rules], the highest price of any view
    weights  float64[n + 1, rules]: (way + offset)^-power, where a way of 0, which is none, counts
             as 1
    """

    def __init__(self, rules: Sequence[PricedRule], shape: tuple[int, ...], radius: int) -> None:
        tables = PriceTables([rule.prices for rule in rules], radius)
        self.prices = tables.arrays
        limits = [round(rule.limit * PRICE_UNIT * FADE_UNIT) for rule in rules]
        self.limits: NDArray[np.int64] = np.array(limits)
        self.highest: NDArray[np.int64] = np.minimum(tables.highest, self.limits)
        ways = np.maximum(np.arange(shape[0] * shape[1] + 1.0), 1.0)
        weights = [(ways + rule.offset) ** -rule.power for rule in rules]
        self.weights: NDArray[np.float64] = np.stack(weights, axis=1)


@kernel
def toward_most_priced(
    codes, visited, row, col, heading, board, tables, search, highest, limits, weights, goal
):
    """The first action of a shortest path to the candidate of highest value, or -1.

    codes, visited  uint8[rows, cols]; board and tables as in `prices`, the board up to date
    search          (scratch of `prices`; distance int32[n]; first_actions uint8[n]; queue int32[n])
    highest, limits, weights  of `RuleTables`, of one rule
    goal            int64[1], written: the candidate, row * cols + col, or -1
    """
    rows, cols = codes.shape
    scratch, distance, first_actions, queue = search
    known_codes, counts, view = board
    limit, totals = limits[0], scratch[3]
    forget_prices(scratch)
    distance[:] = UNREACHABLE
    start = row * cols + col
    distance[start], first_actions[start], queue[0] = 0, 0, start
    head, tail = 0, 1
    best, best_value, best_moves = -1, 0.0, 0
    while head < tail:
        cell = queue[head]
        head += 1
        moves = distance[cell]
        r = cell // cols
        c = cell - r * cols

        # 1. Cells come nearest first, so when the most that a view counts would not be enough,
        #    nothing farther is.
        if limit * weights[moves, 0] < best_value:
            break

        # 2. Price what the cell is expected to show, unless the number of cells says already that
        #    it is not enough.
        if visited[r, c] == 0 and counts[SCREEN, cell] > 0:
            new = count_visible(view, r, c)
            if new > 0 and highest[new, 0] * weights[moves, 0] >= best_value:
                sum_prices(r, c, rows, cols, board, tables, scratch)
                value = min(totals[0], limit) * weights[moves, 0]
                is_before = value == best_value and moves == best_moves and cell < best
                if value > best_value or is_before:
                    best, best_value, best_moves = cell, value, moves

        # 3. Go on to its neighbours, and hand on the actions that begin a shortest path.
        for action in range(4):
            near = neighbour(cell, action, rows, cols)
            if near < 0 or known_codes[near] == UNKNOWN or known_codes[near] == OBSTACLE:
                continue
            if distance[near] == UNREACHABLE:
                distance[near], queue[tail] = moves + 1, near
                tail += 1
                first_actions[near] = 1 << action if moves == 0 else first_actions[cell]
            elif distance[near] == moves + 1:
                first_actions[near] |= first_actions[cell]
    goal[0] = best
    if best < 0:
        return -1
    if first_actions[best] >> heading & 1:
        return heading
    for action in range(4):
        if first_actions[best] >> action & 1:
            return action
    return -1


class FrontierPriced(GuardedRule):
    """The priced rule with its memory; with nothing left to see it moves validly.

    rules  its parameters by size; TUNED unless others are given
    """

    name = "frontier-priced"

    def __init__(self, sensor_radius: int = 6, rules: SizedRule = TUNED) -> None:
        super().__init__(sensor_radius)
        self.rules = rules
        self._board: PricedBoard | None = None
        self._goal: NDArray[np.int64] = np.full(1, -1)

    def reset(self, seed: int) -> None:
        """Forget the last episode; the rule draws nothing."""
        super().reset(seed)
        self._goal[0] = -1

    def decide(self, memory: Memory) -> int:
        codes, (row, col) = memory.codes, memory.position
        if self._board is None or self._board.shape != codes.shape:
            self._begin(codes.shape)
        assert self._board is not None
        board, tables = self._board.board, self._tables
        update_board(codes, board, tables.prices[0], self._board.changed_columns)
        action = toward_most_priced(
            codes,
            memory.visited,
            row,
            col,
            memory.heading,
            board,
            tables.prices,
            self._search,
            tables.highest,
            tables.limits,
            tables.weights,
            self._goal,
        )
        return int(action) if action >= 0 else next(iter(valid_actions(codes, row, col)), 0)

    def goal(self) -> tuple[int, int] | None:
        """The cell (row, col) that the last action leads towards, or None."""
        cols = self._board.shape[1] if self._board else 1
        return self.guard.goal() or cell_at(int(self._goal[0]), cols)

    def _begin(self, shape: tuple[int, ...]) -> None:
        self._board, cells = PricedBoard(shape, self.sensor_radius), shape[0] * shape[1]
        rule = self.rules.of(shape[0], shape[1], self.sensor_radius)
        self._tables = RuleTables([rule], shape, self.sensor_radius)
        arrays = np.zeros(cells, np.int32), np.zeros(cells, np.uint8), np.zeros(cells, np.int32)
        self._search = (self._board.scratch, *arrays)
