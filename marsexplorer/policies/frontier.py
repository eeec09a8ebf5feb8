"""The two rules of section 3.5 that need no learning: the nearest frontier, and the best yield for the way.

A frontier cell is a known free cell sharing an edge or a corner with an unknown one. Candidates are cells that the rover
has not yet stood on (it has scanned from those: they show nothing more, whatever is expected of them) and from which at
least one unknown cell is expected to be seen. `frontier-cost` takes frontier cells alone; `frontier-utility` takes every
candidate, since a good view of a frontier need not be on it.

Both rules re-plan after every move and still never wander for ever: while nothing new is seen the candidates stay as
they are, and each move either takes one of them off the list by standing on it, or brings the nearest (the best) one
nearer. And they end only when all is seen that can be: whatever cell a reachable cell can see, one of its free
neighbours is a candidate (radius 2 or more: sight passes corners).
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.policies.base import Memory, valid_moves
from marsexplorer.policies.kernels.grid import Ground, is_frontier, open_cells, spread, step_down
from marsexplorer.policies.kernels.visibility import Outlook, fill_boards, look


@kernel
def toward_nearest(codes, visited, row, col, heading, radius, unknown, blocked, sight, seen, is_open, distance, queue):
    """Return the first action of a shortest way to the nearest candidate, or -1 when there is none.

    Of several nearest candidates and ways, the one that begins straight on, then north, east, south, west.
    """
    rows, cols = codes.shape
    fill_boards(codes, radius, unknown, blocked)
    open_cells(codes, False, is_open)
    sources = 0
    for cell in range(rows * cols):
        if is_open[cell]:
            r = cell // cols
            c = cell - r * cols
            is_new = visited[r, c] == 0 and is_frontier(codes, r, c)
            if is_new and look(unknown, blocked, r, c, radius, sight, seen) > 0:
                queue[sources] = cell
                sources += 1
    if sources == 0:
        return -1
    spread(is_open, rows, cols, distance, queue, sources)
    return step_down(distance, row * cols + col, heading, rows, cols)


@kernel
def toward_best(codes, visited, row, col, heading, radius, unknown, blocked, sight, seen, is_open, distance, queue):
    """Return the first action of a shortest way to the candidate of the highest gain over squared way, or -1.

    Ties go to the nearer, then to the northernmost, then to the westernmost candidate; the way begins as in `toward_nearest`.
    """
    rows, cols = codes.shape
    fill_boards(codes, radius, unknown, blocked)
    open_cells(codes, False, is_open)
    queue[0] = row * cols + col
    reached = spread(is_open, rows, cols, distance, queue, 1)
    best, best_gain, best_way = -1, 0, 1
    for k in range(1, reached):
        cell = queue[k]
        r = cell // cols
        c = cell - r * cols
        if visited[r, c]:
            continue
        gain = look(unknown, blocked, r, c, radius, sight, seen)
        way = int(distance[cell])
        # gain / way^2 compared exactly, in whole numbers
        mine, theirs = gain * best_way * best_way, best_gain * way * way
        if mine > theirs or (mine == theirs and gain > 0 and way == best_way and cell < best):
            best, best_gain, best_way = cell, gain, way
    if best < 0:
        return -1
    queue[0] = best
    spread(is_open, rows, cols, distance, queue, 1)
    return step_down(distance, row * cols + col, heading, rows, cols)


class Frontier:
    """A frontier rule with the memory and scratch arrays of its episode; when nothing is left to see it makes valid moves."""

    name = ""
    rule = staticmethod(toward_nearest)

    def __init__(self, sensor_radius: int = 6) -> None:
        self.sensor_radius = sensor_radius
        self.memory = Memory()
        self._room: tuple[Outlook, Ground] | None = None

    def reset(self, seed: int) -> None:
        """Forget the last episode; the rules draw nothing."""
        del seed
        self.memory.forget()

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3."""
        self.memory.take(observation)
        return self.decide(self.memory)

    def decide(self, memory: Memory) -> int:
        """Return the action for an episode remembered elsewhere (other policies fall back on a rule)."""
        codes = memory.codes
        if self._room is None or self._room[0].shape != codes.shape:
            self._room = Outlook(codes.shape, self.sensor_radius), Ground(codes.shape)
        outlook, ground = self._room
        row, col = memory.position
        action = self.rule(
            codes,
            memory.visited,
            row,
            col,
            memory.heading,
            outlook.radius,
            outlook.unknown,
            outlook.blocked,
            outlook.sight,
            outlook.seen,
            ground.is_open,
            ground.distance,
            ground.queue,
        )
        return int(action) if action >= 0 else next(iter(valid_moves(codes, row, col)), 0)


class FrontierCost(Frontier):
    """Cost of section 3.5: the shortest known way to the nearest frontier cell."""

    name = "frontier-cost"
    rule = staticmethod(toward_nearest)


class FrontierUtility(Frontier):
    """Utility of section 3.5: expected new cells over squared path length, over all cells within reach."""

    name = "frontier-utility"
    rule = staticmethod(toward_best)
