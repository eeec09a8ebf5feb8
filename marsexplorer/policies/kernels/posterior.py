"""Draw terrains of level `random` from the posterior given the known cells.

The generator (`terrain`) lays max(1, round(12 n / 441)) rectangles, draws the height and the width
of each from 1..LONGEST and its place from those wholly inside, and draws again until the terrain
can be solved. A chain holds the rectangles of one terrain. A Gibbs step (Geman and Geman 1984)
takes one out and draws it again from its conditional distribution: by its prior among the
rectangles that hold no cell known to be free and all the known obstacles that no other rectangle
covers. Chains are kept from move to move; where something new has been seen that a chain does not
agree with, it is repaired, which is a draw near the posterior but not of it, and the steps that
follow bring it back. Terrains that the generator would refuse are passed over.

Kernels take, of S chains of N rectangles on boards of n cells, the tuple

    chains   rectangles  int64[S, N, 4], (height, width, top, left); a height of 0: not drawn yet
             covers      int16[S, n], how many rectangles lie on each cell
             usable      uint8[S], written: whether the terrain can be solved and agrees with what
                         is known
             scratch     (sums, fits, listed, cumulative, missing, best, reach, queue), see
                         `posterior_chains`
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marsexplorer.compiled import inlined, kernel
from marsexplorer.config import OBSTACLE, UNKNOWN
from marsexplorer.policies.kernels.grid import neighbour
from marsexplorer.random_numbers import uniform

LONGEST = 3
"""Cells of the longest side of a rectangle."""
BEGINNINGS = 10
"""Times that a chain is begun again if it cannot be repaired, before it is not usable."""
MORE_SWEEPS = 20
"""Additional sweeps in search of a terrain that can be solved."""


def rectangles_of(cells: int) -> int:
    """How many rectangles the generator lays on so many cells."""
    return max(1, (24 * cells + 441) // 882)


def posterior_chains(shape: tuple[int, int], samples: int) -> tuple[Any, ...]:
    """`chains` as described above, not begun yet."""
    rows, cols = shape
    n, count, kinds = rows * cols, rectangles_of(rows * cols), LONGEST * LONGEST
    scratch = (
        np.zeros((rows + 1, cols + 1), np.int32),
        np.zeros((kinds, n), np.uint8),
        np.zeros((kinds * n, 4), np.int32),
        np.zeros(kinds * n),
        np.zeros(count, np.uint8),
        np.zeros(4, np.int64),
        np.zeros(n, np.uint8),
        np.zeros(n, np.int32),
    )
    rectangles = np.zeros((samples, count, 4), np.int64)
    return rectangles, np.zeros((samples, n), np.int16), np.zeros(samples, np.uint8), scratch


@inlined
def copy_to(target, source):
    """Copy an array of one dimension, element by element.

    A slice would be copied through memory that kernels do not have.
    """
    for k in range(source.shape[0]):
        target[k] = source[k]


@inlined
def prior(height, width, rows, cols):
    """The weight of a rectangle among all: its place is uniform, given its size."""
    return 1.0 / ((rows - height + 1) * (cols - width + 1))


@kernel
def list_rectangles(known_codes, rows, cols, scratch):
    """List the rectangles without a known free cell and the sums of their priors.

    Return how many there are.

    fits  uint8[kinds, n], written: whether such a rectangle of a size has its north-west corner in
          a cell
    """
    sums, fits, listed, cumulative = scratch[:4]
    for r in range(rows):
        for c in range(cols):
            code = known_codes[r * cols + c]
            is_free = code != UNKNOWN and code != OBSTACLE
            sums[r + 1, c + 1] = sums[r, c + 1] + sums[r + 1, c] - sums[r, c] + is_free
    count, total = 0, 0.0
    for h in range(1, min(LONGEST, rows) + 1):
        for w in range(1, min(LONGEST, cols) + 1):
            weight, kind = prior(h, w, rows, cols), (h - 1) * LONGEST + w - 1
            for top in range(rows - h + 1):
                for left in range(cols - w + 1):
                    free = sums[top + h, left + w] - sums[top, left + w]
                    free -= sums[top + h, left] - sums[top, left]
                    fits[kind, top * cols + left] = free == 0
                    if free == 0:
                        listed[count, 0], listed[count, 1] = h, w
                        listed[count, 2], listed[count, 3] = top, left
                        total += weight
                        cumulative[count] = total
                        count += 1
    return count


@inlined
def lay(rectangle, cover, cols, change):
    """Add `change` to the cover of a rectangle's cells; none for one not drawn yet."""
    height, width, top, left = rectangle
    for r in range(top, top + height):
        for cell in range(r * cols + left, r * cols + left + width):
            cover[cell] += change


@kernel
def draw_any(rectangle, count, scratch, state):
    """Draw one of the listed rectangles by its prior."""
    listed, cumulative = scratch[2], scratch[3]
    drawn = uniform(state) * cumulative[count - 1]
    low, high = 0, count - 1
    while low < high:
        middle = (low + high) // 2
        if cumulative[middle] > drawn:
            high = middle
        else:
            low = middle + 1
    for k in range(4):
        rectangle[k] = listed[low, k]


@kernel
def draw_over(rectangle, top, left, bottom, right, rows, cols, fits, state):
    """Draw a rectangle that holds a box by its prior; return whether one fits.

    bottom, right  inclusive
    """
    # reservoir sampling: each rectangle replaces the last one by its share of the weights so far
    total, is_drawn = 0.0, False
    for h in range(bottom - top + 1, min(LONGEST, rows) + 1):
        for w in range(right - left + 1, min(LONGEST, cols) + 1):
            weight, kind = prior(h, w, rows, cols), (h - 1) * LONGEST + w - 1
            for t in range(max(0, bottom - h + 1), min(top, rows - h) + 1):
                for l in range(max(0, right - w + 1), min(left, cols - w) + 1):  # noqa: E741
                    if fits[kind, t * cols + l]:
                        total += weight
                        if uniform(state) * total < weight:
                            rectangle[0], rectangle[1], rectangle[2], rectangle[3] = h, w, t, l
                            is_drawn = True
    return is_drawn


@kernel
def draw_again(rectangle, cover, known_codes, rows, cols, count, scratch, state):
    """Make one Gibbs step: take a rectangle out and draw it again, given all others."""
    lay(rectangle, cover, cols, -1)

    # 1. The box round the known obstacles that it alone covers.
    top, left, bottom, right = rows, cols, -1, -1
    height, width = rectangle[0], rectangle[1]
    for r in range(rectangle[2], rectangle[2] + height):
        for c in range(rectangle[3], rectangle[3] + width):
            if known_codes[r * cols + c] == OBSTACLE and cover[r * cols + c] == 0:
                top, bottom, left, right = min(top, r), max(bottom, r), min(left, c), max(right, c)

    # 2. Draw it over the box, or anywhere. It fitted before, so over the box there is at least the
    #    one that it was.
    if bottom < 0:
        draw_any(rectangle, count, scratch, state)
    else:
        draw_over(rectangle, top, left, bottom, right, rows, cols, scratch[1], state)
    lay(rectangle, cover, cols, 1)


@kernel
def is_spare(rectangle, cover, known_codes, cols):
    """Whether a rectangle covers no known obstacle alone."""
    for r in range(rectangle[2], rectangle[2] + rectangle[0]):
        for c in range(rectangle[3], rectangle[3] + rectangle[1]):
            if known_codes[r * cols + c] == OBSTACLE and cover[r * cols + c] == 1:
                return False
    return True


@kernel
def repair(rectangles, cover, known_codes, rows, cols, count, scratch, state):
    """Make a chain agree with what is known; return whether that succeeded."""
    fits, missing, best = scratch[1], scratch[4], scratch[5]
    num = rectangles.shape[0]

    # 1. Take out the rectangles that lie on a cell known to be free.
    for i in range(num):
        height, width, top, left = rectangles[i]
        missing[i] = height == 0 or not fits[(height - 1) * LONGEST + width - 1, top * cols + left]
        if missing[i]:
            lay(rectangles[i], cover, cols, -1)
            rectangles[i, 0] = 0

    # 2. Cover each known obstacle that is bare: with one that was taken out, else with one that
    #    covers no known obstacle alone. Of some draws the one that covers most of what is bare is
    #    taken, or there might not be rectangles enough.
    for cell in range(rows * cols):
        if known_codes[cell] != OBSTACLE or cover[cell] > 0:
            continue
        chosen, seen = -1, 0
        for i in range(num):
            if missing[i]:
                chosen = i
                break
        if chosen < 0:
            for i in range(num):
                if is_spare(rectangles[i], cover, known_codes, cols):
                    seen += 1
                    if uniform(state) * seen < 1.0:
                        chosen = i
            if chosen < 0:
                return False
            lay(rectangles[chosen], cover, cols, -1)
        rectangle, row, col, most = rectangles[chosen], cell // cols, cell % cols, -1
        for _ in range(4 if num < 60 else 30):
            rectangle[0] = 0
            if not draw_over(rectangle, row, col, row, col, rows, cols, fits, state):
                missing[chosen] = 1
                return False
            bare = 0
            for r in range(rectangle[2], rectangle[2] + rectangle[0]):
                for c in range(rectangle[3], rectangle[3] + rectangle[1]):
                    bare += known_codes[r * cols + c] == OBSTACLE and cover[r * cols + c] == 0
            if bare > most:
                copy_to(best, rectangle)
                most = bare
        copy_to(rectangle, best)
        missing[chosen] = 0
        lay(rectangle, cover, cols, 1)

    # 3. Those that are left lie anywhere.
    for i in range(num):
        if missing[i]:
            draw_any(rectangles[i], count, scratch, state)
            lay(rectangles[i], cover, cols, 1)
    return True


@kernel
def can_be_solved(cover, rows, cols, target, scratch):
    """Whether all free cells connect to (0, 0) and `target` cells can be discovered.

    The generator keeps such a terrain. An obstacle can be discovered if it shares an edge or a
    corner with a free cell, see `terrain`.
    """
    reach, queue = scratch[6], scratch[7]
    if cover[0] > 0:
        return False
    free = 0
    for cell in range(rows * cols):
        reach[cell] = 0
        free += cover[cell] == 0
    reach[0], queue[0], head, tail = 1, 0, 0, 1
    while head < tail:
        for action in range(4):
            near = neighbour(np.int64(queue[head]), action, rows, cols)
            if near >= 0 and cover[near] == 0 and reach[near] == 0:
                reach[near], queue[tail] = 1, near
                tail += 1
        head += 1
    if tail < free:
        return False
    seen = free
    for r in range(rows):
        for c in range(cols):
            if cover[r * cols + c] > 0:
                is_seen = False
                for a in range(max(0, r - 1), min(rows, r + 2)):
                    for b in range(max(0, c - 1), min(cols, c + 2)):
                        is_seen = is_seen or cover[a * cols + b] == 0
                seen += is_seen
    return seen >= target


@kernel
def move_chains(chains, known_codes, rows, cols, target, sweeps, is_checked, state):
    """Repair all chains and take Gibbs steps; return how many are usable.

    known_codes  uint8[n], the codes as known
    target       fewest cells that can be discovered on a terrain that the generator keeps
    sweeps       Gibbs steps of each rectangle
    is_checked   whether terrains must be solvable, for which more sweeps are made
    state        uint64[1], of `random_numbers`
    """
    rectangles, covers, usable, scratch = chains
    count = list_rectangles(known_codes, rows, cols, scratch)
    usable_count = 0
    for s in range(rectangles.shape[0]):
        chain, cover = rectangles[s], covers[s]
        usable[s] = 0

        # 1. A chain that cannot be repaired goes on from another one, or from nothing.
        is_good = count > 0 and repair(chain, cover, known_codes, rows, cols, count, scratch, state)
        for beginning in range(BEGINNINGS if count > 0 else 0):
            if is_good:
                break
            if s > 0 and usable[s - 1] and beginning < BEGINNINGS // 2:
                for i in range(chain.shape[0]):
                    copy_to(chain[i], rectangles[s - 1, i])
                copy_to(cover, covers[s - 1])
            else:
                chain[:] = 0
                cover[:] = 0
            is_good = repair(chain, cover, known_codes, rows, cols, count, scratch, state)
        if not is_good:
            chain[:] = 0
            cover[:] = 0
            continue

        # 2. Move it on, to a terrain that the generator would keep.
        usable[s] = not is_checked
        for sweep in range(sweeps + MORE_SWEEPS * is_checked):
            for i in range(chain.shape[0]):
                draw_again(chain[i], cover, known_codes, rows, cols, count, scratch, state)
            if (
                is_checked
                and sweep >= sweeps - 1
                and can_be_solved(cover, rows, cols, target, scratch)
            ):
                usable[s] = 1
                break
        usable_count += usable[s]
    return usable_count
