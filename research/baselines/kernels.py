"""Searches and tours of the rules from elsewhere, compiled.

Cells are flat: row * cols + col. Place 0 of a tour's arrays is the rover, k the stop of cluster k.
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
from marsexplorer.random_numbers import below
from research.informed.tours import find_cheapest_position

MOST_CLUSTERS = 255
"""That a tour visits; more, which show less, wait for another one."""
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
def next_best_view(codes, visited, rover, samples, discount, goal, view, scratch, stream):
    """The best of some cells drawn within reach, or -1 if none shows any.

    The best has the most unknown cells in sight times exp(-discount moves). The last goal is a
    candidate too, and stays if no other is better. A drawn cell that was visited is not replaced,
    so there are fewer candidates than samples where much was.

    codes, visited   uint8[rows, cols]; view and scratch as `visibility` and `grid` have them
    goal             the last one, or -1
    stream           uint64[1], the running key of what is drawn
    """
    rows, cols = codes.shape
    is_open, distance, queue = scratch
    fill_bitboards(codes, view)
    find_open_cells(codes, is_open)
    queue[0] = rover
    reached = search_breadth_first(is_open, rows, cols, distance, queue, 1)

    best, most = -1, 0.0
    for k in range(-1, samples):
        cell = goal if k < 0 else queue[below(stream, reached)]
        if cell < 0:
            continue
        r = cell // cols
        c = cell - r * cols
        if visited[r, c]:
            continue
        worth = count_visible(view, r, c) * np.exp(-discount * distance[cell])
        if worth > most:
            best, most = cell, worth
    return best


@kernel
def find_clusters(codes, visited, rover, reach, view, scratch, shown, candidates, stops):
    """Find the clusters of frontier cells within the rover's reach; return how many.

    codes, visited  uint8[rows, cols]; view and scratch as `visibility` and `grid` have them
    reach           how far the cells of a cluster are from its stop, in steps from one to the next
    shown           int32[cells], rewritten
    candidates      int32[cells], rewritten: the frontier cells, nearest first
    stops           int32[MOST_CLUSTERS + 1], written: the rover, and the cell of each cluster that
                    shows most, of equals the nearest
    """
    rows, cols = codes.shape
    is_open, distance, queue = scratch
    fill_bitboards(codes, view)
    find_open_cells(codes, is_open)

    # 1. The candidates of `frontier-cost`, with the unknown cells that they show.
    queue[0] = rover
    reached = search_breadth_first(is_open, rows, cols, distance, queue, 1)
    shown[:] = 0
    count = 0
    for k in range(reached):
        cell = queue[k]
        r = cell // cols
        c = cell - r * cols
        if visited[r, c] == 0 and is_frontier(codes, r, c):
            shown[cell] = count_visible(view, r, c)
            if shown[cell] > 0:
                candidates[count] = cell
                count += 1

    # 2. The one that shows most is a stop; those connected with it belong to it, and show nothing
    #    from then on.
    stops[0] = rover
    clusters = 0
    while clusters < stops.shape[0] - 1:
        stop = -1
        for k in range(count):
            if shown[candidates[k]] > (shown[stop] if stop >= 0 else 0):
                stop = candidates[k]
        if stop < 0:
            break
        clusters += 1
        stops[clusters] = stop
        distance[stop], shown[stop], queue[0] = 0, 0, stop
        head, tail = 0, 1
        while head < tail:
            cell = queue[head]
            head += 1
            if distance[cell] == reach:
                continue
            row = cell // cols
            col = cell - row * cols
            for r in range(max(0, row - 1), min(rows, row + 2)):
                for c in range(max(0, col - 1), min(cols, col + 2)):
                    near = r * cols + c
                    if shown[near] > 0:
                        distance[near], shown[near] = distance[cell] + 1, 0
                        queue[tail] = near
                        tail += 1
    return clusters


@kernel
def measure_between(codes, count, stops, scratch, between):
    """Write the moves between the rover and `count` stops on the known map.

    between  int32[places, places]
    """
    rows, cols = codes.shape
    is_open, distance, queue = scratch
    find_open_cells(codes, is_open)
    for k in range(count + 1):
        queue[0] = stops[k]
        search_breadth_first(is_open, rows, cols, distance, queue, 1)
        for j in range(count + 1):
            between[k, j] = distance[stops[j]]


@kernel
def order_tour(count, between, tour, gaps):
    """Write a short open tour from place 0 over places 1 to `count`.

    between  int32[places, places], the moves from one to another
    tour     int32[places], whose first `count` are written
    gaps     int32[places], scratch
    """
    # 1. Nearest insertion: the place that is nearest to the tour goes where it costs least.
    for place in range(count + 1):
        gaps[place] = between[0, place]
    for length in range(count):
        nearest = -1
        for place in range(1, count + 1):
            if gaps[place] >= 0 and (nearest < 0 or gaps[place] < gaps[nearest]):
                nearest = place
        position = find_cheapest_position(0, nearest, tour, length, between)
        for k in range(length, position, -1):
            tour[k] = tour[k - 1]
        tour[position] = nearest
        gaps[nearest] = -1
        for place in range(1, count + 1):
            gaps[place] = min(gaps[place], between[nearest, place])

    # 2. 2-opt: reverse a stretch as long as that makes the tour shorter.
    is_shorter = True
    while is_shorter:
        is_shorter = False
        for low in range(count):
            before = tour[low - 1] if low > 0 else 0
            for high in range(low + 1, count):
                saved = between[before, tour[low]] - between[before, tour[high]]
                if high + 1 < count:
                    after = tour[high + 1]
                    saved += between[tour[high], after] - between[tour[low], after]
                if saved > 0:
                    i, j = low, high
                    while i < j:
                        tour[i], tour[j] = tour[j], tour[i]
                        i, j = i + 1, j - 1
                    is_shorter = True


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
