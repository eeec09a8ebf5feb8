"""A solvable terrain from (configuration, seed): the same everywhere, for ever.

**Generator.** SplitMix64 as a counter (see `random_numbers`): with mix for `finalize` and G for
GAMMA, the key of draw d = 0, 1, ... of a seed is mix(mix(seed + G) + d), the k-th number (k = 1, 2,
...) of a draw is mix(key + k G), and a whole number below m is the product of its upper 32 bits
with m, shifted right by 32. The seed that follows a seed is mix(seed + G) >> 11.

**Draw.** Level `random` (section 3.2): max(1, round(12 n / 441)) rectangles, for each the height
(1..3), the width (1..3), the top row and the left column, so that it lies wholly inside. Levels
t-m-b (section 3.3): for each lattice point, rows and columns 3, 10, 17, ..., row by row, the shift
of the row and of the column (-t..t), the height and the width (1..2 for m = 1, 1..4 for m = 2); the
rectangle's top is the row - (height - 1) // 2, likewise its left, and what falls outside is cut.

**Solvable.** A draw counts when the start (0, 0) is free, all free cells are connected and at least
beta n cells can be discovered; otherwise the next draw is taken, up to 1,000. Every free cell can
be discovered then, and an obstacle exactly when a free cell shares an edge or, for radii above 1, a
corner with it: any longer line of sight to it enters through one of these.

**Buildings and caves.** Draws come from `generators` and count in the same way, with another number
of cells (`shape_of`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.bitmap import (
    COLS,
    GENERATOR,
    MORPHOLOGY,
    RADIUS,
    ROWS,
    TARGET,
    TOPOLOGY,
    WORDS,
    bitmap_words,
    fill_rectangle,
    flood,
    row_masks,
    shape_of,
    unpack,
)
from marsexplorer.compiled import inlined, kernel, popcount
from marsexplorer.config import BUILDING, MAP, RECTANGLES, EnvConfig, check_seed
from marsexplorer.generators import draw_building, draw_cave
from marsexplorer.random_numbers import finalize, numbered, numbered_below

MAX_DRAWS = 1000


@inlined
def following(seed):
    """The seed, uint64, that follows a seed."""
    return numbered(np.uint64(seed), 1) >> np.uint64(11)


@kernel
def next_state(seed):
    """`following`, callable from Python."""
    return following(seed)


@inlined
def draw_terrain(bits, base, shape, key):
    """Draw one terrain into cleared rows of bits.

    key  uint64, names the stream; each of its numbers has one use
    """
    rows, cols, k = shape[ROWS], shape[COLS], 0

    # 1. Level random (section 3.2): rectangles anywhere, round(12 n / 441) of them in whole
    #    numbers.
    if shape[TOPOLOGY] == 0:
        count = max(1, (24 * rows * cols + 441) // 882)
        for _ in range(count):
            height = 1 + numbered_below(key, k + 1, 3)
            width = 1 + numbered_below(key, k + 2, 3)
            top = numbered_below(key, k + 3, rows - height + 1)
            left = numbered_below(key, k + 4, cols - width + 1)
            fill_rectangle(bits, base, shape, top, left, height, width)
            k += 4
        return

    # 2. Levels t-m-b (section 3.3): one rectangle for each point of a lattice, shifted by up to
    #    d_t.
    shift, sides = shape[TOPOLOGY], 2 if shape[MORPHOLOGY] == 1 else 4
    for at_row in range(3, rows, 7):
        for at_col in range(3, cols, 7):
            row = at_row + numbered_below(key, k + 1, 2 * shift + 1) - shift
            col = at_col + numbered_below(key, k + 2, 2 * shift + 1) - shift
            height = 1 + numbered_below(key, k + 3, sides)
            width = 1 + numbered_below(key, k + 4, sides)
            fill_rectangle(
                bits, base, shape, row - (height - 1) // 2, col - (width - 1) // 2, height, width
            )
            k += 4


@inlined
def reached_or_adjacent(reach, at, word, words, corners):
    """The bits of one word of a row that are reached or next to a reached cell.

    Next to: sharing an edge, or with `corners` also a corner.
    """
    here = at + word
    vertical = reach[here - words] | reach[here + words]
    across = reach[here] | vertical if corners else reach[here]
    cells = reach[here] | vertical | (across << np.uint64(1)) | (across >> np.uint64(1))
    if word > 0:
        across = reach[here - 1]
        if corners:
            across |= reach[here - 1 - words] | reach[here - 1 + words]
        cells |= across >> np.uint64(63)
    if word + 1 < words:
        across = reach[here + 1]
        if corners:
            across |= reach[here + 1 - words] | reach[here + 1 + words]
        cells |= across << np.uint64(63)
    return cells


@kernel
def is_solvable(bits, base, reach, offset, shape, masks):
    """Whether all free cells connect to a free (0, 0) and enough is discoverable.

    reach  scratch as large as the rows of bits, `offset` words after the place that the bits have
           in theirs
    masks  uint64[words], see `row_masks`
    """
    rows, radius, words = shape[ROWS], shape[RADIUS], shape[WORDS]
    first = base + radius * words

    # 1. The start must be free; what is connected to it is reached.
    if (bits[first + (radius >> 6)] >> np.uint64(radius & 63)) & np.uint64(1):
        return False
    flood(bits, base, reach, offset, shape, masks, 0, 0)

    # 2. Every free cell must be reached. Count what can be discovered: the free cells, and the
    #    obstacles next to one (for radii above 1 also those at a corner; see the module's header
    #    for why no others).
    seen = 0
    for row in range(rows):
        at = first + row * words
        for word in range(words):
            if reach[at + offset + word] != masks[word] & ~bits[at + word]:
                return False
            cells = reached_or_adjacent(reach, at + offset, word, words, radius > 1)
            seen += np.int64(popcount(cells & masks[word]))
    return seen >= shape[TARGET]


@kernel
def draw_solvable(bits, base, reach, offset, shape, masks, seed):
    """Draw terrains into bits[base:] until one is solvable; return their number.

    0 means that MAX_DRAWS were not enough.

    reach, offset  see `is_solvable`; seed: uint64
    """
    size = (shape[ROWS] + 2 * shape[RADIUS]) * shape[WORDS]
    start = numbered(np.uint64(seed), 1)
    for attempt in range(MAX_DRAWS):
        for at in range(base, base + size):
            bits[at] = np.uint64(0)
        draw_terrain(bits, base, shape, finalize(start + np.uint64(attempt)))
        if is_solvable(bits, base, reach, offset, shape, masks):
            return attempt + 1
    return 0


@kernel
def draw_solvable_alone(bits, reach, shape, masks, seed):
    """`draw_solvable` for one terrain in arrays of its own."""
    return draw_solvable(bits, 0, reach, 0, shape, masks, seed)


@kernel
def draw_other(bits, reach, shape, masks, seed):
    """`draw_solvable_alone` for a building or a cave.

    It is a kernel by itself so that it is compiled only where it is needed.
    """
    start = numbered(np.uint64(seed), 1)
    for attempt in range(MAX_DRAWS):
        bits[:] = np.uint64(0)
        key = finalize(start + np.uint64(attempt))
        if shape[GENERATOR] == BUILDING:
            draw_building(bits, reach, shape, key)
        else:
            draw_cave(bits, reach, shape, masks, key)
        if is_solvable(bits, 0, reach, 0, shape, masks):
            return attempt + 1
    return 0


def draw(config: EnvConfig, seed: int) -> tuple[NDArray[np.uint64], int]:
    """The terrain of a seed as rows of bits and its number of draws, 0 if it has none.

    A seed has none if MAX_DRAWS draws cannot be solved. ValueError for the level of given maps.
    """
    if config.level == MAP:
        raise ValueError(
            f'level "{MAP}" has no terrains of its own: give one, as reset(options={{"map": ...}}) does'
        )
    shape, bits = shape_of(config), np.zeros(bitmap_words(config), np.uint64)
    draw_one = draw_solvable_alone if shape[GENERATOR] == RECTANGLES else draw_other
    reach, number = np.zeros_like(bits), np.uint64(check_seed(seed))
    return bits, int(draw_one(bits, reach, shape, row_masks(config), number))


def unsolvable(config: EnvConfig, seed: int) -> ValueError:
    """The error for a seed none of whose draws can be solved."""
    return ValueError(
        f"no solvable terrain in {MAX_DRAWS:,} draws for level {config.level!r} at {config.rows}x{config.cols} with seed "
        f"{seed}, radius {config.sensor_radius} and beta {config.beta}; choose another seed, a smaller size or a lower beta"
    )


def generate(config: EnvConfig, seed: int) -> NDArray[np.bool_]:
    """The terrain of a seed: bool[rows, cols], True where blocked.

    ValueError if no draw can be solved.
    """
    return unpack(draw_bits(config, seed), config)


def draw_bits(config: EnvConfig, seed: int) -> NDArray[np.uint64]:
    """The terrain of a seed as rows of bits; ValueError if no draw can be solved."""
    bits, attempts = draw(config, seed)
    if not attempts:
        raise unsolvable(config, seed)
    return bits


def attempts(config: EnvConfig, seed: int) -> int:
    """How many draws the terrain of a seed takes, 0 if 1,000 were not enough."""
    return draw(config, seed)[1]


def next_seed(seed: int) -> int:
    """The seed that follows a seed if an environment is reset without one: 0..2^53-1."""
    return int(next_state(np.uint64(check_seed(seed))))
