"""Exact line of sight of a lidar, as bit masks that compiled code combines.

A cell q is seen from p when the Euclidean distance of their centres is at most the radius and the
open segment between the centres crosses the interior of no obstacle other than q (Koutras et al.
2021, eq. 4). Touching a corner does not block. With p at the origin, q at (dr, dc) and an obstacle
at (br, bc), everything scaled to whole numbers, the line through the centres crosses the interior
of the obstacle's square when its corners lie strictly on both sides, 2 |dr bc - dc br| < |dr| +
|dc|; the chord lies between the centres when the obstacle is in their bounding box. So sight
between free cells is symmetric.

A window is the square of 2 radius + 1 cells a side round the rover, stored as rows of bits: row i
of the window occupies `lane` bits (16, 32 or 64) of word i // per_word, lowest bit west; windows of
16-bit lanes have four words at every radius. The table of a radius is one uint64 array:

    [0]                         lane
    [1]                         words in a window
    [2 : 2 + words]             the disc: cells within the radius
    [2 + words : 2 + 2 words]   scratch for the compiled scan, which has a copy of the table for
                                each stack of worlds
    [2 + 2 words : ]            for each window cell, row-major, the window of cells it hides when
                                it is an obstacle

`find_visible` is the only line of sight of this package: the rules scan with it, and policies
estimate with it what a scan would show. Its maps are rows of bits with a margin of `radius` cells
all round, so that no window needs a bounds test.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, lowest, popcount

HEADER = 2
"""Words of a table before the disc."""

NARROW = 16
"""Bits of the narrowest lane, that of radii up to 7."""

ONE = np.uint64(1)


def hides(br: int, bc: int, dr: int, dc: int) -> bool:
    """Whether an obstacle at (br, bc) hides (dr, dc) from (0, 0); offsets in cells."""
    if (br, bc) in ((0, 0), (dr, dc)):
        return False
    if not (min(0, dr) <= br <= max(0, dr) and min(0, dc) <= bc <= max(0, dc)):
        return False
    return 2 * abs(dr * bc - dc * br) < abs(dr) + abs(dc)


def window_words(radius: int) -> tuple[int, int]:
    """(lane, words): bits of a window row and uint64 words of a window.

    radius  1..31 cells
    """
    side = 2 * radius + 1
    if side <= NARROW:
        return NARROW, 4
    lane = 32 if side <= 32 else 64
    return lane, -(-side // (64 // lane))


@cache
def sight_table(radius: int) -> NDArray[np.uint64]:
    """The disc and shadow masks of a radius (1..31 cells), laid out as above."""
    side, (lane, words) = 2 * radius + 1, window_words(radius)
    per_word = 64 // lane
    offsets = range(-radius, radius + 1)
    disc = [(dr, dc) for dr in offsets for dc in offsets if dr * dr + dc * dc <= radius * radius]
    table = [0] * (HEADER + 2 * words + side * side * words)
    table[0], table[1] = lane, words

    def mark(base: int, dr: int, dc: int) -> None:
        row = dr + radius
        table[base + row // per_word] |= 1 << (row % per_word * lane + dc + radius)

    for dr, dc in disc:
        mark(HEADER, dr, dc)
        for br in range(min(0, dr), max(0, dr) + 1):
            for bc in range(min(0, dc), max(0, dc) + 1):
                if hides(br, bc, dr, dc):
                    mark(HEADER + 2 * words + ((br + radius) * side + bc + radius) * words, dr, dc)
    return np.array(table, np.uint64)


def row_words(cols: int, radius: int) -> int:
    """The uint64 words of a row of `cols` bits with a margin at both ends.

    radius  bits of a margin
    """
    return (cols + 2 * radius + 63) // 64


@inlined
def window_row(bits, base, col, side):  # uint64[:], uint64, uint64, uint64
    """`side` bits of a row of words at bits[base:] from bit `col` on.

    Higher bits are not cleared.
    """
    at = base + (col >> np.uint64(6))
    shift = col & np.uint64(63)
    window = bits[at] >> shift
    if shift + side > np.uint64(64):
        window |= bits[at + ONE] << (np.uint64(64) - shift)
    return window


@inlined
def find_visible(
    unknown,
    unknown_at,
    flip,
    obstacles,
    obstacles_at,
    stride,
    col,
    radius,
    sight,
    visible,
    visible_at,
):
    """Write the unknown cells that the lidar sees; return their number (eq. 4).

    The window is written from visible[visible_at] on.

    unknown, unknown_at      uint64[:] and the place of the window's first row in it; bits that
                             differ from `flip` are unknown
    flip                     0 where a set bit means unknown, all ones where it means known
    obstacles, obstacles_at  uint64[:] and the place of the window's first row: a set bit is an
                             obstacle
    stride, col              words of a row; the window's first column, counted from the margin: the
                             rover's own column
    sight                    `sight_table(radius)`
    """
    lane, words = np.int64(sight[0]), np.int64(sight[1])
    side, per_word = 2 * radius + 1, 64 // lane
    row_mask = (ONE << np.uint64(side)) - ONE
    first, width = np.uint64(col), np.uint64(side)

    # 1. Cut the window out of the map, several of its rows to a word, and keep the unknown cells of
    #    the disc: what is known already cannot be discovered again, and what is farther than the
    #    radius is not seen.
    anything = np.uint64(0)
    i = 0
    for k in range(words):
        packed = np.uint64(0)
        for j in range(min(per_word, side - i)):
            window = window_row(unknown, np.uint64(unknown_at + (i + j) * stride), first, width)
            packed |= ((window ^ flip) & row_mask) << np.uint64(j * lane)
        i += per_word
        packed &= sight[HEADER + k]
        visible[visible_at + k] = packed
        anything |= packed

    # 2. Where nothing is unknown there is nothing to hide: most scans of a late episode end here.
    count = np.int64(0)
    if anything != np.uint64(0):
        # 3. Clear the shadow of every obstacle in the window. The shadows were computed exactly,
        #    once for the radius, so no ray is cast: a few words are combined for each obstacle.
        shadows = HEADER + 2 * words
        for i in range(side):
            window = window_row(obstacles, np.uint64(obstacles_at + i * stride), first, width)
            window &= row_mask
            while window != np.uint64(0):
                c = np.int64(lowest(window))
                window &= window - ONE
                shadow = shadows + (i * side + c) * words
                for k in range(words):
                    visible[visible_at + k] &= ~sight[shadow + k]

        # 4. What is left is seen.
        for k in range(words):
            count += np.int64(popcount(visible[visible_at + k]))
    return count
