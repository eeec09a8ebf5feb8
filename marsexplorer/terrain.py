"""Make a solvable terrain from (configuration, seed): the same on every platform and library version, for ever.

**Generator.** SplitMix64 as a counter (see `random_numbers`): with mix for `finalize` and G for GAMMA, the key of draw
d = 0, 1, ... of a seed is mix(mix(seed + G) + d), the k-th number (k = 1, 2, ...) of a draw is mix(key + k G), and a whole
number below m is the product of its upper 32 bits with m, shifted right by 32. The seed that follows a seed is
mix(seed + G) >> 11.

**Draw.** Level `random` (section 3.2): max(1, round(12 n / 441)) rectangles, for each the height (1..3), the width (1..3),
the top row and the left column, so that it lies wholly inside. Levels t-m-b (section 3.3): for each lattice point, rows and
columns 3, 10, 17, ..., row by row, the shift of the row and of the column (-t..t), the height and the width (1..2 for m = 1,
1..4 for m = 2); the rectangle's top is the row - (height - 1) // 2, likewise its left, and what falls outside is cut.

**Solvable.** A draw counts when the start (0, 0) is free, all free cells are connected and at least beta n cells can be
discovered; otherwise the next draw is taken, up to 1,000. Every free cell can be discovered then, and an obstacle exactly when
a free cell shares an edge or, for radii above 1, a corner with it: any longer line of sight to it enters through one of these.

Terrains are stored as rows of bits, `words` uint64 a row, with a margin of `radius` bits and rows all round, lowest bit west.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel, popcount
from marsexplorer.config import LEVELS, EnvConfig, check_seed
from marsexplorer.lidar import row_words
from marsexplorer.random_numbers import finalize, numbered, numbered_below

MAX_DRAWS = 1000

ROWS, COLS, RADIUS, WORDS, TOPOLOGY, MORPHOLOGY, TARGET, SHAPE = range(8)
"""Places in the int64 array of `shape_of`."""


def shape_of(config: EnvConfig) -> NDArray[np.int64]:
    """Return what compiled code needs to draw terrains: int64[8], see ROWS..TARGET."""
    level = LEVELS[config.level]
    return np.array(
        [
            config.rows,
            config.cols,
            config.sensor_radius,
            row_words(config.cols, config.sensor_radius),
            level.topology,
            level.morphology,
            config.target,
            0,
        ],
        np.int64,
    )


@kernel
def next_state(seed):  # uint64 -> uint64
    """Return the seed that follows a seed, compiled."""
    return numbered(np.uint64(seed), 1) >> np.uint64(11)


@inlined
def fill_rectangle(bits, base, shape, top, left, height, width):
    """Set the part of a rectangle that lies inside the grid."""
    radius, words = shape[RADIUS], shape[WORDS]
    bottom, right = min(top + height, shape[ROWS]), min(left + width, shape[COLS])
    top, left = max(top, 0), max(left, 0)
    for row in range(top, bottom):
        for col in range(left, right):
            bit = col + radius
            bits[base + (row + radius) * words + (bit >> 6)] |= np.uint64(1) << np.uint64(bit & 63)


@inlined
def draw_terrain(bits, base, shape, key):
    """Draw one terrain into cleared rows of bits; key (uint64) names the stream, and its k-th number has one use."""
    rows, cols, k = shape[ROWS], shape[COLS], 0

    # 1. Level random (section 3.2): rectangles anywhere, round(12 n / 441) of them in whole numbers.
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

    # 2. Levels t-m-b (section 3.3): one rectangle for each point of a lattice, shifted by up to d_t.
    shift, sides = shape[TOPOLOGY], 2 if shape[MORPHOLOGY] == 1 else 4
    for at_row in range(3, rows, 7):
        for at_col in range(3, cols, 7):
            row = at_row + numbered_below(key, k + 1, 2 * shift + 1) - shift
            col = at_col + numbered_below(key, k + 2, 2 * shift + 1) - shift
            height = 1 + numbered_below(key, k + 3, sides)
            width = 1 + numbered_below(key, k + 4, sides)
            fill_rectangle(bits, base, shape, row - (height - 1) // 2, col - (width - 1) // 2, height, width)
            k += 4


@inlined
def row_mask(shape, word):
    """Return the bits of word number `word` of a row that are cells of the grid."""
    low = max(shape[RADIUS] - 64 * word, 0)
    high = min(shape[RADIUS] + shape[COLS] - 64 * word, 64)
    if high <= low:
        return np.uint64(0)
    full = ~np.uint64(0)
    return (full >> np.uint64(64 - (high - low))) << np.uint64(low)


@inlined
def fill_runs(reached, free):
    """Return the free bits of one word that are connected, along the word, with a reached one.

    A Kogge-Stone fill: after the round with step s, every bit has spread over 2 s - 1 free bits to both sides, so six rounds
    cover a word. `east` and `west` hold where a whole stretch of s free bits ends, so nothing jumps over an obstacle.
    """
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
    """Grow the reached part of a row (reach[at:]) from the row reach[above:]; return whether it grew."""
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


@inlined
def reached_or_adjacent(reach, at, word, words, corners):
    """Return the bits of one word of a row that are reached or share an edge (with `corners`, a corner) with a reached cell."""
    here = at + word
    vertical = reach[here - words] | reach[here + words]
    across = reach[here] | vertical if corners else reach[here]
    found = reach[here] | vertical | (across << np.uint64(1)) | (across >> np.uint64(1))
    if word > 0:
        across = reach[here - 1] | reach[here - 1 - words] | reach[here - 1 + words] if corners else reach[here - 1]
        found |= across >> np.uint64(63)
    if word + 1 < words:
        across = reach[here + 1] | reach[here + 1 - words] | reach[here + 1 + words] if corners else reach[here + 1]
        found |= across << np.uint64(63)
    return found


@kernel
def is_solvable(bits, base, reach, offset, shape, masks):
    """Return whether all free cells are connected to a free (0, 0) and enough cells can be discovered.

    reach  scratch as large as the rows of bits, `offset` words after the place that the bits have in theirs
    masks  uint64[words], see `row_masks`
    """
    rows, radius, words = shape[ROWS], shape[RADIUS], shape[WORDS]
    first = base + radius * words

    # 1. The start must be free; everything is reached from it.
    if (bits[first + (radius >> 6)] >> np.uint64(radius & 63)) & np.uint64(1):
        return False
    for at in range(first - words + offset, first + (rows + 1) * words + offset):
        reach[at] = np.uint64(0)
    reach[first + offset + (radius >> 6)] = np.uint64(1) << np.uint64(radius & 63)

    # 2. Flood, a row at a time: down the grid, then up, until neither reaches anything more.
    grew = True
    while grew:
        grew = False
        for row in range(rows):
            at = first + row * words
            grew |= sweep_row(bits, at, reach, at + offset, at + offset - words, masks, words)
        if grew:
            grew = False
            for row in range(rows - 1, -1, -1):
                at = first + row * words
                grew |= sweep_row(bits, at, reach, at + offset, at + offset + words, masks, words)

    # 3. Every free cell must be reached. Count what can be discovered: the free cells, and the obstacles next to one (for
    #    radii above 1 also those at a corner; see the module's header for why no others).
    seen = 0
    for row in range(rows):
        at = first + row * words
        for word in range(words):
            if reach[at + offset + word] != masks[word] & ~bits[at + word]:
                return False
            found = reached_or_adjacent(reach, at + offset, word, words, radius > 1)
            seen += np.int64(popcount(found & masks[word]))
    return seen >= shape[TARGET]


@kernel
def draw_solvable(bits, base, reach, offset, shape, masks, seed):
    """Draw terrains into bits[base:] until one is solvable; return how many draws it took, 0 after MAX_DRAWS.

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
    """Do `draw_solvable` for one terrain in arrays of its own."""
    return draw_solvable(bits, 0, reach, 0, shape, masks, seed)


def row_masks(config: EnvConfig) -> NDArray[np.uint64]:
    """Return uint64[words]: the bits of a row that are cells of the grid."""
    shape = shape_of(config)
    return np.array([row_mask_of(shape, word) for word in range(row_words(config.cols, config.sensor_radius))], np.uint64)


@kernel
def row_mask_of(shape, word):
    """Do `row_mask`, called from Python."""
    return row_mask(shape, word)


def unpack(bits: NDArray[np.uint64], config: EnvConfig) -> NDArray[np.bool_]:
    """Return bool[rows, cols] from rows of bits with margins."""
    radius, words = config.sensor_radius, row_words(config.cols, config.sensor_radius)
    stacked = bits.reshape(config.rows + 2 * radius, words)[radius : radius + config.rows]
    flat = np.unpackbits(np.ascontiguousarray(stacked).astype("<u8").view(np.uint8), axis=1, bitorder="little")
    return flat[:, radius : radius + config.cols].astype(np.bool_)


def pack(cells: NDArray[np.bool_], config: EnvConfig) -> NDArray[np.uint64]:
    """Return rows of bits with margins from bool[rows, cols]."""
    radius, words = config.sensor_radius, row_words(config.cols, config.sensor_radius)
    wide = np.zeros((config.rows + 2 * radius, words * 64), np.uint8)
    wide[radius : radius + config.rows, radius : radius + config.cols] = cells
    return np.packbits(wide, axis=1, bitorder="little").view("<u8").astype(np.uint64).reshape(-1)


def _draw(config: EnvConfig, seed: int) -> tuple[NDArray[np.uint64], int]:
    bits = np.zeros((config.rows + 2 * config.sensor_radius) * row_words(config.cols, config.sensor_radius), np.uint64)
    attempts = int(
        draw_solvable_alone(bits, np.zeros_like(bits), shape_of(config), row_masks(config), np.uint64(check_seed(seed)))
    )
    return bits, attempts


def unsolvable(config: EnvConfig, seed: int) -> ValueError:
    """Return the error for a seed none of whose draws can be solved."""
    return ValueError(
        f"no solvable terrain in {MAX_DRAWS:,} draws for level {config.level!r} at {config.rows}x{config.cols} with seed "
        f"{seed}, radius {config.sensor_radius} and beta {config.beta}; choose another seed, a smaller size or a lower beta"
    )


def generate(config: EnvConfig, seed: int) -> NDArray[np.bool_]:
    """Return the terrain of a seed: bool[rows, cols], True where blocked. ValueError when no draw can be solved."""
    bits, attempts = _draw(config, seed)
    if not attempts:
        raise unsolvable(config, seed)
    return unpack(bits, config)


def attempts(config: EnvConfig, seed: int) -> int:
    """Return how many draws the terrain of a seed takes, 0 when 1,000 were not enough."""
    return _draw(config, seed)[1]


def next_seed(seed: int) -> int:
    """Return the seed that follows a seed when an environment is reset without one: 0..2^53-1."""
    return int(next_state(np.uint64(check_seed(seed))))
