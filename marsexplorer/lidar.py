"""Line of sight, exactly: which cells a lidar sees, as bit masks that compiled code can combine.

A cell q is seen from p when the Euclidean distance of their centres is at most the radius and the open segment between
the centres crosses the interior of no obstacle other than q (Koutras et al. 2021, eq. 4). Touching a corner does not
block. With p at the origin, q at (dr, dc) and an obstacle at (br, bc), everything scaled to whole numbers, the line through
the centres crosses the interior of the obstacle's square when its corners lie strictly on both sides,
2 |dr bc - dc br| < |dr| + |dc|; the chord lies between the centres when the obstacle is in their bounding box. So sight
between free cells is symmetric.

A window is the square of 2 radius + 1 cells a side round the rover, stored as rows of bits: row i of the window occupies
`lane` bits (16, 32 or 64) of word i // per_word, lowest bit west. The table of a radius is one uint64 array:

    [0]                         lane
    [1]                         words in a window
    [2 : 2 + words]             the disc: cells within the radius
    [2 + words : 2 + 3 words]   room for the compiled scan to work in
    [2 + 3 words : ]            for each window cell, row-major, the window of cells it hides when it is an obstacle
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined

HEADER = 2


def hides(br: int, bc: int, dr: int, dc: int) -> bool:
    """Return whether an obstacle at (br, bc) blocks the sight from (0, 0) to (dr, dc); offsets in cells."""
    if (br, bc) in ((0, 0), (dr, dc)):
        return False
    if not (min(0, dr) <= br <= max(0, dr) and min(0, dc) <= bc <= max(0, dc)):
        return False
    return 2 * abs(dr * bc - dc * br) < abs(dr) + abs(dc)


def window_words(radius: int) -> tuple[int, int]:
    """Return (lane, words): bits a window row takes and uint64 words a window takes, for a radius of 1..31 cells."""
    side = 2 * radius + 1
    lane = 16 if side <= 16 else 32 if side <= 32 else 64
    return lane, -(-side // (64 // lane))


@cache
def sight_table(radius: int) -> NDArray[np.uint64]:
    """Return the disc and shadow masks of a radius (1..31 cells), laid out as the module's header says."""
    side, (lane, words) = 2 * radius + 1, window_words(radius)
    per_word = 64 // lane
    offsets = range(-radius, radius + 1)
    disc = [(dr, dc) for dr in offsets for dc in offsets if dr * dr + dc * dc <= radius * radius]
    table = [0] * (HEADER + 3 * words + side * side * words)
    table[0], table[1] = lane, words

    def mark(base: int, dr: int, dc: int) -> None:
        row = dr + radius
        table[base + row // per_word] |= 1 << (row % per_word * lane + dc + radius)

    for dr, dc in disc:
        mark(HEADER, dr, dc)
        for br in range(min(0, dr), max(0, dr) + 1):
            for bc in range(min(0, dc), max(0, dc) + 1):
                if hides(br, bc, dr, dc):
                    mark(HEADER + 3 * words + ((br + radius) * side + bc + radius) * words, dr, dc)
    return np.array(table, np.uint64)


@inlined
def window_row(bits, base, col, side):  # uint64[:], uint64, uint64, uint64
    """Return `side` bits of the row of words at bits[base:], starting at bit `col`; higher bits are not cleared."""
    at = base + (col >> np.uint64(6))
    shift = col & np.uint64(63)
    found = bits[at] >> shift
    if shift + side > np.uint64(64):
        found |= bits[at + np.uint64(1)] << (np.uint64(64) - shift)
    return found
