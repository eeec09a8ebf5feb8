"""Searches of the rules from elsewhere, compiled.

Cells are flat: row * cols + col.
"""

from __future__ import annotations

import numpy as np

from marsexplorer.compiled import inlined, kernel
from marsexplorer.config import UNKNOWN
from marsexplorer.policies.kernels.grid import (
    UNREACHABLE,
    find_open_cells,
    is_frontier,
    search_breadth_first,
    step_nearer,
)
from marsexplorer.policies.kernels.visibility import count_visible, fill_bitboards

TOLERANCE = 1e-9
"""Moves: more than the rounding of a mean."""


@inlined
def mean_distance(distance, queue, reached):
    """The mean distance of the cells reached by a search."""
    total = 0
    for k in range(reached):
        total += distance[queue[k]]
    return total / reached


@kernel
def most_advantageous(codes, visited, rover, weight, view, scratch, from_rover, candidates, bounds):
    """The candidate with the largest advantage, row * cols + col, or -1 without one.

    Of equal ones the nearer.

    codes, visited          uint8[rows, cols]; view and scratch as `visibility` and `grid` have them
    from_rover, candidates  int32[cells], rewritten
    bounds                  float64[cells], rewritten
    """
    rows, cols = codes.shape
    is_open, distance, queue = scratch
    fill_bitboards(codes, view)
    find_open_cells(codes, is_open)

    # 1. The candidates within reach, nearest first, with their distances from the rover.
    queue[0] = rover
    reached = search_breadth_first(is_open, rows, cols, from_rover, queue, 1)
    count = 0
    for k in range(reached):
        cell = queue[k]
        r = cell // cols
        c = cell - r * cols
        is_new = visited[r, c] == 0 and is_frontier(codes, r, c)
        if is_new and count_visible(view, r, c) > 0:
            candidates[count] = cell
            count += 1

    # 2. No mean differs from another by more than the way between their cells, so a search gives a
    #    bound on the advantage of every other candidate. Search from the most promising one until
    #    none can be better.
    mean = mean_distance(from_rover, queue, reached)
    for k in range(count):
        bounds[k] = (weight * mean) - (1 - weight) * from_rover[candidates[k]]
    best, most = count, -np.inf
    while True:
        k = -1
        for j in range(count):
            if bounds[j] >= most - TOLERANCE and (k < 0 or bounds[j] > bounds[k]):
                k = j
        if k < 0:
            return candidates[best] if best < count else -1
        queue[0] = candidates[k]
        reached = search_breadth_first(is_open, rows, cols, distance, queue, 1)
        mean = mean_distance(distance, queue, reached)
        advantage = weight * mean - from_rover[candidates[k]]
        bounds[k] = -np.inf
        if advantage > most or (advantage == most and k < best):
            best, most = k, advantage
        for j in range(count):
            bound = weight * (mean + distance[candidates[j]]) - from_rover[candidates[j]]
            bounds[j] = min(bounds[j], bound)


@kernel
def step_toward(codes, rover, heading, goal, through_unknown, scratch):
    """The first action of a shortest path to a goal, or -1 without a path."""
    rows, cols = codes.shape
    is_open, distance, queue = scratch
    find_open_cells(codes, is_open)
    if through_unknown:
        for cell in range(rows * cols):
            r = cell // cols
            if codes[r, cell - r * cols] == UNKNOWN:
                is_open[cell] = 1
    queue[0] = goal
    search_breadth_first(is_open, rows, cols, distance, queue, 1)
    if distance[rover] == UNREACHABLE:
        return -1
    return step_nearer(distance, rover, heading, rows, cols)
