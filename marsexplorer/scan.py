"""A scan makes every cell that the lidar sees known (Koutras et al., eq. 4 and 5).

`scan` is one function of the world and the rover's cell, worked out in one of two ways. Where a row
of the lidar's window fits into 16 bits (radius up to 7), the window is four words, which stay in
registers. Larger windows go through `find_visible`.

Which one it is stands in the shape of `sight` (`sight_of`): numba compiles a kernel for each number
of dimensions, and leaves out the branch of the other. Hardly anybody plays with a radius above 7,
and its way takes longest to compile.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.bitmap import COLS, RADIUS, ROWS, WORDS
from marsexplorer.compiled import inlined, kernel, lowest, merged, popcount
from marsexplorer.config import FREE
from marsexplorer.lidar import HEADER, NARROW, ONE, find_visible, sight_table


def sight_of(radius: int) -> NDArray[np.uint64]:
    """A world's own line-of-sight table, with scratch.

    Returns:
        A copy of `lidar.sight_table`: uint64[n] up to a radius of 7 cells, uint64[1, n] above.
    """
    table = sight_table(radius).copy()
    return table if table[0] == NARROW else table.reshape(1, -1)


@kernel
def scan(state, obstacles, codes, cbase, sight, rules, row, col):
    """Make every cell the lidar sees from (row, col) known; return how many were new.

    state      uint64[:] of records, see rules.py; `obstacles` is the place of the world's first row
               of obstacles
    codes      uint8[:], written at the new cells; `cbase` is the place of the world's first code
    sight      `sight_of` the radius, whose scratch is written
    rules      int64[:], see `rules.rules_of`
    """
    # With margins of `radius` all round, the window's first row and column in the padded map have
    # the rover's own numbers. Places are unsigned: compiled code would otherwise test each for
    # counting from the end.
    radius, words, cols = np.uint64(rules[RADIUS]), np.uint64(rules[WORDS]), np.uint64(rules[COLS])
    row, col = np.uint64(row), np.uint64(col)
    size = (np.uint64(rules[ROWS]) + radius + radius) * words
    first = np.uint64(obstacles) + row * words + (col >> np.uint64(6))
    corner = np.uint64(cbase) + row * cols + col - radius * cols - radius
    known_rows, shift = first + size, col & np.uint64(63)
    if sight.ndim == 1:
        new = scan_narrow(
            state, first, known_rows, words, codes, corner, cols, sight, radius, shift
        )
    else:
        new = scan_wide(
            state, first, known_rows, words, codes, corner, cols, sight[0], radius, shift
        )
    return new


@inlined
def cut(bits, at, shift, back, straddles):
    """The bits of a row from bit `shift` of bits[at] on.

    shift and back = 63 - shift are uint64, 0..63
    """
    window = bits[at] >> shift
    if straddles:
        window |= (bits[at + ONE] << ONE) << back
    return window


@inlined
def write_row(state, at, known_at, codes, cell, bits, shift, back, straddles):
    """Make the cells of one window row (`bits`) known and write their codes.

    The codes are 1 where free, 1 + 2 where blocked.
    """
    state[known_at] |= bits << shift
    if straddles:
        state[known_at + ONE] |= (bits >> ONE) >> back
    blocked = cut(state, at, shift, back, straddles)
    while bits != np.uint64(0):
        c = lowest(bits)
        bits &= bits - ONE
        codes[cell + c] = np.uint8(FREE) + (np.uint8((blocked >> c) & ONE) << np.uint8(1))


@merged
def scan_narrow(state, obstacles, known_rows, words, codes, corner, cols, sight, radius, shift):
    """Do `scan` for windows of four words, four rows of 16 bits in each."""
    side = radius + radius + ONE
    row_mask = (ONE << side) - ONE
    straddles, back = shift + side > np.uint64(64), np.uint64(63) - shift

    # 1. Keep what is unknown and within the radius.
    a, b, c, d = np.uint64(0), np.uint64(0), np.uint64(0), np.uint64(0)
    for i in range(16):
        r = np.uint64(i)
        if r < side:
            unknown = (
                cut(state, known_rows + r * words, shift, back, straddles) ^ row_mask
            ) & row_mask
            place = (r & np.uint64(3)) << np.uint64(4)
            if i < 4:
                a |= unknown << place
            elif i < 8:
                b |= unknown << place
            elif i < 12:
                c |= unknown << place
            else:
                d |= unknown << place
    a, b = a & sight[HEADER], b & sight[HEADER + 1]
    c, d = c & sight[HEADER + 2], d & sight[HEADER + 3]
    if a | b | c | d == np.uint64(0):
        return np.int64(0)

    # 2. Clear the shadow of every obstacle in the window.
    for i in range(16):
        r = np.uint64(i)
        if r < side:
            window = cut(state, obstacles + r * words, shift, back, straddles) & row_mask
            while window != np.uint64(0):
                shadow = np.uint64(HEADER + 8) + ((r * side + lowest(window)) << np.uint64(2))
                window &= window - ONE
                a &= ~sight[shadow]
                b &= ~sight[shadow + np.uint64(1)]
                c &= ~sight[shadow + np.uint64(2)]
                d &= ~sight[shadow + np.uint64(3)]

    # 3. What is left is seen and new: write it row by row.
    for k in range(4):
        seen = a if k == 0 else b if k == 1 else c if k == 2 else d
        while seen != np.uint64(0):
            place = lowest(seen) & ~np.uint64(15)
            bits = (seen >> place) & np.uint64(0xFFFF)
            seen &= ~(np.uint64(0xFFFF) << place)
            r = np.uint64(4 * k) + (place >> np.uint64(4))
            write_row(
                state,
                obstacles + r * words,
                known_rows + r * words,
                codes,
                corner + r * cols,
                bits,
                shift,
                back,
                straddles,
            )
    return np.int64(popcount(a) + popcount(b) + popcount(c) + popcount(d))


@merged
def scan_wide(state, obstacles, known_rows, words, codes, corner, cols, sight, radius, shift):
    """Do `scan` for windows of any size."""
    lane, masks = sight[0], np.int64(sight[1])
    straddles, back = shift + radius + radius + ONE > np.uint64(64), np.uint64(63) - shift

    # 1. Find the cells that are seen and were unknown. The map holds what is known, hence the flip.
    visible = HEADER + masks
    new = find_visible(
        state,
        np.int64(known_rows),
        ~np.uint64(0),
        state,
        np.int64(obstacles),
        np.int64(words),
        np.int64(shift),
        np.int64(radius),
        sight,
        sight,
        visible,
    )

    # 2. Write them row by row: a word of the window holds 64 / lane of them.
    lane_mask = (ONE << lane) - ONE if lane < np.uint64(64) else ~np.uint64(0)
    for k in range(masks if new > 0 else 0):
        seen = sight[visible + k]
        while seen != np.uint64(0):
            place = lowest(seen) // lane * lane
            bits = (seen >> place) & lane_mask
            seen &= ~(lane_mask << place)
            r = np.uint64(k) * (np.uint64(64) // lane) + place // lane
            write_row(
                state,
                obstacles + r * words,
                known_rows + r * words,
                codes,
                corner + r * cols,
                bits,
                shift,
                back,
                straddles,
            )
    return new
