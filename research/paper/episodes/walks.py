"""Untrained walks over an empty grid, to compare the courses of policies with.

All begin in the north-west corner and end when the grid is swept; `quadrants` then tells whether
they make a U.

    cells    Hamiltonian paths: every cell once, drawn at random among all of them
    blocks   the same on BLOCKS x BLOCKS blocks of cells, every one of these paths once. The lidar
             shows more than a block from its middle, so this is a sweep at the scale at which a
             rover with a radius of 6 has to drive
    nearest  a walk to the nearest cell where it has not been, ties broken at random
    lidar    a walk to the nearest cell that it has not seen with a radius of 6 on a grid without
             obstacles, ties broken at random, until 99 % are seen

Random Hamiltonian paths are made by backbite moves (Mansfield 1982; Oberdorf, Ferguson, Jacobsen
and Kondev 2006, "Secondary structures in long compact polymers"): an end of the path is joined to a
random neighbour of it, and the edge that closes a loop is taken out, which gives another
Hamiltonian path. A move and the one that undoes it are equally likely, so all paths that can be
reached from each other come up equally often. Both ends have to move: with one of them held in the
corner, only 20 of the 52 paths on 4 x 4 can be reached. So paths are drawn until one begins in a
corner, and that one is mirrored to the north-west. Tests list all paths on small grids: each can be
reached, and they come up equally often.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.config import CORE_VERSION
from marsexplorer.policies.kernels.grid import neighbour
from marsexplorer.random_numbers import below, draw_below, mix
from research.paper.episodes.quadrants import quadrant_course
from research.paper.jobs import Line, OnProgress, read_lines, write_lines

BLOCKS = 4
"""Blocks a side of the null `blocks`; of 21 cells each is about 5 x 5."""

RADIUS = 6
"""Of the lidar (cells) in the null `lidar`."""

SEEN_SHARE = 0.99
"""Share of the cells at which the null `lidar` ends."""

MIXING = 10
"""Backbite moves before a path is looked at for the first time: MIXING n ln(n)^2 for n cells,
163,500 for 21 x 21.
"""

MIXING_BETWEEN = 1
"""The same from one look at the path to the next."""


def boustrophedon(rows: int, cols: int) -> NDArray[np.int32]:
    """The Hamiltonian path east along the first row, west along the second, and so on.

    int32[rows * cols]
    """
    cells = np.arange(rows * cols, dtype=np.int32).reshape(rows, cols)
    cells[1::2] = cells[1::2, ::-1].copy()
    return cells.reshape(-1)


@kernel
def backbite(path, place, rows, cols, moves, state):
    """Make `moves` random backbite moves of the path's ends.

    path   int32[rows * cols], a Hamiltonian path; changed in place
    place  int32[rows * cols], where in the path each cell stands; kept in step with it
    state  uint64[1], of `random_numbers`
    """
    last = path.shape[0] - 1
    for _ in range(moves):
        # 1. Draw an end and a neighbour of it. Off the grid nothing is done, so that each of the
        #    eight draws is as likely from every path: this is what makes a move and its reverse
        #    equally likely.
        draw = below(state, 8)
        is_last = draw >= 4
        there = neighbour(path[last if is_last else 0], draw & 3, rows, cols)
        if there < 0:
            continue
        # 2. Join them. The loop is opened at the neighbour: what lies between it and the end is
        #    walked the other way round. Where the neighbour is the cell next to the end on the
        #    path, this changes nothing.
        low, high = (place[there] + 1, last) if is_last else (0, place[there] - 1)
        while low < high:
            path[low], path[high] = path[high], path[low]
            place[path[low]], place[path[high]] = low, high
            low, high = low + 1, high - 1


def random_hamiltonian_path(rows: int, cols: int, seed: int) -> NDArray[np.int32]:
    """A random Hamiltonian path from (0, 0), cells flat: int32[rows * cols].

    Of the paths between two corners, either direction is as likely. rows, cols: at least 2 each.
    """
    cells = rows * cols
    path, state = boustrophedon(rows, cols), np.array([mix(seed)], np.uint64)
    place = np.empty_like(path)
    place[path] = np.arange(cells, dtype=np.int32)
    unit = math.ceil(cells * math.log(cells) ** 2)
    moves = MIXING * unit
    while True:
        backbite(path, place, rows, cols, moves, state)
        mirrored = from_corner(path if next_bit(state) else path[::-1], rows, cols)
        if mirrored is not None:
            return mirrored
        moves = MIXING_BETWEEN * unit


@kernel
def next_bit(state):
    """0 or 1, the next of the stream whose running key is state, uint64[1]."""
    return below(state, 2)


def from_corner(path: NDArray[np.int32], rows: int, cols: int) -> NDArray[np.int32] | None:
    """The path mirrored so that it begins in (0, 0), None if it begins in no corner."""
    row, col = np.divmod(path, cols)
    if row[0] not in (0, rows - 1) or col[0] not in (0, cols - 1):
        return None
    if row[0]:
        row = rows - 1 - row
    if col[0]:
        col = cols - 1 - col
    return np.asarray(row * cols + col, np.int32)


def hamiltonian_paths(rows: int, cols: int) -> Iterator[list[int]]:
    """Yield every Hamiltonian path from (0, 0), cells flat.

    There are 52 on 4 x 4, 824 on 5 x 5 and 22,144 on 6 x 6.
    """
    cells = rows * cols
    neighbours = [
        [int(there) for a in range(4) if (there := neighbour(cell, a, rows, cols)) >= 0]
        for cell in range(cells)
    ]
    path, visited = [0], [True] + [False] * (cells - 1)

    def extend() -> Iterator[list[int]]:
        if len(path) == cells:
            yield path.copy()
            return
        for cell in neighbours[path[-1]]:
            if not visited[cell]:
                path.append(cell)
                visited[cell] = True
                yield from extend()
                visited[path.pop()] = False

    yield from extend()


def nearest_walk(rows: int, cols: int, reach: int, share: float, seed: int) -> list[int]:
    """A walk from (0, 0) that always goes to the nearest unseen cell, as flat cells.

    reach  cells that are seen from a cell are those at a distance of at most `reach` between the
           centres; 0: itself alone
    share  of all cells, 0..1: the walk ends when so many are seen

    Distances to go are those of a grid without obstacles, |rows| + |cols|. After each move a goal
    is drawn among the nearest cells, and one of the two ways to begin with when both bring it
    nearer.
    """
    row_of, col_of = np.divmod(np.arange(rows * cols), cols)
    seen = np.zeros(rows * cols, np.bool_)
    row, col, draws = 0, 0, 0
    path = [0]
    while True:
        down, right = row_of - row, col_of - col
        seen |= down * down + right * right <= reach * reach
        if seen.sum() >= share * rows * cols:
            return path
        distance = np.where(seen, rows + cols, abs(down) + abs(right))
        nearest = np.flatnonzero(distance == distance.min())
        goal = nearest[draw_below(seed, draws, len(nearest))]
        ways = [step for step in ((np.sign(down[goal]), 0), (0, np.sign(right[goal]))) if any(step)]
        step = ways[draw_below(seed, draws + 1, len(ways))]
        row, col, draws = row + int(step[0]), col + int(step[1]), draws + 2
        path.append(row * cols + col)


NULLS = {
    "cells": "random Hamiltonian path through every cell",
    "blocks": f"all Hamiltonian paths through {BLOCKS} x {BLOCKS} blocks",
    "nearest": "nearest cell not yet visited, random ties",
    "lidar": f"nearest cell not yet seen with radius {RADIUS}, random ties",
}
"""The walks by name, in words."""

WALKS = 1000
"""Of each kind, but for `blocks`, where there are 52 paths in all."""


@dataclass(frozen=True)
class NullWalks:
    """The courses of walks of one kind, as a job.

    kind  a name in NULLS
    size  side of the square grid, cells
    """

    kind: str
    size: int = 21
    walks: int = WALKS

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"figure6-null-{self.kind}-{self.size}"

    @property
    def identity(self) -> Line:
        """The walks, JSON-ready."""
        is_complete = self.kind == "blocks"
        return {
            "kind": "null",
            "figure": 6,
            "null": self.kind,
            "core_version": CORE_VERSION,
            "rows": self.size,
            "cols": self.size,
            "walks": None if is_complete else self.walks,
            "is_complete": is_complete,
        }

    def is_done(self, folder: Path) -> bool:
        """Whether the result of these walks is under `folder / name`."""
        lines = read_lines(folder / self.name / "result.jsonl")
        return len(lines) == 1 and self.identity.items() <= lines[0].items()

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        """Walk; the result's `moves` is the mean length of a walk, in moves."""
        is_blocks, side = self.kind == "blocks", self.size
        paths: Iterable[list[int]] = map(self._walk, range(self.walks))
        if is_blocks:
            paths, side = hamiltonian_paths(BLOCKS, BLOCKS), BLOCKS
        lengths, courses = [], []
        for path in paths:
            lengths.append(len(path) - 1)
            courses.append(quadrant_course(path, side, side).code)
            on_progress(len(courses) / self.walks)
        moves = None if is_blocks else round(sum(lengths) / len(lengths), 2)
        line = {**self.identity, "moves": moves, "courses": courses}
        write_lines(folder / self.name / "result.jsonl", [line])

    def _walk(self, seed: int) -> list[int]:
        if self.kind == "cells":
            path: list[int] = random_hamiltonian_path(self.size, self.size, seed).tolist()
            return path
        reach, share = (RADIUS, SEEN_SHARE) if self.kind == "lidar" else (0, 1.0)
        return nearest_walk(self.size, self.size, reach, share, seed)
