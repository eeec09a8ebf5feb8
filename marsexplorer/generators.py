"""Buildings and caves, drawn from numbered streams like the paper's terrains.

**Building.** Recursive division (Buck 2015, "Mazes for Programmers", with rooms). A region of the
grid, at first all of it, is cut across its longer side (by rows when both are equal). When both
sides are CORRIDOR_SIDE or more, two walls are drawn with a corridor of 1 or 3 cells between them,
else one wall. A region whose longer side is at most 6 + (0..4) cells is a room. A wall has a
doorway of one cell, and one of LONG_WALL cells or more has a second in half of the cases. Walls
stand on odd rows and columns and doorways on even ones, so no wall ends in a doorway and everything
is connected. A room of 5 or more cells a side has a solid block in two of three cases, with at
least one free cell all round; its inside can never be seen. The smaller part of a cut is divided
first. The edge of the grid is the outer wall, and the rover starts in the north-west.

**Cave.** A cellular automaton (Johnson, Yannakakis and Togelius 2010, "Cellular automata for
real-time generation of infinite cave levels"). Each cell is rock with probability ROCK_PER_CENT.
ROUNDS times, a cell becomes rock when five or more of the nine cells of its 3 x 3 square are rock,
with rock all round the grid. A mouth is dug from (0, 0), one cell east and one south in turn, until
it meets open ground. What is not connected to it is filled.

Numbers are taken one after the other from the stream of `key`, as `terrain` describes; each `k`
below counts them.
"""

from __future__ import annotations

import numpy as np

from marsexplorer.bitmap import COLS, RADIUS, ROWS, WORDS, flood
from marsexplorer.compiled import inlined, kernel
from marsexplorer.lidar import ONE
from marsexplorer.random_numbers import numbered_below

CORRIDOR_SIDE = 13
"""A region with both sides this long is cut by a corridor (cells)."""
LONG_WALL = 9
"""A wall of so many cells may have two doorways."""
ROCK_PER_CENT = 43
ROUNDS = 4


@kernel
def mark_rectangle(bits, shape, top, left, height, width, is_obstacle):
    """Set (1) or clear (0) the bits of a rectangle inside the grid."""
    radius, words = shape[RADIUS], shape[WORDS]
    for row in range(top, top + height):
        for col in range(left, left + width):
            at = (row + radius) * words + ((col + radius) >> 6)
            bit = ONE << np.uint64((col + radius) & 63)
            if is_obstacle:
                bits[at] |= bit
            else:
                bits[at] &= ~bit


@kernel
def draw_wall(bits, shape, key, k, is_row, place, begin, length):
    """Draw a wall in the row or column `place`; return the numbers used so far.

    The wall has `length` cells, the first of them at `begin`.
    """
    if is_row:
        mark_rectangle(bits, shape, place, begin, 1, length, 1)
    else:
        mark_rectangle(bits, shape, begin, place, length, 1, 1)
    doorways = 1
    if length >= LONG_WALL:
        k += 1
        doorways += numbered_below(key, k, 2)
    for _ in range(doorways):
        k += 1
        at = begin + 2 * numbered_below(key, k, (length + 1) // 2)
        mark_rectangle(bits, shape, place if is_row else at, at if is_row else place, 1, 1, 0)
    return k


@kernel
def furnish(bits, shape, key, k, top, left, height, width):
    """Draw the block of a room, if it has one; return the numbers used so far."""
    if min(height, width) < 5:
        return k
    k += 1
    if numbered_below(key, k, 3) == 0:
        return k
    block_height = 1 + numbered_below(key, k + 1, height - 2)
    block_width = 1 + numbered_below(key, k + 2, width - 2)
    block_top = top + 1 + numbered_below(key, k + 3, height - 1 - block_height)
    block_left = left + 1 + numbered_below(key, k + 4, width - 1 - block_width)
    mark_rectangle(bits, shape, block_top, block_left, block_height, block_width, 1)
    return k + 4


@kernel
def push_region(stack, at, top, left, height, width):
    """Write a region into one word, 16 bits for each of the four."""
    number = np.int64(top) << 48 | np.int64(left) << 32 | np.int64(height) << 16 | np.int64(width)
    stack[at] = np.uint64(number)


@kernel
def draw_building(bits, stack, shape, key):
    """Draw a building into cleared rows of bits.

    stack  scratch as large as the rows of bits, for the regions that are still to be divided
    """
    push_region(stack, 0, 0, 0, shape[ROWS], shape[COLS])
    waiting, k = 1, 0
    while waiting > 0:
        # 1. Take a region. A small one is a room.
        waiting -= 1
        region = np.int64(stack[waiting])
        top = region >> 48
        left = region >> 32 & 0xFFFF
        height = region >> 16 & 0xFFFF
        width = region & 0xFFFF
        k += 1
        if max(height, width) <= 6 + numbered_below(key, k, 5):
            k = furnish(bits, shape, key, k, top, left, height, width)
            continue

        # 2. Cut it across its longer side, with at least three cells left on both sides: by a wall,
        #    or by two with a corridor between them.
        is_row = height >= width
        begin, side, across, length = top, height, left, width
        if not is_row:
            begin, side, across, length = left, width, top, height
        thickness = 1
        if length >= CORRIDOR_SIDE:
            k += 1
            thickness = 3 + 2 * numbered_below(key, k, 2)
        k += 1
        first = begin + 3 + 2 * numbered_below(key, k, (side - thickness - 6) // 2 + 1)
        last = first + thickness - 1
        for place in range(first, last + 1, max(1, thickness - 1)):
            k = draw_wall(bits, shape, key, k, is_row, place, across, length)

        # 3. Both parts wait, the smaller one to be taken first: so only few ever wait.
        before, after = first - begin, begin + side - last - 1
        one, other = waiting + (before <= after), waiting + (before > after)
        if is_row:
            push_region(stack, one, top, left, before, width)
            push_region(stack, other, last + 1, left, after, width)
        else:
            push_region(stack, one, top, left, height, before)
            push_region(stack, other, top, last + 1, height, after)
        waiting += 2


@inlined
def is_set(bits, shape, row, col):
    """The bit of a cell, 0 or 1."""
    bit = col + shape[RADIUS]
    word = bits[(row + shape[RADIUS]) * shape[WORDS] + (bit >> 6)]
    return np.int64(word >> np.uint64(bit & 63) & ONE)


@kernel
def count_rock(bits, shape, row, col):
    """How many of a cell and its neighbours north and south are rock, 0..3.

    Off the grid all is rock.
    """
    if col < 0 or col >= shape[COLS]:
        return np.int64(3)
    count = np.int64(0)
    for near in range(row - 1, row + 2):
        count += is_set(bits, shape, near, col) if 0 <= near < shape[ROWS] else 1
    return count


@kernel
def smooth(bits, before, shape):
    """Run one round of the automaton; `before` is scratch as large as the bits."""
    for word in range((shape[ROWS] + 2 * shape[RADIUS]) * shape[WORDS]):
        before[word] = bits[word]
    for row in range(shape[ROWS]):
        west, here = np.int64(3), count_rock(before, shape, row, 0)
        for col in range(shape[COLS]):
            east = count_rock(before, shape, row, col + 1)
            mark_rectangle(bits, shape, row, col, 1, 1, west + here + east >= 5)
            west, here = here, east


@kernel
def draw_cave(bits, reach, shape, masks, key):
    """Draw a cave into cleared rows of bits; reach and masks as for `bitmap.flood`."""
    rows, cols, radius, words = shape[ROWS], shape[COLS], shape[RADIUS], shape[WORDS]

    # 1. Rock anywhere, then the automaton.
    for cell in range(rows * cols):
        if numbered_below(key, cell + 1, 100) < ROCK_PER_CENT:
            mark_rectangle(bits, shape, cell // cols, cell % cols, 1, 1, 1)
    for _ in range(ROUNDS):
        smooth(bits, reach, shape)

    # 2. Dig the mouth, to the first open cell.
    row, col = 0, 0
    while row < rows and col < cols and is_set(bits, shape, row, col):
        mark_rectangle(bits, shape, row, col, 1, 1, 0)
        if row == col:
            col += 1
        else:
            row += 1

    # 3. Fill what is not connected to it.
    flood(bits, 0, reach, 0, shape, masks, 0, 0)
    for row in range(radius, radius + rows):
        for word in range(words):
            at = row * words + word
            bits[at] = masks[word] & ~reach[at]
