"""The numbers of each move that follow from the prices of unknown cells (`kernels.prices`), for networks that see prices.

Three rules like `policies.priced.FrontierPriced` value the reachable cells that show something new. Their parameters are fixed
here and not those of the policy `frontier-priced`, which may be tuned again: a network must see what it was trained on. They
were tuned on 21 x 21, on 42 x 42 and 84 x 84, and on 42 x 42 with large obstacles. Of each rule a valid move has

    0   the highest value of a cell that a shortest path leads to by this move, as a share of the highest value of all cells;
        shares from LEAST_SHARE to 1 are mapped to 0..1, and lower ones are 0
    1   1 where that share is 1: the rule would make this move
    2   0.3 ln(1 + way) to that cell, way in moves; 0 where number 0 is

and the last number, the same for all moves, is 0.2 ln(cells of the grid), by which a network knows the size.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel
from marsexplorer.policies.kernels.prices import (
    FADE_UNIT,
    PRICE_UNIT,
    PriceParameters,
    PriceTables,
    forget_prices,
    price_scratch,
    sum_prices,
)
from marsexplorer.policies.kernels.visibility import count_visible
from marsexplorer.policies.priced import PricedRule

RULES = (
    PricedRule(PriceParameters((2.4, 10.5, 0.0), (3.8, 4.2, 2.6), 18.5, 18.0, 0.11), 300.0, 0.68, 1.345),
    PricedRule(PriceParameters((3.1, 19.8, 5.3), (6.2, 4.45, 3.25), 8.5, 19.5, 0.05), 300.0, 1.0, 1.335),
    PricedRule(PriceParameters((6.42, 21.27, 3.04), (5.06, 7.04, 3.52), 11.9, 26.0, 0.08), 300.0, 1.2, 1.664),
)
"""Tuned on 21 x 21; on 42 x 42 and 84 x 84; on 42 x 42 with large obstacles."""
NUMBERS_PER_RULE = 3
PRICED_FEATURES = NUMBERS_PER_RULE * len(RULES) + 1
LEAST_SHARE = 0.75
LOG_CELLS_SCALE = 0.2


class PricedRuleTables:
    """What the kernels need of RULES on boards of one shape, for a sensor radius in cells.

    half_sides  int64[squares] of `prices`, the same for all rules
    rules       for each rule: tables of `prices`; int64[2], the highest product of a price and a fade, and the limit of a view
                in the same unit; float64[n + 1], the factor of a way of so many moves; scratch of `prices`
    found       float64[rules]: the highest value by each rule; float64[rules, 4], int64[rules, 4]: by each action the highest
                value, and the way to its cell
    """

    def __init__(self, rows: int, cols: int, radius: int) -> None:
        tables = [PriceTables(rule.prices, radius) for rule in RULES]
        self.half_sides: NDArray[np.int64] = tables[0].arrays[0]
        self.rules = tuple(
            (
                table.arrays,
                np.array([table.highest, round(rule.limit * PRICE_UNIT * FADE_UNIT)]),
                (np.maximum(np.arange(rows * cols + 1.0), 1.0) + rule.offset) ** -rule.power,
                price_scratch(rows * cols),
            )
            for rule, table in zip(RULES, tables, strict=True)
        )
        count = len(RULES)
        self.found = np.zeros(count), np.zeros((count, 4)), np.zeros((count, 4), np.int64)


@inlined
def can_count(limit, rule, moves, best):
    """Return whether a view priced at `limit` in a distance of so many moves has a share of the highest value that counts."""
    return min(limit, rule[1][1]) * rule[2][moves] >= LEAST_SHARE * best


@kernel
def value_actions(candidates, count, distance, first_actions, new_cells, shape, board, rules, found):
    """Write what `found` is to hold, see `PricedRuleTables`: exact where it is at least LEAST_SHARE of the highest value.

    candidates, count, distance, first_actions, new_cells  see `features`
    shape                                                  (rows, cols)
    board                                                  of `prices`, up to date
    """
    best, values, ways = found
    rows, cols = shape
    best[:], values[:], ways[:] = 0.0, 0.0, 0
    for k in range(len(rules)):
        forget_prices(rules[k][3])
    for i in range(count):
        cell = candidates[i]
        moves = distance[cell]
        if moves == 0:
            continue

        # 1. Candidates come nearest first: where no view, however rich, would count any more, nothing farther does.
        is_in_reach, is_seen = False, False
        for k in range(len(rules)):
            is_in_reach = is_in_reach or can_count(rules[k][1][1], rules[k], moves, best[k])
        if not is_in_reach:
            break

        # 2. Price the view by each rule by which the number of its cells may be enough, and look only once.
        row = cell // cols
        col = cell - row * cols
        for k in range(len(rules)):
            tables, bounds, weights, scratch = rules[k]
            if not can_count(new_cells[cell] * bounds[0], rules[k], moves, best[k]):
                continue
            if not is_seen:
                count_visible(board[2], row, col)
                is_seen = True
            value = min(sum_prices(row, col, rows, cols, board, tables, scratch), bounds[1]) * weights[moves]
            best[k] = max(best[k], value)

            # 3. Every action that begins a shortest path has it.
            for action in range(4):
                if first_actions[cell] >> action & 1 and value > values[k, action]:
                    values[k, action], ways[k, action] = value, moves


@kernel
def write_priced_features(shape, found, moves, first):
    """Write the numbers of the module's header into moves float32[4, ...], from column `first` on, for each valid move."""
    best, values, ways = found
    for action in range(4):
        if moves[action, 0] == 0.0:
            continue
        for k in range(len(best)):
            at = first + NUMBERS_PER_RULE * k
            if best[k] > 0.0 and values[k, action] > LEAST_SHARE * best[k]:
                moves[action, at] = (values[k, action] / best[k] - LEAST_SHARE) / (1.0 - LEAST_SHARE)
                moves[action, at + 1] = values[k, action] == best[k]
                moves[action, at + 2] = np.log(1.0 + ways[k, action]) * 0.3
        moves[action, first + NUMBERS_PER_RULE * len(best)] = np.log(float(shape[0] * shape[1])) * LOG_CELLS_SCALE
