"""Prices of unknown cells: a cell counts more the more closed in it is, since the rover would have to come back for it.

The price of an unknown cell u, in whole units of 1 / PRICE_UNIT, each term rounded by itself:

    1 + sum over k of weight_k closed_k(u)^power_k + pocket e^(-s(u) / pocket_cells)

closed_k(u) is the share of the square of half side h_k round u that is known or off the grid, and s(u) the number of cells of
the unknown region of u, cells joined by edges and corners. A view is priced as the sum of the prices of the unknown cells
that the lidar is expected to show (`visibility.count_visible`), each times e^(-fade (|u - v| - 1)) in units of 1 / FADE_UNIT.
All sums are of whole numbers, so they depend neither on the order of the cells nor on how the terrain is mirrored.

Kernels take, of one board, the tuples

    board    known     uint8[n], the codes as they were kept, NO_CODE before the first
             counts    int16[SQUARES, n], the unknown cells in each square round each cell
             view      of `visibility`, with the bitboards as they were kept
    tables   half_sides  int64[SQUARES], cells
             closed      int32[SQUARES, most + 1], what a square adds to a price, by its number of unknown cells
             pockets     int32[cells], what a region adds by its number of cells; regions of as many cells or more add nothing
             fade        int32[2 radius + 1, 2 radius + 1], by the window cell
    scratch  price     int32[n], 0 where a cell has not been priced since `forget_prices`
             region    int32[n], 0 where a region has not been measured since then
             queue     int32[n]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel, lowest
from marsexplorer.config import OBSTACLE, UNKNOWN
from marsexplorer.policies.kernels.visibility import VisibilityMap, word_and_bit

PRICE_UNIT = 1024
"""The price of an unknown cell in the open."""
FADE_UNIT = 64
"""The fade of a cell that is seen from next to it."""
SQUARES = 3
"""Squares of which the unknown cells are counted."""
NO_CODE = 255
"""What is kept of a cell before the first board."""
TUNED_RADIUS = 6
"""The sensor radius (cells) for which parameters are given; those in cells are scaled for other radii."""


Triple = tuple[float, float, float]
"""A number for each square."""


@dataclass(frozen=True)
class PriceParameters:
    """What unknown cells are priced by, for a sensor radius of TUNED_RADIUS; the module's header has the formula.

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
        if min(*self.weights, self.pocket, self.fade) < 0 or min(*self.powers, self.pocket_cells) <= 0:
            raise ValueError(f"weights, pocket and fade must be 0 or more, powers and pocket_cells above 0, got {self}")


class PriceTables:
    """What kernels look up of prices.

    arrays    `tables` of the module's header
    highest   the highest product of a price and a fade
    """

    def __init__(self, parameters: PriceParameters, radius: int) -> None:
        scale = radius / TUNED_RADIUS
        half_sides = np.array([max(1, round(scale * half)) for half in (2, 6, 12)])
        most = int(2 * half_sides[-1] + 1) ** 2
        closed = np.zeros((SQUARES, most + 1), np.int32)
        for k, (half, weight, power) in enumerate(zip(half_sides, parameters.weights, parameters.powers, strict=True)):
            area = int(2 * half + 1) ** 2
            closed[k, : area + 1] = np.rint(PRICE_UNIT * weight * (1 - np.arange(area + 1) / area) ** power)
        # The longest region that still adds something: afterwards the term rounds to 0, so sizes need not be counted on.
        cells = parameters.pocket_cells * scale**2
        longest = max(0, int(cells * np.log(max(1.0, 2 * PRICE_UNIT * parameters.pocket))))
        pockets = np.rint(PRICE_UNIT * parameters.pocket * np.exp(-np.arange(longest + 2) / cells)).astype(np.int32)
        away = np.hypot(*np.mgrid[-radius : radius + 1, -radius : radius + 1])
        fade = np.rint(FADE_UNIT * np.exp(-parameters.fade / scale * np.maximum(away - 1, 0))).astype(np.int32)
        self.arrays = (half_sides, closed, pockets, fade)
        self.highest = int((PRICE_UNIT + closed.max(axis=1).sum() + pockets.max()) * fade.max())


class PricedBoard:
    """What is kept of one board of a shape from move to move, and scratch arrays.

    board, scratch   of the module's header
    changed_columns  int64[rows, 2], see `update_board`
    """

    def __init__(self, shape: tuple[int, ...], radius: int) -> None:
        rows, cols = shape
        self.shape, self.changed_columns = (rows, cols), np.zeros((rows, 2), np.int64)
        known, counts = np.full(rows * cols, NO_CODE, np.uint8), np.zeros((SQUARES, rows * cols), np.int16)
        self.board = (known, counts, VisibilityMap(shape, radius).view)
        self.scratch = price_scratch(rows * cols)


def price_scratch(cells: int) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """Return `scratch` of the module's header for boards of so many cells."""
    return np.zeros(cells, np.int32), np.zeros(cells, np.int32), np.zeros(cells, np.int32)


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
    """Bring what is kept of a board up to date with codes uint8[rows, cols]; return how many cells are unknown.

    half_sides       int64[k], of the k squares that are counted; none for a board without counts
    changed_columns  int64[rows, 2], written: the first and the last column of each row in which a cell became known, became
                     unknown, or became an obstacle; (cols, -1) where none did
    """
    known, counts, view = board
    unknown, blocked, _, _, stride, radius = view
    rows, cols = codes.shape
    left = 0
    for row in range(rows):
        # 1. Most rows are as they were; this loop has no branch, so that it takes a few instructions for many cells.
        first, differs = row * cols, np.uint8(0)
        for col in range(cols):
            left += codes[row, col] == UNKNOWN
            differs |= codes[row, col] ^ known[first + col]
        changed_columns[row, 0], changed_columns[row, 1] = cols, -1
        if differs == 0:
            continue

        # 2. Correct the bitboards and the counts. From rover to free, or the other way round, changes none of them.
        for col in range(cols):
            code = codes[row, col]
            if known[first + col] == code:
                continue
            known[first + col] = code
            word, bit = word_and_bit(row, col, stride, radius)
            was_unknown, was_blocked = unknown[word] & bit != 0, blocked[word] & bit != 0
            if was_unknown != (code == UNKNOWN):
                unknown[word] ^= bit
                count_in_squares(counts, half_sides, row, col, rows, cols, -1 if was_unknown else 1)
            elif was_blocked == (code == OBSTACLE):
                continue
            if was_blocked != (code == OBSTACLE):
                blocked[word] ^= bit
            changed_columns[row, 0], changed_columns[row, 1] = min(changed_columns[row, 0], col), col
    return left


@inlined
def forget_prices(scratch):
    """Begin with the prices of a changed board."""
    price, region, _ = scratch
    price[:] = 0
    region[:] = 0


@kernel
def measure_region(start, known, rows, cols, most, region, queue):
    """Return the number of cells of an unknown cell's region, at most `most`, and keep it for the cells that were met."""
    # 1. Flood from the cell, until the region has ended, or is large, or turns out to be one that was found large before.
    queue[0] = start
    region[start] = -1
    head, tail, is_large = 0, 1, False
    while head < tail and tail < most and not is_large:
        row = queue[head] // cols
        col = queue[head] - row * cols
        head += 1
        for r in range(max(0, row - 1), min(rows, row + 2)):
            for cell in range(r * cols + max(0, col - 1), r * cols + min(cols, col + 2)):
                if known[cell] == UNKNOWN:
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
    """Return the sum of faded prices of the cells that `count_visible` has just left in `visible`, looking from (row, col)."""
    known, counts, view = board
    half_sides, closed, pockets, fade = tables
    price, region, queue = scratch
    _, _, sight, visible, _, radius = view
    lane, words = np.int64(sight[0]), np.int64(sight[1])
    per_word, most = 64 // lane, pockets.shape[0] - 1
    total = np.int64(0)
    for k in range(words):
        bits = visible[k]
        while bits != np.uint64(0):
            at = np.int64(lowest(bits))
            bits &= bits - np.uint64(1)
            i, j = k * per_word + at // lane, at % lane
            cell = (row + i - radius) * cols + col + j - radius
            # A cell is seen from many others, so its price is kept until the board changes.
            if price[cell] == 0:
                size = region[cell] if region[cell] != 0 else measure_region(cell, known, rows, cols, most, region, queue)
                found = PRICE_UNIT + pockets[size]
                for square in range(half_sides.shape[0]):
                    found += closed[square, counts[square, cell]]
                price[cell] = found
            total += np.int64(price[cell]) * fade[i, j]
    return total
