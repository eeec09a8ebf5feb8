"""The two rules of section 3.5: the nearest frontier, and the best yield.

A frontier cell is a known free cell sharing an edge or a corner with an unknown one. Candidates are
cells that the rover has not yet stood on (it scanned from those already) and from which at least
one unknown cell is expected to be seen. `frontier-cost` takes only frontier cells;
`frontier-utility` takes every candidate, since a good view of a frontier need not be on it.

Both rules plan again after every move, and yet they end. While nothing new is seen the candidates
stay the same, and each move either takes one of them off the list by standing on it, or brings the
nearest (the best) one nearer. They end only when all is seen that can be. `frontier-cost` may run
out of frontier cells before that: where sight passes a corner that the rover cannot pass, free
cells out of reach lie behind it, with all that borders on them. Then it takes every candidate. On
solvable terrains of the paper all free cells are within reach, so this is never needed from radius
2 on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.observation import valid_actions
from marsexplorer.policies.base import Memory, cell_at
from marsexplorer.policies.kernels.grid import (
    Scratch,
    find_open_cells,
    grid_scratch,
    is_frontier,
    neighbour,
    search_breadth_first,
    step_nearer,
)
from marsexplorer.policies.kernels.visibility import VisibilityMap, count_visible, fill_bitboards


@kernel
def toward_nearest(codes, visited, row, col, heading, view, scratch, goal):
    """The first action of a shortest path to the nearest candidate, or -1 without one.

    codes, visited  uint8[rows, cols]; view and scratch as `visibility` and `grid` describe them
    goal            int64[1], written: the candidate, row * cols + col, or -1

    Of several nearest candidates and paths, the one that begins straight on, then north, east,
    south, west.
    """
    rows, cols = codes.shape
    is_open, distance, queue = scratch
    goal[0] = -1
    fill_bitboards(codes, view)
    find_open_cells(codes, is_open)

    # 1. Every candidate becomes a source: an unvisited frontier cell that shows something. One
    #    search from all of them gives the rover's distance to the nearest; step to a cell that is
    #    one move nearer.
    # 2. Where none is within reach, every unvisited cell that shows something becomes a source.
    for with_others in (False, True):
        sources = 0
        for cell in range(rows * cols):
            if is_open[cell]:
                r = cell // cols
                c = cell - r * cols
                is_new = visited[r, c] == 0 and (with_others or is_frontier(codes, r, c))
                if is_new and count_visible(view, r, c) > 0:
                    queue[sources] = cell
                    sources += 1
        search_breadth_first(is_open, rows, cols, distance, queue, sources)
        action = step_nearer(distance, row * cols + col, heading, rows, cols)
        if action >= 0:
            # 3. The candidate is where going on like this ends.
            goal[0], ahead = row * cols + col, action
            while ahead >= 0:
                goal[0] = neighbour(goal[0], ahead, rows, cols)
                ahead = step_nearer(distance, goal[0], ahead, rows, cols)
            return action
    return -1


@kernel
def toward_best(codes, visited, row, col, heading, view, scratch, goal):
    """The first action towards the candidate with most new cells per squared distance.

    -1 without a candidate. Ties go to the nearer, then to the northernmost, then to the
    westernmost candidate; the path begins as in `toward_nearest`, which describes the
    arguments.
    """
    rows, cols = codes.shape
    is_open, distance, queue = scratch
    fill_bitboards(codes, view)
    find_open_cells(codes, is_open)

    # 1. Search from the rover: the queue then holds every cell within reach, nearest first.
    queue[0] = row * cols + col
    reached = search_breadth_first(is_open, rows, cols, distance, queue, 1)

    # 2. Choose the best candidate. new / distance^2 is compared by cross-multiplication, exactly,
    #    in whole numbers.
    best, best_new, best_distance = -1, 0, 1
    for k in range(1, reached):
        cell = queue[k]
        r = cell // cols
        c = cell - r * cols
        if visited[r, c]:
            continue
        new = count_visible(view, r, c)
        moves = int(distance[cell])
        mine, theirs = new * best_distance * best_distance, best_new * moves * moves
        if mine > theirs or (mine == theirs and new > 0 and moves == best_distance and cell < best):
            best, best_new, best_distance = cell, new, moves
    goal[0] = best
    if best < 0:
        return -1

    # 3. Search from the candidate and step to a cell that is one move nearer.
    queue[0] = best
    search_breadth_first(is_open, rows, cols, distance, queue, 1)
    return step_nearer(distance, row * cols + col, heading, rows, cols)


class Frontier:
    """A frontier rule with its memory; with nothing left to see it moves validly."""

    name = ""
    rule = staticmethod(toward_nearest)

    def __init__(self, sensor_radius: int = 6) -> None:
        self.sensor_radius = sensor_radius
        self.memory = Memory()
        self._arrays: tuple[VisibilityMap, Scratch] | None = None
        self._goal: NDArray[np.int64] = np.full(1, -1)

    def reset(self, seed: int) -> None:
        """Forget the last episode; the rules draw nothing."""
        del seed
        self.memory.forget()
        self._goal[0] = -1

    def act(self, observation: NDArray[Any]) -> int:
        self.memory.observe(observation)
        return self.decide(self.memory)

    def decide(self, memory: Memory) -> int:
        """Choose the action for an episode that another policy remembers."""
        codes = memory.codes
        if self._arrays is None or self._arrays[0].shape != codes.shape:
            self._arrays = VisibilityMap(codes.shape, self.sensor_radius), grid_scratch(codes.shape)
        visibility, scratch = self._arrays
        row, col = memory.position
        arrays = (visibility.view, scratch, self._goal)
        action = self.rule(codes, memory.visited, row, col, memory.heading, *arrays)
        return int(action) if action >= 0 else next(iter(valid_actions(codes, row, col)), 0)

    def goal(self) -> tuple[int, int] | None:
        """The cell (row, col) that the last action leads towards, or None."""
        cols = self._arrays[0].shape[1] if self._arrays else 1
        return cell_at(int(self._goal[0]), cols)


class FrontierCost(Frontier):
    """Cost of section 3.5: the shortest known path to the nearest frontier cell."""

    name = "frontier-cost"
    rule = staticmethod(toward_nearest)


class FrontierUtility(Frontier):
    """Utility of section 3.5: expected new cells over squared path length.

    It considers all cells within reach.
    """

    name = "frontier-utility"
    rule = staticmethod(toward_best)
