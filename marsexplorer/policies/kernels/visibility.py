"""How many unknown cells the lidar would show from a cell, judged by the map as known so far.

Line of sight is lidar.py's (eq. 4 of Koutras et al. 2021). Known obstacles block; unknown cells are taken to be
transparent.

A map is held as rows of bits with a margin of `radius` cells on every side that is neither unknown nor blocked, so a
window needs no bounds test; grid cell (row, col) is bit col + radius of padded row row + radius:

    unknown, blocked   uint64[rows + 2 radius, words of a row]

What is seen is then unknown & disc & ~OR(shadow of every obstacle in the window): a few words and no rays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel, lowest, popcount
from marsexplorer.config import OBSTACLE, UNKNOWN
from marsexplorer.lidar import HEADER, sight_table

Words = NDArray[np.uint64]
U = np.uint64
ONE = np.uint64(1)
LOW6 = np.uint64(63)
SIX = np.uint64(6)


def board_shape(rows: int, cols: int, radius: int) -> tuple[int, int]:
    """Return the shape of `unknown` and `blocked`; one spare word lets every window straddle two words."""
    return rows + 2 * radius, (cols + 2 * radius + 63) // 64 + 1


@kernel
def fill_boards(codes, radius, unknown, blocked):
    """Write one grid, codes uint8[rows, cols], into its bit boards."""
    unknown[:] = U(0)
    blocked[:] = U(0)
    for row in range(codes.shape[0]):
        for col in range(codes.shape[1]):
            bit = U(col + radius)
            if codes[row, col] == UNKNOWN:
                unknown[row + radius, bit >> SIX] |= ONE << (bit & LOW6)
            elif codes[row, col] == OBSTACLE:
                blocked[row + radius, bit >> SIX] |= ONE << (bit & LOW6)


@inlined
def cut(board, row, word, shift, mask):
    """Return a window's bits of one padded row: two neighbouring words shifted together."""
    return ((board[row, word] >> shift) | ((board[row, word + ONE] << ONE) << (LOW6 - shift))) & mask


@kernel
def look(unknown, blocked, row, col, radius, sight, seen):
    """Return how many unknown cells are visible from grid cell (row, col), left as window bits in seen.

    sight  `lidar.sight_table(radius)`, read only
    seen   uint64[words of a window or more], scratch
    """
    side = 2 * radius + 1
    lane, words = np.int64(sight[0]), np.int64(sight[1])
    per_word = 64 // lane
    mask = (ONE << U(side)) - ONE
    word, shift = U(col) >> SIX, U(col) & LOW6
    anything = U(0)
    i = 0
    for w in range(words):
        bits = U(0)
        for j in range(min(per_word, side - i)):
            bits |= cut(unknown, U(row + i + j), word, shift, mask) << U(j * lane)
        i += per_word
        bits &= sight[HEADER + w]
        seen[w] = bits
        anything |= bits
    if anything == U(0):
        return 0
    shadows = HEADER + 3 * words
    for i in range(side):
        bits = cut(blocked, U(row + i), word, shift, mask)
        while bits != U(0):
            shadow = U(shadows + i * side * words) + lowest(bits) * U(words)
            bits &= bits - ONE
            for w in range(words):
                seen[w] &= ~sight[shadow + U(w)]
    count = U(0)
    for w in range(words):
        count += popcount(seen[w])
    return np.int64(count)


@kernel
def learn(unknown, row, col, radius, sight, seen):
    """Make the cells that `look` left in seen known: clear their bits in unknown."""
    side = 2 * radius + 1
    lane, words = np.int64(sight[0]), np.int64(sight[1])
    per_word = 64 // lane
    mask = (ONE << U(side)) - ONE
    word, shift = U(col) >> SIX, U(col) & LOW6
    i = 0
    for w in range(words):
        for j in range(min(per_word, side - i)):
            bits = (seen[w] >> U(j * lane)) & mask
            if bits != U(0):
                unknown[row + i + j, word] &= ~(bits << shift)
                unknown[row + i + j, word + ONE] &= ~((bits >> ONE) >> (LOW6 - shift))
        i += per_word


class Outlook:
    """The bit boards and tables of one grid shape and radius, reused from move to move."""

    def __init__(self, shape: tuple[int, ...], radius: int) -> None:
        rows, cols = shape
        self.shape, self.radius = (rows, cols), radius
        self.sight: Words = sight_table(radius)
        self.unknown: Words = np.zeros(board_shape(rows, cols, radius), np.uint64)
        self.blocked: Words = np.zeros_like(self.unknown)
        self.seen: Words = np.zeros(int(self.sight[1]), np.uint64)

    def fill(self, codes: NDArray[np.uint8]) -> None:
        """Take a grid, codes uint8[rows, cols]."""
        fill_boards(codes, self.radius, self.unknown, self.blocked)

    def gain(self, row: int, col: int) -> int:
        """Return the number of unknown cells expected to be seen from (row, col)."""
        return int(look(self.unknown, self.blocked, row, col, self.radius, self.sight, self.seen))
