"""The numbers of each move that follow from the prices of unknown cells.

Three rules like `policies.priced.FrontierPriced` value the reachable cells that show something new.
Their parameters are fixed here and not those of the policy `frontier-priced`, which may be tuned
again: a network must see what it was trained on. They were tuned on 21 x 21, on 42 x 42 and 84 x
84, and on 42 x 42 with large obstacles. For each rule a valid move has

    0   the highest value of a cell that a shortest path leads to by this move, as a share of the
        highest value of all cells; shares from LEAST_SHARE to 1 are mapped to 0..1, and lower ones
        are 0
    1   1 where that share is 1: the rule would make this move
    2   0.3 ln(1 + way) to that cell, way in moves; 0 where number 0 is

and the last number, the same for all moves, is 0.2 ln(cells of the grid), by which a network knows
the size.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel
from marsexplorer.policies.kernels.prices import (
    PriceParameters,
    forget_prices,
    price_scratch,
    sum_prices,
)
from marsexplorer.policies.kernels.visibility import count_visible
from marsexplorer.policies.priced import PricedRule, RuleTables

RULES = (
    PricedRule(PriceParameters((2.4, 10.5, 0.0), (3.8, 4.2, 2.6), 18.5, 18.0, 0.11), 300.0, 0.68, 1.345),
    PricedRule(PriceParameters((3.1, 19.8, 5.3), (6.2, 4.45, 3.25), 8.5, 19.5, 0.05), 300.0, 1.0, 1.335),
    PricedRule(PriceParameters((6.42, 21.27, 3.04), (5.06, 7.04, 3.52), 11.9, 26.0, 0.08), 300.0, 1.2, 1.664),
)  # fmt: skip
"""Tuned on 21 x 21; on 42 x 42 and 84 x 84; on 42 x 42 with large obstacles."""
SIDES = (21, 42, 84)
"""Sides of the square grids for which a network has weights of its own; each has four times the
cells of the one before.
"""
NUMBERS_PER_RULE = 3
PRICED_FEATURES = NUMBERS_PER_RULE * len(RULES) + 1
LEAST_SHARE = 0.75
LOG_CELLS_SCALE = 0.2


class PricedRuleTables:
    """The kernels' tables of some of RULES on boards of one shape.

    columns     int64[rules], the first of the numbers of a move that each rule writes
    half_sides  int64[squares] of `prices`, the same for all rules
    arrays      tables and scratch of `prices`; highest, limits and weights of `RuleTables`
    values      written by `value_actions`: float64[rules], the highest value by each rule;
                float64[rules, 4] and int64[rules, 4], by each action the highest value and the way
                to its cell
    """

    def __init__(self, rows: int, cols: int, radius: int, first: int, rules: Sequence[int]) -> None:
        """Build the tables.

        Args:
            rows: Of the board.
            cols: Of the board.
            radius: Of the sensor, cells.
            first: The column of the numbers of RULES[0].
            rules: Indices into RULES, at least one.
        """
        tables = RuleTables([RULES[rule] for rule in rules], (rows, cols), radius)
        count = len(rules)
        self.columns: NDArray[np.int64] = first + NUMBERS_PER_RULE * np.asarray(rules, np.int64)
        self.half_sides: NDArray[np.int64] = tables.prices[0]
        scratch = price_scratch(rows * cols, count)
        self.arrays = (tables.prices, scratch, tables.highest, tables.limits, tables.weights)
        self.values = np.zeros(count), np.zeros((count, 4)), np.zeros((count, 4), np.int64)


@inlined
def look_and_price(cell, board, rows, cols, tables, scratch):
    """Write the price of a look from a cell by each rule to the totals of scratch."""
    row = cell // cols
    col = cell - row * cols
    count_visible(board[2], row, col)
    sum_prices(row, col, rows, cols, board, tables, scratch)


@kernel
def value_actions(
    candidates, count, distance, first_actions, new_cells, shape, board, rules, rule_values
):
    """Write the values of all actions by each rule, see `PricedRuleTables`.

    They are exact if at least LEAST_SHARE of the highest value.

    candidates, count, distance, first_actions, new_cells  see `features`
    shape                                                  (rows, cols)
    board                                                  of `prices`, up to date
    """
    best, values, ways = rule_values
    tables, scratch, highest, limits, weights = rules
    totals = scratch[3]
    rows, cols = shape
    best[:], values[:], ways[:] = 0.0, 0.0, 0
    forget_prices(scratch)

    # 1. Price by each rule the candidate that could be worth most, so that most others need not be
    #    priced: candidates come nearest first, and where no view, however rich, could be worth
    #    more, nothing farther can.
    for k in range(len(best)):
        most, richest = 0.0, -1
        for i in range(count):
            moves = distance[candidates[i]]
            if limits[k] * weights[moves, k] <= most:
                break
            value = highest[new_cells[candidates[i]], k] * weights[moves, k]
            if moves > 0 and value > most:
                most, richest = value, candidates[i]
        if richest >= 0:
            look_and_price(richest, board, rows, cols, tables, scratch)
            moves = distance[richest]
            for rule in range(len(best)):
                value = min(totals[rule], limits[rule]) * weights[moves, rule]
                best[rule] = max(best[rule], value)

    for i in range(count):
        cell = candidates[i]
        moves = distance[cell]
        if moves == 0:
            continue

        # 2. What is surely below the shares that count is not priced.
        is_in_reach, can_count = False, False
        for k in range(len(best)):
            least = LEAST_SHARE * best[k]
            is_in_reach = is_in_reach or limits[k] * weights[moves, k] >= least
            can_count = can_count or highest[new_cells[cell], k] * weights[moves, k] >= least
        if not is_in_reach:
            break
        if not can_count:
            continue

        # 3. Every action that begins a shortest path has the value.
        look_and_price(cell, board, rows, cols, tables, scratch)
        for k in range(len(best)):
            value = min(totals[k], limits[k]) * weights[moves, k]
            best[k] = max(best[k], value)
            for action in range(4):
                if first_actions[cell] >> action & 1 and value > values[k, action]:
                    values[k, action], ways[k, action] = value, moves


@kernel
def write_priced_features(shape, rule_values, columns, moves):
    """Write the numbers above into moves float32[4, ...] for each valid move.

    columns  int64[rules], where the numbers of each rule begin; the numbers of rules without values
             stay as they are, 0
    """
    best, values, ways = rule_values
    for action in range(4):
        if moves[action, 0] == 0.0:
            continue
        for k in range(len(best)):
            at = columns[k]
            if best[k] > 0.0 and values[k, action] > LEAST_SHARE * best[k]:
                share = values[k, action] / best[k] - LEAST_SHARE
                moves[action, at] = share / (1.0 - LEAST_SHARE)
                moves[action, at + 1] = values[k, action] == best[k]
                moves[action, at + 2] = np.log(1.0 + ways[k, action]) * 0.3
        moves[action, moves.shape[1] - 1] = np.log(float(shape[0] * shape[1])) * LOG_CELLS_SCALE
