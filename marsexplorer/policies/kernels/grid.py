"""Walking on a known map: distances over free cells, which step to take when several are as good, how much map is enough.

Cells are flat, row * cols + col. Distances are int32 with FAR where there is no way. Scratch arrays come from the caller.
"""

from __future__ import annotations

import numpy as np

from marsexplorer.compiled import inlined, kernel
from marsexplorer.config import OBSTACLE, UNKNOWN

FAR = 2**30
"""Distance of a cell that cannot be reached (moves)."""


@inlined
def enough(cells):
    """Return how many of so many cells count as all: 99 %, the default beta, which a policy is not told."""
    return (99 * cells + 99) // 100


@inlined
def neighbour(cell, action, rows, cols):
    """Return the cell one move away, or -1 off the grid. action: 0 north, 1 east, 2 south, 3 west."""
    row = cell // cols
    col = cell - row * cols
    found = -1
    if action == 0:
        if row > 0:
            found = cell - cols
    elif action == 1:
        if col < cols - 1:
            found = cell + 1
    elif action == 2:
        if row < rows - 1:
            found = cell + cols
    elif col > 0:
        found = cell - 1
    return found


@kernel
def open_cells(codes, bold, is_open):
    """Write uint8[n]: 1 where the rover may plan to go, known free cells and its own; unknown ones too when `bold`."""
    cols = codes.shape[1]
    for row in range(codes.shape[0]):
        for col in range(cols):
            code = codes[row, col]
            is_open[row * cols + col] = code != OBSTACLE and (bold or code != UNKNOWN)


@kernel
def spread(is_open, rows, cols, distance, queue, filled):
    """Return how many cells are reached from the first `filled` cells of the queue, whose distances are 0.

    distance  int32[n], rewritten: moves from the nearest source over open cells, FAR elsewhere
    queue     int32[n], afterwards the reached cells, nearest first; ties in the order north, east, south, west of expansion
    """
    distance[:] = FAR
    for k in range(filled):
        distance[queue[k]] = 0
    head = 0
    while head < filled:
        cell = queue[head]
        head += 1
        for action in range(4):
            near = neighbour(cell, action, rows, cols)
            if near >= 0 and is_open[near] and distance[near] == FAR:
                distance[near] = distance[cell] + 1
                queue[filled] = near
                filled += 1
    return filled


@kernel
def first_moves(distance, queue, reached, rows, cols, ways):
    """Write uint8[n] of the reached cells: by which moves from the source a shortest way begins, bit 1 << action each.

    distance, queue  as `spread` leaves them from one source; 0 for the source
    A neighbour of the source is one move nearer to a cell than the source is when its bit is set, and one move farther when
    not: on a grid every way round takes an even number of moves.
    """
    ways[queue[0]] = 0
    for k in range(1, reached):
        cell = queue[k]
        found, nearer = 0, distance[cell] - 1
        for action in range(4):
            near = neighbour(cell, action, rows, cols)
            if near >= 0 and distance[near] == nearer:
                found |= ways[near] if nearer > 0 else 1 << (action ^ 2)
        ways[cell] = found


@kernel
def step_down(distance, cell, heading, rows, cols):
    """Return the action that goes one nearer to the sources of `distance`: straight on if that does, else the first of
    north, east, south, west that does; -1 at a source or where there is no way."""
    here = distance[cell]
    if here == 0 or here == FAR:
        return -1
    for k in range(-1, 4):
        action = heading if k < 0 else k
        near = neighbour(cell, action, rows, cols)
        if near >= 0 and distance[near] == here - 1:
            return action
    return -1


@kernel
def is_frontier(codes, row, col):
    """Return whether a cell shares an edge or a corner with an unknown one."""
    for r in range(max(0, row - 1), min(codes.shape[0], row + 2)):
        for c in range(max(0, col - 1), min(codes.shape[1], col + 2)):
            if codes[r, c] == UNKNOWN:
                return True
    return False


class Ground:
    """Scratch arrays for one grid shape; the queue has a word to spare."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        rows, cols = shape
        self.is_open = np.zeros(rows * cols, np.uint8)
        self.distance = np.zeros(rows * cols, np.int32)
        self.queue = np.zeros(rows * cols + 1, np.int32)
