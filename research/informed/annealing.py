"""Simulated annealing of a tour of viewpoints, compiled, for the informed planner.

A change of a tour leaves most of its legs as they were, so what each leg shows is kept, and a
proposed tour is worked out from the legs that differ. `Legs` of a tour are the tuple of

    moves   int64[capacity]           of the leg to each viewpoint
    last    int64[capacity]           action with which it ends, which breaks the ties of the next
            one
    shown   uint64[capacity, words]   what its cells show, without the one that it begins at
    before  uint64[capacity + 1, words]  what the start and the legs before number k show together
    after   uint64[capacity + 1, words]  what the legs from number k on show together

`tours` describes tours and a known terrain.
"""

from __future__ import annotations

import numpy as np

from marsexplorer.compiled import kernel
from marsexplorer.random_numbers import uniform
from research.informed.tours import (
    FIRST_ACTION,
    INFINITE,
    change_tour,
    copy_tour,
    count_covered,
    step_toward,
)

MISSING_CELL_COST = 1.5
"""Cost of a cell short of the target, in moves."""

U = np.uint64


def empty_legs(capacity, words):
    """(legs, proposed): `Legs` without any leg, and arrays for those of another tour.

    The arrays are (moves, last, shown).
    """
    moves, last = np.zeros((2, 2, capacity), np.int64)
    shown = np.zeros((2, capacity, words), np.uint64)
    around = np.zeros((2, capacity + 1, words), np.uint64)
    return (moves[0], last[0], shown[0], *around), (moves[1], last[1], shown[1])


@kernel
def walk_leg(cell, goal, tie_break, last, terrain, shown):
    """Walk a leg from a cell to its goal; return (moves, last action).

    shown  uint64[words], written: what the leg's cells show
    """
    neighbours, distance, views, first_word, end_word = terrain
    shown[:] = U(0)
    row, moves = distance[goal], 0
    while cell != goal:
        last = step_toward(cell, row, tie_break, last, neighbours)
        cell = neighbours[cell, last]
        moves += 1
        for w in range(first_word[cell], end_word[cell]):
            shown[w] |= views[cell, w]
    return moves, last


@kernel
def walk_changed_legs(start, points, tie_breaks, counts, terrain, legs, proposed, covered):
    """Walk the legs in which the proposed tour differs from the present one.

    counts    (viewpoints of the present tour, of the proposed one)
    legs      of the present tour; the legs walked are written to `proposed` at their own numbers
    covered   uint64[words], becomes what the whole proposed tour shows

    Return (first leg walked, one more than the last, moves that the proposed tour has more).
    """
    moves, lasts, _, before, after = legs
    count, new_count = counts
    shift = new_count - count
    # 1. Count the viewpoints that both tours have in common at the beginning, and at the end.
    fewest = min(count, new_count)
    first = 0
    while (
        first < fewest
        and points[0, first] == points[1, first]
        and tie_breaks[0, first] == tie_breaks[1, first]
    ):
        first += 1
    same = 0
    while same < fewest - first:
        old, new = count - 1 - same, new_count - 1 - same
        if points[0, old] != points[1, new] or tie_breaks[0, old] != tie_breaks[1, new]:
            break
        same += 1
    # 2. Walk from the first difference to where the tours stand on the same cell again, after the
    #    same action: all legs from there on are alike.
    cell = points[1, first - 1] if first > 0 else start
    last = lasts[first - 1] if first > 0 else FIRST_ACTION
    for w in range(covered.shape[0]):
        covered[w] = before[first, w]
    longer = 0
    end = first
    while end < new_count and not (end > new_count - same and last == lasts[end - 1 - shift]):
        length, last = walk_leg(
            cell, points[1, end], tie_breaks[1, end], last, terrain, proposed[2][end]
        )
        proposed[0][end], proposed[1][end] = length, last
        cell = points[1, end]
        longer += length
        for w in range(covered.shape[0]):
            covered[w] |= proposed[2][end, w]
        end += 1
    # 3. Add what the legs after it show, and take the moves of the legs that are replaced.
    for k in range(first, end - shift):
        longer -= moves[k]
    for w in range(covered.shape[0]):
        covered[w] |= after[end - shift, w]
    return first, end, longer


@kernel
def replace_legs(counts, first, end, legs, proposed):
    """Put the proposed legs first..end - 1 into the place of those they replace."""
    moves, lasts, shown, before, after = legs
    count, new_count = counts
    shift, words = new_count - count, shown.shape[1]
    # 1. The legs after them take their new numbers, in the order in which none is overwritten
    #    before it is moved.
    if shift != 0:
        for i in range(new_count - end):
            k = end + i if shift < 0 else new_count - 1 - i
            moves[k], lasts[k] = moves[k - shift], lasts[k - shift]
            for w in range(words):
                shown[k, w] = shown[k - shift, w]
                before[k + 1, w] = before[k + 1 - shift, w]
        for i in range(new_count + 1 - end):
            k = end + i if shift < 0 else new_count - i
            for w in range(words):
                after[k, w] = after[k - shift, w]
    for k in range(first, end):
        moves[k], lasts[k] = proposed[0][k], proposed[1][k]
        for w in range(words):
            shown[k, w] = proposed[2][k, w]
    # 2. Add up again what is shown before and after each leg, as far as that changes.
    for k in range(first, new_count):
        differs = U(0)
        for w in range(words):
            both = before[k, w] | shown[k, w]
            differs |= both ^ before[k + 1, w]
            before[k + 1, w] = both
        if k >= end and differs == U(0):
            break
    for k in range(end - 1, -1, -1):
        differs = U(0)
        for w in range(words):
            both = after[k + 1, w] | shown[k, w]
            differs |= both ^ after[k, w]
            after[k, w] = both
        if k < first and differs == U(0):
            break


@kernel
def anneal(start, target, schedule, terrain, free, cells, tours, legs, proposed, covered, state):
    """The number of viewpoints of the shortest tour that shows `target` cells, or -1.

    schedule  (changes tried, temperature of the first, temperature of the last in moves)
    tours     (points int32[3, capacity], tie_breaks int8[3, capacity]) of the present tour, the
              proposed one, and the best, which is left there
    legs      scratch: of the present tour; proposed: (moves, last, shown) of the legs of the
              proposed one
    covered   uint64[2, words], scratch: what the first two tours show
    state     uint64[1], of the random numbers
    """
    changes, initial_temperature, final_temperature = schedule
    points, tie_breaks = tours
    # 1. Begin with the empty tour: the rover stays at the start.
    count, length, best_count, best_length = 0, np.int64(0), -1, np.int64(INFINITE)
    for w in range(covered.shape[1]):
        covered[0, w] = legs[3][0, w] = terrain[2][start, w]
        legs[4][0, w] = U(0)
    cost = MISSING_CELL_COST * max(0, target - count_covered(covered[0]))
    cooling = (final_temperature / initial_temperature) ** (1.0 / changes)
    temperature = initial_temperature
    for _ in range(changes):
        temperature *= cooling
        # 2. Propose a changed copy of the present tour and work out its cost.
        copy_tour(points, tie_breaks, 0, 1, count)
        new_count = change_tour(
            start, points[1], tie_breaks[1], count, covered[0], terrain, free, cells, state
        )
        if new_count < 0:
            continue
        counts = (count, new_count)
        first, end, longer = walk_changed_legs(
            start, points, tie_breaks, counts, terrain, legs, proposed, covered[1]
        )
        new_length = length + longer
        missing = max(0, target - count_covered(covered[1]))
        new_cost = new_length + MISSING_CELL_COST * missing
        # 3. Accept it by the rule of Metropolis: always when it is no worse, else with probability
        #    exp(-increase / t).
        if new_cost <= cost or uniform(state) < np.exp((cost - new_cost) / temperature):
            replace_legs(counts, first, end, legs, proposed)
            cost, count, length = new_cost, new_count, new_length
            copy_tour(points, tie_breaks, 1, 0, count)
            for w in range(covered.shape[1]):
                covered[0, w] = covered[1, w]
            # 4. Keep the shortest tour that reaches the target.
            if missing == 0 and length < best_length:
                best_length, best_count = length, count
                copy_tour(points, tie_breaks, 0, 2, count)
    return best_count
