"""Terrains as rows of bits: their layout, rectangles, and connected cells.

A terrain is stored as `words` uint64 a row, with a margin of `radius` bits and rows all round,
lowest bit west: a set bit is an obstacle. `shape` is the int64 array of `shape_of`; `base` is the
index of a terrain's first word.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel
from marsexplorer.config import ALL_LEVELS, BUILDING, CAVE, EnvConfig
from marsexplorer.lidar import row_words

ROWS, COLS, RADIUS, WORDS, TOPOLOGY, MORPHOLOGY, TARGET, GENERATOR, SHAPE = range(9)
"""Places in the int64 array of `shape_of`."""


def shape_of(config: EnvConfig) -> NDArray[np.int64]:
    """The int64[8] that compiled code draws terrains from; see ROWS..GENERATOR.

    TARGET is the fewest cells of a drawn terrain that can be discovered: beta of them on the
    paper's levels, half of them in a cave (which could otherwise be a small hole), and any number
    in a building.
    """
    level = ALL_LEVELS[config.level]
    least = {BUILDING: 0, CAVE: (config.n + 1) // 2}.get(level.generator, config.target)
    words = row_words(config.cols, config.sensor_radius)
    sizes = (config.rows, config.cols, config.sensor_radius, words)
    return np.array([*sizes, level.topology, level.morphology, least, level.generator], np.int64)


@inlined
def fill_rectangle(bits, base, shape, top, left, height, width):
    """Set the part of a rectangle that lies inside the grid; width is at most 63."""
    radius, words = shape[RADIUS], shape[WORDS]
    bottom, right = min(top + height, shape[ROWS]), min(left + width, shape[COLS])
    top, left = max(top, 0), max(left, 0)
    bit = left + radius
    shift = np.uint64(bit & 63)
    run = (np.uint64(1) << np.uint64(max(right - left, 0))) - np.uint64(1)
    low, high = run << shift, (run >> np.uint64(1)) >> (np.uint64(63) - shift)
    for row in range(top, bottom):
        at = base + (row + radius) * words + (bit >> 6)
        bits[at] |= low
        if high != np.uint64(0):
            bits[at + 1] |= high


@inlined
def fill_runs(reached, free):
    """The free bits of a word that connect, along the word, with a reached bit."""
    # 1. Nearly always each run of free bits has a reached one, and all are connected. A one added
    #    to the first bit of each run is carried through the run, and out of it, unless a reached
    #    bit, which is left out of the sum, takes it up. What is carried out lands on a bit that is
    #    not free, or is lost at the end of the word, which makes the sum too small. No row waits
    #    for the row before then, since this branch is foreseen.
    starts = free & ~(free << np.uint64(1))
    carried = (free & ~reached) + starts
    if carried & ~free == np.uint64(0) and carried >= starts:
        return free

    # 2. Else a Kogge-Stone fill: after the round with step s, every bit has spread over 2 s - 1
    #    free bits to both sides, so six rounds cover a word. `east` and `west` hold where a whole
    #    stretch of s free bits ends, so nothing jumps over an obstacle.
    for step in (1, 2, 4, 8, 16, 32):
        by = np.uint64(step)
        if step == 1:
            east, west = free, free
            up, down = reached, reached
        up |= east & (up << by)
        down |= west & (down >> by)
        east &= east << by
        west &= west >> by
    return up | down


@inlined
def sweep_row(bits, base, reach, at, above, free_mask, words):
    """Grow the reached part of a row from a neighbouring row; return whether it grew.

    The row is reach[at:], its neighbour reach[above:].
    """
    grew = False
    carry = np.uint64(0)

    # 1. From west to east: what lies under reached cells, and what runs on from the word before.
    for word in range(words):
        free = free_mask[word] & ~bits[base + word]
        old = reach[at + word]
        new = fill_runs((old | reach[above + word] | carry) & free, free)
        carry = new >> np.uint64(63)
        reach[at + word] = new
        grew |= new != old

    # 2. Back from east to west: what runs on into the word before.
    for word in range(words - 2, -1, -1):
        free = free_mask[word] & ~bits[base + word]
        old = reach[at + word]
        new = fill_runs((old | (reach[at + word + 1] << np.uint64(63))) & free, free)
        reach[at + word] = new
        grew |= new != old
    return grew


@kernel
def flood(bits, base, reach, offset, shape, masks, row, col):
    """Write the cells connected to a free cell into reach, as rows of bits.

    The rows just above and below the grid are cleared.

    reach  as large as the rows of bits, `offset` words after the place that the bits have in theirs
    masks  uint64[words], see `row_masks`
    """
    rows, radius, words = shape[ROWS], shape[RADIUS], shape[WORDS]
    first, bit = base + radius * words, col + radius

    # 1. Everything is reached from the cell.
    for at in range(first - words + offset, first + (rows + 1) * words + offset):
        reach[at] = np.uint64(0)
    reach[first + row * words + offset + (bit >> 6)] = np.uint64(1) << np.uint64(bit & 63)

    # 2. A row at a time: down the grid, then up, until neither reaches anything more. Above row 0
    #    there is nothing, so from there the first way up is made only when something was reached
    #    below. One loop makes both ways, so that `sweep_row` is compiled into it once; `at` begins
    #    one step before the first row of a way.
    at, step, must_turn = first - words, words, row > 0
    while True:
        grew = False
        for _ in range(rows):
            at += step
            grew |= sweep_row(bits, at, reach, at + offset, at + offset - step, masks, words)
        if not (grew or must_turn):
            break
        at, step, must_turn = at + step, -step, False


def row_masks(config: EnvConfig) -> NDArray[np.uint64]:
    """The bits of a row that are cells of the grid: uint64[words]."""
    words = row_words(config.cols, config.sensor_radius)
    cells = (1 << config.cols) - 1 << config.sensor_radius
    return np.array([cells >> 64 * word & 2**64 - 1 for word in range(words)], np.uint64)


def bitmap_words(config: EnvConfig) -> int:
    """How many uint64 words a terrain takes."""
    return (config.rows + 2 * config.sensor_radius) * row_words(config.cols, config.sensor_radius)


def pack(cells: NDArray[np.bool_], config: EnvConfig) -> NDArray[np.uint64]:
    """Pack bool[rows, cols] into rows of bits with margins."""
    radius, words = config.sensor_radius, row_words(config.cols, config.sensor_radius)
    wide = np.zeros((config.rows + 2 * radius, words * 64), np.uint8)
    wide[radius : radius + config.rows, radius : radius + config.cols] = cells
    return np.packbits(wide, axis=1, bitorder="little").view("<u8").astype(np.uint64).reshape(-1)


def unpack(bits: NDArray[np.uint64], config: EnvConfig) -> NDArray[np.bool_]:
    """Unpack rows of bits with margins into bool[rows, cols]."""
    radius, words = config.sensor_radius, row_words(config.cols, config.sensor_radius)
    stacked = bits.reshape(config.rows + 2 * radius, words)[radius : radius + config.rows]
    octets = np.ascontiguousarray(stacked).astype("<u8").view(np.uint8)
    flat = np.unpackbits(octets, axis=1, bitorder="little")
    return flat[:, radius : radius + config.cols].astype(np.bool_)
