"""Distances on a known map by breadth-first search, and ties between steps.

Cells are flat, row * cols + col. Distances are int32, in moves, UNREACHABLE where no path is known.
Kernels that search take a `scratch` tuple (is_open uint8[n], distance int32[n], queue int32[n +
1]), see `grid_scratch`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel
from marsexplorer.config import OBSTACLE, UNKNOWN

UNREACHABLE = 2**30
"""Distance of a cell that cannot be reached (moves)."""


@inlined
def completion_target(cells):
    """How many of so many cells count as all: 99 %, the default beta.

    A policy is not given the environment's own beta.
    """
    return (99 * cells + 99) // 100


@inlined
def neighbour(cell, action, rows, cols):
    """The cell one move away, or -1 off the grid.

    action  0 north, 1 east, 2 south, 3 west
    """
    row = cell // cols
    col = cell - row * cols
    near = -1
    if action == 0:
        if row > 0:
            near = cell - cols
    elif action == 1:
        if col < cols - 1:
            near = cell + 1
    elif action == 2:
        if row < rows - 1:
            near = cell + cols
    elif col > 0:
        near = cell - 1
    return near


@kernel
def find_open_cells(codes, is_open):
    """Write where the rover may plan to go, free cells and its own, as uint8[n]."""
    cols = codes.shape[1]
    for row in range(codes.shape[0]):
        for col in range(cols):
            code = codes[row, col]
            is_open[row * cols + col] = code != OBSTACLE and code != UNKNOWN


@kernel
def search_breadth_first(is_open, rows, cols, distance, queue, sources):
    """Search from the first `sources` cells of the queue; return how many are reached.

    distance  int32[n], rewritten: moves from the nearest source over open cells, UNREACHABLE
              elsewhere
    queue     int32[n], afterwards the reached cells, nearest first; ties in the order north, east,
              south, west of expansion
    """
    distance[:] = UNREACHABLE
    for k in range(sources):
        distance[queue[k]] = 0
    head, reached = 0, sources
    while head < reached:
        cell = queue[head]
        head += 1
        for action in range(4):
            near = neighbour(cell, action, rows, cols)
            if near >= 0 and is_open[near] and distance[near] == UNREACHABLE:
                distance[near] = distance[cell] + 1
                queue[reached] = near
                reached += 1
    return reached


@kernel
def search_first_actions(is_open, rows, cols, start, distance, first_actions, queue):
    """Search from one cell for the first moves of paths; return the cells reached.

    distance       int32[n], rewritten: moves from `start`, UNREACHABLE where there is no path, -1
                   where a cell is not open
    first_actions  uint8[n], rewritten: the actions that begin a shortest path, bit 1 << action
                   each; 0 where there is none
    queue          int32[n + 1], as `search_breadth_first` leaves it

    A neighbour of the source is one move nearer to a cell than the source is when its bit is set,
    and one move farther when not: on a grid every cycle has an even number of moves. So one search
    gives the distances from all four neighbours.
    """
    for cell in range(rows * cols):
        distance[cell] = UNREACHABLE if is_open[cell] else -1
        first_actions[cell] = 0
    distance[start], queue[0] = 0, start
    head, reached, last_row = 0, 1, (rows - 1) * cols
    while head < reached:
        cell = queue[head]
        head += 1
        col = cell % cols
        moves, first = distance[cell] + 1, first_actions[cell]
        for action in range(4):
            # 1. The four cells are those of `neighbour`, off the grid the cell itself, to which
            #    nothing is done.
            near = cell
            if action == 0:
                near = cell - cols if cell >= cols else cell
            elif action == 1:
                near = cell + 1 if col < cols - 1 else cell
            elif action == 2:
                near = cell + cols if cell < last_row else cell
            else:
                near = cell - 1 if col > 0 else cell

            # 2. Cells come nearest first, so what begins the paths to this one is complete and is
            #    handed on. There is no branch here: which cells are new cannot be foreseen, and
            #    wrong guesses would take most of the time.
            was = distance[near]
            is_new = was == UNREACHABLE
            distance[near] = moves if is_new else was
            queue[reached] = near
            reached += np.int64(is_new)
            begins = np.uint8(1 << action) if moves == 1 else first
            first_actions[near] |= begins if is_new or was == moves else np.uint8(0)
    return reached


@kernel
def step_nearer(distance, cell, heading, rows, cols):
    """The action that goes one move nearer to the sources of `distance`.

    -1 at a source, and where there is no path. Straight on if that goes nearer, else the first
    of north, east, south, west that does.
    """
    here = distance[cell]
    if here == 0 or here == UNREACHABLE:
        return -1
    for k in range(-1, 4):
        action = heading if k < 0 else k
        near = neighbour(cell, action, rows, cols)
        if near >= 0 and distance[near] == here - 1:
            return action
    return -1


@kernel
def is_frontier(codes, row, col):
    """Whether a cell shares an edge or a corner with an unknown one."""
    for r in range(max(0, row - 1), min(codes.shape[0], row + 2)):
        for c in range(max(0, col - 1), min(codes.shape[1], col + 2)):
            if codes[r, c] == UNKNOWN:
                return True
    return False


Scratch = tuple[NDArray[np.uint8], NDArray[np.int32], NDArray[np.int32]]
"""(is_open, distance, queue); the queue has a place to spare."""


def grid_scratch(shape: tuple[int, ...]) -> Scratch:
    """Scratch arrays for searches on one grid shape."""
    cells = shape[0] * shape[1]
    return np.zeros(cells, np.uint8), np.zeros(cells, np.int32), np.zeros(cells + 1, np.int32)
