"""Tours of viewpoints on a known terrain, compiled, and random changes of them.

A tour is `count` viewpoints: their cells in points int32[capacity], and for each one of TIE_BREAKS
ways of choosing among the shortest paths to it in tie_breaks int8[capacity]. Cells are flat, row *
cols + col. What is seen is held as bits, cell c as bit c of uint64[words]. A known `terrain` is the
tuple of

    neighbours  int32[n, 4]        the cells one move north, east, south, west; -1 for off the grid
                or an obstacle
    distance    uint16[n, n]       moves between free cells, NO_PATH where there is no path
    views       uint64[n, words]   what the lidar shows from each free cell
    first_word  int64[n]           the first word of a cell's view that is not zero
    end_word    int64[n]           one more than the last word that is not zero

and `free`, int32[...], the cells that can be reached from the start.
"""

from __future__ import annotations

import numpy as np

from marsexplorer.compiled import inlined, kernel, popcount
from marsexplorer.lidar import ONE
from marsexplorer.policies.kernels.grid import neighbour
from marsexplorer.policies.kernels.visibility import count_visible
from marsexplorer.random_numbers import below

TIE_BREAKS = 6
"""0..3: try the four directions from that one on; 4: turn whenever possible; 5: go straight on
whenever possible.
"""

DRAWS = 400
"""Random cells that are tried to find one that sees a given cell."""

NO_PATH = 65535
FIRST_ACTION = 1
"""The last action before the first one, for the ties that are broken by going straight on or by
turning.
"""

INFINITE = 1 << 40
U = np.uint64


@kernel
def fill_distances(terrain, neighbours, distance, queue):
    """Fill neighbours and distance for a terrain bool[rows, cols], True if blocked.

    queue  int32[n], scratch
    """
    rows, cols = terrain.shape
    n = rows * cols
    # 1. Link each cell to the free cells around it.
    for cell in range(n):
        for action in range(4):
            there = neighbour(cell, action, rows, cols)
            if there >= 0 and terrain[there // cols, there % cols]:
                there = -1
            neighbours[cell, action] = there
    # 2. Search breadth first from every free cell: all moves cost the same.
    distance[:] = NO_PATH
    for source in range(n):
        if terrain[source // cols, source % cols]:
            continue
        row = distance[source]
        row[source] = 0
        queue[0] = source
        head, tail = 0, 1
        while head < tail:
            cell = queue[head]
            head += 1
            for action in range(4):
                there = neighbours[cell, action]
                if there >= 0 and row[there] == NO_PATH:
                    row[there] = row[cell] + 1
                    queue[tail] = there
                    tail += 1


@kernel
def fill_views(view, terrain, views, first_word, end_word):
    """Fill views, first_word and end_word from a `visibility` view.

    In the view all cells are unknown and obstacles blocked.
    """
    _, _, sight, visible, _, radius = view
    rows, cols = terrain.shape
    side = 2 * radius + 1
    lane = np.int64(sight[0])
    per_word = 64 // lane
    for cell in range(rows * cols):
        row, col = cell // cols, cell % cols
        first_word[cell] = end_word[cell] = 0
        if terrain[row, col]:
            continue
        # 1. Scan from the cell: the result is a window of bits around it.
        count_visible(view, row, col)
        # 2. Move the window's bits to their places in the grid; remember which words they touch, so
        #    that later stages skip the rest of the grid.
        first_word[cell] = views.shape[1]
        for i in range(side):
            r = row + i - radius
            bits = visible[i // per_word] >> U((i % per_word) * lane)
            for j in range(side):
                c = col + j - radius
                if (bits >> U(j)) & ONE and 0 <= r < rows and 0 <= c < cols:
                    bit = r * cols + c
                    views[cell, bit >> 6] |= ONE << U(bit & 63)
                    first_word[cell] = min(first_word[cell], bit >> 6)
                    end_word[cell] = max(end_word[cell], (bit >> 6) + 1)


@inlined
def step_toward(cell, row, tie_break, last, neighbours):
    """The action of a step that shortens the distance to the goal.

    row has the distances, last is the last action.
    """
    best = 0
    wanted = row[cell] - 1
    for k in range(4):
        if tie_break < 4:
            action = (tie_break + k) & 3
        elif tie_break == 4:
            action = (last + 1 + 2 * k) & 3 if k < 2 else (last + 2 * (k - 2)) & 3
        else:
            action = (last + k) & 3
        there = neighbours[cell, action]
        if there >= 0 and row[there] == wanted:
            best = action
            break
    return best


@kernel
def walk_tour(start, points, tie_breaks, count, terrain, covered, path):
    """The moves of a tour; its cells go to path, what they show to covered.

    path     int32[...], whose first moves + 1 cells are written
    covered  uint64[words]

    A path longer than its array is cut there: the array is far longer than any tour that could be
    the shortest.
    """
    neighbours, distance, views, first_word, end_word = terrain
    for w in range(covered.shape[0]):
        covered[w] = views[start, w]
    cell, last, length = start, FIRST_ACTION, 0
    path[0] = start
    for k in range(count):
        goal = points[k]
        row = distance[goal]
        tie_break = tie_breaks[k]
        while cell != goal and length < path.shape[0] - 1:
            last = step_toward(cell, row, tie_break, last, neighbours)
            cell = neighbours[cell, last]
            length += 1
            path[length] = cell
            for w in range(first_word[cell], end_word[cell]):
                covered[w] |= views[cell, w]
    return length


@inlined
def count_covered(covered):
    count = U(0)
    for w in range(covered.shape[0]):
        count += popcount(covered[w])
    return np.int64(count)


@kernel
def draw_uncovered_cell(covered, cells, state):
    """A random cell that is not covered, or -1 if all `cells` are."""
    missing = cells - count_covered(covered)
    if missing <= 0:
        return -1
    pick = below(state, missing)
    for w in range(covered.shape[0]):
        here = min(64, cells - 64 * w) - np.int64(popcount(covered[w]))
        if pick >= here:
            pick -= here
            continue
        for cell in range(64 * w, cells):
            if not (covered[w] >> U(cell & 63)) & ONE:
                if pick == 0:
                    return cell
                pick -= 1
    return -1


@kernel
def draw_cell_seeing(target, views, free, state):
    """A random free cell that sees a target cell, or -1 after DRAWS draws."""
    for _ in range(DRAWS):
        cell = free[below(state, free.shape[0])]
        if (views[cell, target >> 6] >> U(target & 63)) & ONE:
            return cell
    return -1


@kernel
def find_cheapest_position(start, cell, points, count, distance):
    """The position in the tour, 0..count, where one more viewpoint costs least."""
    best, best_cost = count, np.int64(INFINITE)
    row = distance[cell]
    before = start
    for k in range(count + 1):
        cost = np.int64(row[before])
        if k < count:
            cost += np.int64(row[points[k]]) - np.int64(distance[before, points[k]])
        if cost < best_cost:
            best, best_cost = k, cost
        if k < count:
            before = points[k]
    return best


@kernel
def insert_viewpoint(points, tie_breaks, count, position, cell, tie_break):
    """Insert a viewpoint at a position of a tour of `count` viewpoints."""
    for k in range(count, position, -1):
        points[k], tie_breaks[k] = points[k - 1], tie_breaks[k - 1]
    points[position], tie_breaks[position] = cell, tie_break


@kernel
def remove_viewpoint(points, tie_breaks, count, position):
    """Remove the viewpoint at a position of a tour of `count` viewpoints."""
    for k in range(position, count - 1):
        points[k], tie_breaks[k] = points[k + 1], tie_breaks[k + 1]


@kernel
def copy_tour(points, tie_breaks, source, target, count):
    """Copy tour number `source` to number `target`."""
    for k in range(count):
        points[target, k], tie_breaks[target, k] = points[source, k], tie_breaks[source, k]


@kernel
def change_tour(start, points, tie_breaks, count, covered, terrain, free, cells, state):
    """Make one random change in place; return the viewpoints, -1 if unchanged.

    The kinds of changes have these shares: 18 % insert, 37 % move, 12 % remove, 13 % tie break, 8 %
    reverse, 8 % carry, 4 % swap.
    """
    neighbours, distance, views = terrain[0], terrain[1], terrain[2]
    kind = below(state, 100)
    capacity = points.shape[0]
    # 1. Insert a viewpoint where it costs least; two times in three one that sees a cell which the
    #    tour does not show yet.
    if count == 0 or kind < 18:
        if count == capacity:
            return -1
        cell = -1
        if kind < 12 or count == 0:
            target = draw_uncovered_cell(covered, cells, state)
            if target >= 0:
                cell = draw_cell_seeing(target, views, free, state)
        if cell < 0:
            cell = free[below(state, free.shape[0])]
        position = find_cheapest_position(start, cell, points, count, distance)
        insert_viewpoint(points, tie_breaks, count, position, cell, below(state, TIE_BREAKS))
        return count + 1
    k = below(state, count)
    # 2. Move a viewpoint by one to three steps.
    if kind < 55:
        cell = points[k]
        for _ in range(1 + below(state, 3)):
            there = neighbours[cell, below(state, 4)]
            if there >= 0:
                cell = there
        if cell == points[k]:
            return -1
        points[k] = cell
        return count
    # 3. Remove a viewpoint.
    if kind < 67:
        remove_viewpoint(points, tie_breaks, count, k)
        return count - 1
    # 4. Take another of the shortest paths to a viewpoint: it shows other cells on the way.
    if kind < 80:
        tie_breaks[k] = below(state, TIE_BREAKS)
        return count
    if count < 2:
        return -1
    # 5. Reverse a stretch of the tour (2-opt).
    if kind < 88:
        other = below(state, count)
        low, high = min(k, other), max(k, other)
        if low == high:
            return -1
        while low < high:
            points[low], points[high] = points[high], points[low]
            tie_breaks[low], tie_breaks[high] = tie_breaks[high], tie_breaks[low]
            low, high = low + 1, high - 1
        return count
    # 6. Carry a viewpoint to the cheapest or to a random position (or-opt).
    if kind < 96:
        cell, tie_break = points[k], tie_breaks[k]
        remove_viewpoint(points, tie_breaks, count, k)
        position = (
            find_cheapest_position(start, cell, points, count - 1, distance)
            if kind < 93
            else below(state, count)
        )
        insert_viewpoint(points, tie_breaks, count - 1, position, cell, tie_break)
        return count
    # 7. Swap two viewpoints.
    other = below(state, count)
    points[k], points[other] = points[other], points[k]
    return count
