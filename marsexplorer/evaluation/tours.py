"""The compiled search behind the informed planner: a tour of viewpoints on a map known wholly, improved by annealing.

A tour is `count` viewpoints, cells in points int32[room], and for each one of LEANS ways of breaking ties among the shortest
paths to it in leans int8[room]. Cells are flat, row * cols + col. What is seen is held as bits, cell c as bit c of
uint64[words].

    near      int32[n, 4]      the cells one move north, east, south, west; -1 for off the grid or an obstacle
    distance  uint16[n, n]     moves between free cells, FAR16 where there is no way
    views     uint64[n, words] what the lidar shows from each free cell; only words low[c] .. high[c] - 1 are not zero
    free      int32[...]       the cells that can be reached from the start
"""

from __future__ import annotations

import numpy as np

from marsexplorer.compiled import inlined, kernel, popcount
from marsexplorer.policies.kernels.grid import neighbour
from marsexplorer.policies.kernels.visibility import count_visible
from marsexplorer.random_numbers import below, uniform

LEANS = 6
"""0..3: try the four directions from that one on; 4: turn whenever possible; 5: go straight on whenever possible."""

DEAR = 1.5
"""Moves that a cell short of the target is worth."""

FAR16 = 65535
U = np.uint64
ONE = np.uint64(1)


@kernel
def survey(terrain, near, distance, queue):
    """Fill near and distance for a terrain bool[rows, cols], True where blocked."""
    rows, cols = terrain.shape
    n = rows * cols
    for cell in range(n):
        for action in range(4):
            there = neighbour(cell, action, rows, cols)
            if there >= 0 and terrain[there // cols, there % cols]:
                there = -1
            near[cell, action] = there
    distance[:] = FAR16
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
                there = near[cell, action]
                if there >= 0 and row[there] == FAR16:
                    row[there] = row[cell] + 1
                    queue[tail] = there
                    tail += 1


@kernel
def sights(view, terrain, views, low, high):
    """Fill views, low and high from a `visibility` view in which every cell is unknown and the obstacles are blocked."""
    _, _, sight, visible, _, radius = view
    rows, cols = terrain.shape
    side = 2 * radius + 1
    lane = np.int64(sight[0])
    per_word = 64 // lane
    for cell in range(rows * cols):
        row, col = cell // cols, cell % cols
        low[cell] = high[cell] = 0
        if terrain[row, col]:
            continue
        count_visible(view, row, col)
        low[cell] = views.shape[1]
        for i in range(side):
            r = row + i - radius
            bits = visible[i // per_word] >> U((i % per_word) * lane)
            for j in range(side):
                c = col + j - radius
                if (bits >> U(j)) & ONE and 0 <= r < rows and 0 <= c < cols:
                    bit = r * cols + c
                    views[cell, bit >> 6] |= ONE << U(bit & 63)
                    low[cell] = min(low[cell], bit >> 6)
                    high[cell] = max(high[cell], (bit >> 6) + 1)


@inlined
def step_toward(cell, row, lean, last, near):
    """Return the action of the next step down `row` (distances to the goal), ties broken by the lean."""
    best = 0
    wanted = row[cell] - 1
    for k in range(4):
        if lean < 4:
            action = (lean + k) & 3
        elif lean == 4:
            action = (last + 1 + 2 * k) & 3 if k < 2 else (last + 2 * (k - 2)) & 3
        else:
            action = (last + k) & 3
        there = near[cell, action]
        if there >= 0 and row[there] == wanted:
            best = action
            break
    return best


@kernel
def walk(start, points, leans, count, distance, near, views, low, high, covered, path):
    """Return the moves of a tour; path int32[...] becomes its cells from the start on, covered what they show together.

    A path that would outgrow its room is cut there: the room is far longer than any tour worth keeping.
    """
    for w in range(covered.shape[0]):
        covered[w] = views[start, w]
    cell, last, length = start, 1, 0
    path[0] = start
    for k in range(count):
        goal = points[k]
        row = distance[goal]
        lean = leans[k]
        while cell != goal and length < path.shape[0] - 1:
            last = step_toward(cell, row, lean, last, near)
            cell = near[cell, last]
            length += 1
            path[length] = cell
            for w in range(low[cell], high[cell]):
                covered[w] |= views[cell, w]
    return length


@inlined
def known_cells(covered):
    """Return how many bits are set."""
    count = U(0)
    for w in range(covered.shape[0]):
        count += popcount(covered[w])
    return np.int64(count)


@kernel
def unseen_cell(covered, cells, state):
    """Return a random cell not covered, or -1."""
    missing = cells - known_cells(covered)
    if missing <= 0:
        return -1
    pick = below(state, missing)
    for cell in range(cells):
        if not (covered[cell >> 6] >> U(cell & 63)) & ONE:
            if pick == 0:
                return cell
            pick -= 1
    return -1


@kernel
def looking_at(target, views, free, state):
    """Return a random free cell that sees a target cell, or -1 after many draws."""
    for _ in range(400):
        cell = free[below(state, free.shape[0])]
        if (views[cell, target >> 6] >> U(target & 63)) & ONE:
            return cell
    return -1


@kernel
def cheapest_place(start, cell, points, count, distance):
    """Return where in the tour a viewpoint costs the fewest moves."""
    best, best_cost = count, np.int64(1) << 40
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
def put(points, leans, count, place, cell, lean):
    """Insert a viewpoint."""
    for k in range(count, place, -1):
        points[k], leans[k] = points[k - 1], leans[k - 1]
    points[place], leans[place] = cell, lean


@kernel
def drop(points, leans, count, place):
    """Take a viewpoint out."""
    for k in range(place, count - 1):
        points[k], leans[k] = points[k + 1], leans[k + 1]


@kernel
def copy_tour(points, leans, source, target, count):
    """Copy tour number `source` to number `target`."""
    for k in range(count):
        points[target, k], leans[target, k] = points[source, k], leans[source, k]


@kernel
def change(start, points, leans, count, covered, distance, near, views, free, cells, state):
    """Make one random change in place and return the new number of viewpoints, -1 when nothing was changed."""
    kind = below(state, 100)
    room = points.shape[0]
    if count == 0 or kind < 18:
        if count == room:
            return -1
        cell = -1
        if kind < 12 or count == 0:
            target = unseen_cell(covered, cells, state)
            if target >= 0:
                cell = looking_at(target, views, free, state)
        if cell < 0:
            cell = free[below(state, free.shape[0])]
        put(points, leans, count, cheapest_place(start, cell, points, count, distance), cell, below(state, LEANS))
        return count + 1
    k = below(state, count)
    if kind < 55:
        cell = points[k]
        for _ in range(1 + below(state, 3)):
            there = near[cell, below(state, 4)]
            if there >= 0:
                cell = there
        if cell == points[k]:
            return -1
        points[k] = cell
        return count
    if kind < 67:
        drop(points, leans, count, k)
        return count - 1
    if kind < 80:
        leans[k] = below(state, LEANS)
        return count
    if count < 2:
        return -1
    if kind < 88:
        other = below(state, count)
        low, high = min(k, other), max(k, other)
        if low == high:
            return -1
        while low < high:
            points[low], points[high] = points[high], points[low]
            leans[low], leans[high] = leans[high], leans[low]
            low, high = low + 1, high - 1
        return count
    if kind < 96:
        cell, lean = points[k], leans[k]
        drop(points, leans, count, k)
        place = cheapest_place(start, cell, points, count - 1, distance) if kind < 93 else below(state, count)
        put(points, leans, count - 1, place, cell, lean)
        return count
    other = below(state, count)
    points[k], points[other] = points[other], points[k]
    return count


@kernel
def anneal(
    start, target, changes, warm, cold, distance, near, views, low, high, free, cells, points, leans, covered, path, state
):  # fmt: skip
    """Return the number of viewpoints of the shortest tour found that shows `target` cells, or -1.

    points, leans  [3, room]: the tour as it is, the tour as it might be, and the best, which is left there
    covered        uint64[2, words], room for what the first two show; path int32[...], room for a walk's cells
    """
    count, best_count, best_length = 0, -1, np.int64(1) << 40
    length = walk(start, points[0], leans[0], count, distance, near, views, low, high, covered[0], path)
    cost = length + DEAR * max(0, target - known_cells(covered[0]))
    cooling = (cold / warm) ** (1.0 / changes)
    heat = warm
    for _ in range(changes):
        heat *= cooling
        copy_tour(points, leans, 0, 1, count)
        new = change(start, points[1], leans[1], count, covered[0], distance, near, views, free, cells, state)
        if new < 0:
            continue
        length = walk(start, points[1], leans[1], new, distance, near, views, low, high, covered[1], path)
        short = max(0, target - known_cells(covered[1]))
        cost_new = length + DEAR * short
        if cost_new <= cost or uniform(state) < np.exp((cost - cost_new) / heat):
            cost, count = cost_new, new
            copy_tour(points, leans, 1, 0, count)
            for w in range(covered.shape[1]):
                covered[0, w] = covered[1, w]
            if short == 0 and length < best_length:
                best_length, best_count = length, count
                copy_tour(points, leans, 0, 2, count)
    return best_count
