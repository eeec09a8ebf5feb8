"""Prices of unknown cells: the more closed in a cell is, the more it counts.

The rover would have to come back for such a cell. The price of an unknown cell u, in whole units of
1 / PRICE_UNIT, each term rounded by itself:

    1 + sum over k of weight_k closed_k(u)^power_k + pocket e^(-s(u) / pocket_cells)

closed_k(u) is the share of the square of half side h_k round u that is known or off the grid, and
s(u) the number of cells of the unknown region of u, cells joined by edges and corners. A view is
priced as the sum of the prices of the unknown cells that the lidar is expected to show
(`visibility.count_visible`), each times e^(-fade (|u - v| - 1)) in units of 1 / FADE_UNIT. All sums
are of whole numbers, so they depend neither on the order of the cells nor on how the terrain is
mirrored.

Kernels take, of one board, the tuples

    board    known_codes  uint8[n], the codes at the last update, NO_CODE before the first
             counts       int16[SQUARES, n], the unknown cells in each square round each cell
             view         of `visibility`, with the bitboards at the last update
    tables   half_sides   int64[SQUARES], cells
             closed       int32[SQUARES, most + 1, rules], what a square adds to a price, by its
                          number of unknown cells
             pockets      int32[cells, rules], what a region adds by its number of cells; larger
                          regions add nothing
             fade         int32[2 radius + 1, 2 radius + 1, rules], by the window cell
             rules        tuple of the numbers 0, 1, ... of the rules: its length is known when a
                          kernel is compiled
    scratch  price        int32[n, rules], 0 where a cell has not been priced since `forget_prices`
             region       int32[n], 0 where a region has not been measured since then
             queue        int32[n]
             totals       int64[rules], see `sum_prices`

Several rules, each with parameters of its own, price a view together: each cell is looked up once
for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel, lowest
from marsexplorer.config import OBSTACLE, UNKNOWN
from marsexplorer.policies.kernels.visibility import VisibilityMap, word_and_bit

SCREEN = 1
"""The square whose half side is the sensor radius: where it has no unknown cell, nothing new can
be seen.
"""

PRICE_UNIT = 1024
"""The price of an unknown cell in the open."""
FADE_UNIT = 64
"""The fade of a cell that is seen from next to it."""
SQUARES = 3
"""Squares of which the unknown cells are counted."""
NO_CODE = 255
"""The code of a cell before the first board."""
TUNED_RADIUS = 6
"""The sensor radius (cells) for which parameters are given; those in cells are scaled for other
radii.
"""


Triple = tuple[float, float, float]
"""A number for each square."""


@dataclass(frozen=True)
class PriceParameters:
    """The parameters of the formula above, for a sensor radius of TUNED_RADIUS.

    weights, powers   of the squares of half sides 2, 6 and 12 cells; powers above 0
    pocket            0 or more: what the smallest unknown region adds
    pocket_cells      cells after which that has fallen to 1 / e, above 0
    fade              0 or more, a cell of distance
    """

    weights: Triple
    powers: Triple
    pocket: float
    pocket_cells: float
    fade: float

    def __post_init__(self) -> None:
        is_negative = min(*self.weights, self.pocket, self.fade) < 0
        if is_negative or min(*self.powers, self.pocket_cells) <= 0:
            raise ValueError(
                f"weights, pocket and fade must be 0 or more, powers and pocket_cells above 0, got {self}"
            )


class PriceTables:
    """The tables of prices that kernels read, for rules that price together.

    arrays    `tables` as described above
    highest   int64[cells of a window + 1, rules]: the highest price of a view of so many cells
    """

    def __init__(self, parameters: Sequence[PriceParameters], radius: int) -> None:
        scale, rules = radius / TUNED_RADIUS, len(parameters)
        half_sides = np.array([max(1, round(scale * half)) for half in (2, 6, 12)])
        closed = np.zeros((SQUARES, int(2 * half_sides[-1] + 1) ** 2 + 1, rules), np.int32)
        longest = max(longest_pocket(rule, scale) for rule in parameters)
        pockets = np.zeros((longest + 2, rules), np.int32)
        fade = np.zeros((2 * radius + 1, 2 * radius + 1, rules), np.int32)
        away = np.hypot(*np.mgrid[-radius : radius + 1, -radius : radius + 1])
        self.highest: NDArray[np.int64] = np.zeros((fade[:, :, 0].size + 1, rules), np.int64)
        for rule, numbers in enumerate(parameters):
            for k, half in enumerate(half_sides):
                area, weight, power = int(2 * half + 1) ** 2, numbers.weights[k], numbers.powers[k]
                shares = 1 - np.arange(area + 1) / area
                closed[k, : area + 1, rule] = np.rint(PRICE_UNIT * weight * shares**power)
            sizes = np.arange(longest_pocket(numbers, scale) + 2)
            smaller = np.exp(-sizes / (numbers.pocket_cells * scale**2))
            pockets[: len(sizes), rule] = np.rint(PRICE_UNIT * numbers.pocket * smaller)
            fainter = np.exp(-numbers.fade / scale * np.maximum(away - 1, 0))
            fade[:, :, rule] = np.rint(FADE_UNIT * fainter)
            # A view of so many cells is at most the nearest ones, each of the highest price.
            price = PRICE_UNIT + int(closed[:, :, rule].max(axis=1).sum() + pockets[:, rule].max())
            nearest = np.sort(fade[:, :, rule], axis=None)[::-1].astype(np.int64)
            self.highest[1:, rule] = price * np.cumsum(nearest)
        self.arrays = (half_sides, closed, pockets, fade, tuple(range(rules)))


def longest_pocket(parameters: PriceParameters, scale: float) -> int:
    """The cells of the largest unknown region that still adds to a price.

    The term of larger regions rounds to 0.

    scale  the sensor radius, in units of TUNED_RADIUS
    """
    reach = np.log(max(1.0, 2 * PRICE_UNIT * parameters.pocket))
    return max(0, int(parameters.pocket_cells * scale**2 * reach))


class PricedBoard:
    """One board from move to move, and scratch arrays.

    board, scratch   as described above
    changed_columns  int64[rows, 2], see `update_board`
    """

    def __init__(self, shape: tuple[int, ...], radius: int) -> None:
        rows, cols = shape
        self.shape, self.changed_columns = (rows, cols), np.zeros((rows, 2), np.int64)
        known_codes = np.full(rows * cols, NO_CODE, np.uint8)
        counts = np.zeros((SQUARES, rows * cols), np.int16)
        self.board = (known_codes, counts, VisibilityMap(shape, radius).view)
        self.scratch = price_scratch(rows * cols)


PriceScratch = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]
"""(price, region, queue, totals)."""


def price_scratch(cells: int, rules: int = 1) -> PriceScratch:
    """`scratch` as described above, for boards of so many cells and so many rules."""
    price = np.zeros((cells, rules), np.int32)
    region = np.zeros(cells, np.int32)
    queue = np.zeros(cells, np.int32)
    return price, region, queue, np.zeros(rules, np.int64)


@kernel
def count_in_squares(counts, half_sides, row, col, rows, cols, change):
    """Add `change` to the counts of all squares that contain (row, col)."""
    for k in range(half_sides.shape[0]):
        half = half_sides[k]
        left, right = max(0, col - half), min(cols, col + half + 1)
        for r in range(max(0, row - half), min(rows, row + half + 1)):
            for cell in range(r * cols + left, r * cols + right):
                counts[k, cell] += change


@kernel
def update_board(codes, board, half_sides, changed_columns):
    """Update a board with codes uint8[rows, cols]; return how many cells are unknown.

    half_sides       int64[k], of the k squares that are counted; none for a board without counts
    changed_columns  int64[rows, 2], written: the first and the last column of each row in which a
                     cell became known, became unknown, or became an obstacle; (cols, -1) where none
                     did
    """
    known_codes, counts, view = board
    unknown, blocked, _, _, stride, radius = view
    rows, cols = codes.shape
    left = 0
    for row in range(rows):
        # 1. Most rows are as they were; this loop has no branch, so that it takes a few
        #    instructions for many cells.
        first, differs = row * cols, np.uint8(0)
        for col in range(cols):
            left += codes[row, col] == UNKNOWN
            differs |= codes[row, col] ^ known_codes[first + col]
        changed_columns[row, 0], changed_columns[row, 1] = cols, -1
        if differs == 0:
            continue

        # 2. Correct the bitboards and the counts. From rover to free, or the other way round,
        #    changes none of them.
        for col in range(cols):
            code = codes[row, col]
            if known_codes[first + col] == code:
                continue
            known_codes[first + col] = code
            word, bit = word_and_bit(row, col, stride, radius)
            was_unknown, was_blocked = unknown[word] & bit != 0, blocked[word] & bit != 0
            if was_unknown != (code == UNKNOWN):
                unknown[word] ^= bit
                count_in_squares(counts, half_sides, row, col, rows, cols, -1 if was_unknown else 1)
            elif was_blocked == (code == OBSTACLE):
                continue
            if was_blocked != (code == OBSTACLE):
                blocked[word] ^= bit
            changed_columns[row, 0] = min(changed_columns[row, 0], col)
            changed_columns[row, 1] = col
    return left


@inlined
def forget_prices(scratch):
    """Forget the prices and regions of a board that has changed."""
    price, region = scratch[0], scratch[1]
    price[:] = 0
    region[:] = 0


@kernel
def measure_region(start, known_codes, rows, cols, most, region, queue):
    """The cells of an unknown cell's region, at most `most`; `region` gets them too."""
    # 1. Flood from the cell, until the region has ended, or is large, or turns out to be one that
    #    was found large before.
    queue[0] = start
    region[start] = -1
    head, tail, is_large = 0, 1, False
    while head < tail and tail < most and not is_large:
        row = queue[head] // cols
        col = queue[head] - row * cols
        head += 1
        for r in range(max(0, row - 1), min(rows, row + 2)):
            for cell in range(r * cols + max(0, col - 1), r * cols + min(cols, col + 2)):
                if known_codes[cell] == UNKNOWN:
                    if region[cell] == 0:
                        region[cell] = -1
                        queue[tail] = cell
                        tail += 1
                    elif region[cell] == most:
                        is_large = True

    # 2. All cells that were met are of it.
    size = most if is_large else min(tail, most)
    for k in range(tail):
        region[queue[k]] = size
    return size


@kernel
def sum_prices(row, col, rows, cols, board, tables, scratch):
    """Write totals: by each rule the sum of the faded prices of the cells just seen.

    `count_visible` has left these cells in `visible`.

    row, col  the cell that they are seen from
    """
    known_codes, counts, view = board
    _, closed, pockets, fade, rules = tables
    price, region, queue, totals = scratch
    _, _, sight, visible, _, radius = view
    lane, side = np.int64(sight[0]), 2 * radius + 1
    per_word, most = 64 // lane, pockets.shape[0] - 1
    lane_mask = ~np.uint64(0) >> np.uint64(64 - lane)
    totals[:] = 0
    word, place = 0, 0
    for i in range(side):
        bits = (visible[word] >> np.uint64(place)) & lane_mask
        word, place = (word + 1, 0) if place + lane == per_word * lane else (word, place + lane)
        first = (row + i - radius) * cols + col - radius
        while bits != np.uint64(0):
            j = np.int64(lowest(bits))
            bits &= bits - np.uint64(1)
            cell = first + j
            # A cell is seen from many others, so its price is kept until the board changes.
            if price[cell, 0] == 0:
                size = region[cell]
                if size == 0:
                    size = measure_region(cell, known_codes, rows, cols, most, region, queue)
                near, middle, far = counts[0, cell], counts[1, cell], counts[2, cell]
                for rule in range(len(rules)):
                    shut_in = closed[0, near, rule] + closed[1, middle, rule] + closed[2, far, rule]
                    price[cell, rule] = PRICE_UNIT + pockets[size, rule] + shut_in
            for rule in range(len(rules)):
                totals[rule] += np.int64(price[cell, rule]) * fade[i, j, rule]
