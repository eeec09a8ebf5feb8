"""How many unknown cells the lidar is expected to show from a known cell.

Line of sight is `lidar.find_visible` (eq. 4 of Koutras et al. 2021). Known obstacles block; unknown
cells are taken to be transparent.

A map is held as rows of bits with a margin of `radius` cells on every side that is neither unknown
nor blocked, so a window needs no bounds test; grid cell (row, col) is bit col + radius of padded
row row + radius. Kernels take a view, the tuple

    unknown, blocked   uint64[(rows + 2 radius) * stride], see `bitboard_words`
    sight              `lidar.sight_table(radius)`, read only
    visible            uint64[words of a window], scratch: what the last look showed
    stride, radius     words of a row; cells
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel, read_only
from marsexplorer.config import OBSTACLE, UNKNOWN
from marsexplorer.lidar import ONE, find_visible, row_words, sight_table

Words = NDArray[np.uint64]
View = tuple[Words, Words, Words, Words, int, int]
"""(unknown, blocked, sight, visible, stride, radius)."""


def bitboard_words(rows: int, cols: int, radius: int) -> int:
    """The uint64 words of `unknown` and of `blocked`."""
    return (rows + 2 * radius) * row_words(cols, radius)


@inlined
def word_and_bit(row, col, stride, radius):
    """The index of a grid cell's word in a bitboard, and its bit as a uint64 mask."""
    bit = col + radius
    return (row + radius) * stride + (bit >> 6), ONE << np.uint64(bit & 63)


@kernel
def fill_bitboards(codes, view):
    """Write codes uint8[rows, cols] into the bitboards of a view."""
    unknown, blocked, _, _, stride, radius = view
    unknown[:] = np.uint64(0)
    blocked[:] = np.uint64(0)
    for row in range(codes.shape[0]):
        for col in range(codes.shape[1]):
            at, bit = word_and_bit(row, col, stride, radius)
            if codes[row, col] == UNKNOWN:
                unknown[at] |= bit
            elif codes[row, col] == OBSTACLE:
                blocked[at] |= bit


@kernel
def count_visible(view, row, col):
    """The number of unknown cells that (row, col) is expected to show.

    They are left as window bits in `visible`.
    """
    unknown, blocked, sight, visible, stride, radius = view
    # The window begins `radius` rows above the cell, in the padded map at the cell's own row.
    first = row * stride
    return find_visible(
        unknown, first, np.uint64(0), blocked, first, stride, col, radius, sight, visible, 0
    )


class VisibilityMap:
    """The bitboards and tables of one grid shape and radius, reused from move to move.

    view   the argument of this module's kernels
    """

    def __init__(self, shape: tuple[int, ...], radius: int) -> None:
        rows, cols = shape
        self.shape, self.radius = (rows, cols), radius
        words, sight = bitboard_words(rows, cols, radius), sight_table(radius)
        scratch = np.zeros(int(sight[1]), np.uint64)
        self.view: View = (
            np.zeros(words, np.uint64),
            np.zeros(words, np.uint64),
            sight,
            scratch,
            row_words(cols, radius),
            radius,
        )

    def fill(self, codes: NDArray[np.uint8]) -> None:
        """Copy codes uint8[rows, cols] into the bitboards."""
        fill_bitboards(read_only(codes), self.view)

    def expected_discoveries(self, row: int, col: int) -> int:
        """The number of unknown cells expected to be seen from (row, col)."""
        return int(count_visible(self.view, row, col))
