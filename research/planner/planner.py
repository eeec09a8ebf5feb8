"""A planner that imagines whole tours through unknown cells, all taken as free.

At every move it makes some tours from where the rover stands and takes the first step of the
shortest. A tour goes, until 99 % of the grid is known, to the cell of the highest new / distance^p
(1 + noise u), scanning at every cell passed. The first tour is plain (p = 1, no noise); the others
draw p, the noise and how corners are cut. No cell that the rover has stood on is a goal. Planning
again could in principle go round in circles, so the loop guard stands behind it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.config import OBSTACLE
from marsexplorer.lidar import ONE
from marsexplorer.observation import valid_actions
from marsexplorer.policies.base import Memory
from marsexplorer.policies.guard import GuardedRule
from marsexplorer.policies.kernels.grid import (
    UNREACHABLE,
    Scratch,
    completion_target,
    grid_scratch,
    neighbour,
)
from marsexplorer.policies.kernels.visibility import (
    View,
    VisibilityMap,
    count_visible,
    fill_bitboards,
)
from marsexplorer.random_numbers import below, mix, uniform

TOURS = 16
FULL_TOURS_CELLS = 42 * 42
"""Larger grids get fewer tours, in proportion and at least 2: a move at 84x84 takes 25 ms with 4
tours, 80 ms with 16.
"""

POWERS = 9
"""Weights distance^-(k/4) for k = 0..8."""


@kernel
def mark_discovered(view, row, col):
    """Make the cells that `count_visible` left in `visible` known in `unknown`."""
    unknown, _, sight, visible, stride, radius = view
    side = 2 * radius + 1
    lane, words = np.int64(sight[0]), np.int64(sight[1])
    per_word = 64 // lane
    mask = (ONE << np.uint64(side)) - ONE
    shift = np.uint64(col & 63)
    i = 0
    for k in range(words):
        for j in range(min(per_word, side - i)):
            bits = (visible[k] >> np.uint64(j * lane)) & mask
            if bits != np.uint64(0):
                at = (row + i + j) * stride + (col >> 6)
                unknown[at] &= ~(bits << shift)
                if (col & 63) + side > 64:  # the window straddles two words
                    unknown[at + 1] &= ~(bits >> (np.uint64(64) - shift))
        i += per_word


@kernel
def next_goal(cell, rows, cols, visited, imagined, scratch, weight, noise, largest, state):
    """The goal of the highest noisy utility from a cell, or -1.

    `distance` is right wherever it is nearer than the goal.

    visited   uint8[rows * cols]; imagined: a view in which the tour's discoveries are known (see
              `visibility`)
    scratch   (is_open, distance, queue), see `grid`
    weight    float64[n + 1], what a distance makes of a new cell
    noise     0..1, the most that a utility is raised at random; state: uint64[1], of
              `random_numbers`
    largest   cells in the lidar's disc: once largest * weight cannot beat the best, farther cells
              are not considered
    """
    # A breadth-first search that judges each cell as it is taken from the queue, so that it can
    # stop early.
    is_open, distance, queue = scratch
    distance[:] = UNREACHABLE
    distance[cell] = 0
    queue[0] = cell
    head, tail = 0, 1
    best, best_value = -1, 0.0
    while head < tail:
        here = queue[head]
        head += 1
        moves = distance[here]
        # 1. Cells come nearest first: when even a full disc of new cells would not be enough,
        #    nothing farther is.
        if largest * weight[moves] * (1.0 + noise) <= best_value:
            break
        # 2. Judge the cell by what it is imagined to show.
        if moves > 0 and visited[here] == 0:
            row = here // cols
            new = count_visible(imagined, row, here - row * cols)
            if new > 0:
                value = new * weight[moves]
                if noise > 0.0:
                    value *= 1.0 + noise * uniform(state)
                if value > best_value:
                    best, best_value = here, value
        # 3. Go on to its neighbours.
        for action in range(4):
            near = neighbour(here, action, rows, cols)
            if near >= 0 and is_open[near] and distance[near] == UNREACHABLE:
                distance[near] = moves + 1
                queue[tail] = near
                tail += 1
    return best


@kernel
def walk_back(goal, preferred, rows, cols, visited, imagined, distance, first):
    """Walk back from a goal; return how many cells become known on the path.

    first[0] becomes the path's first action.

    preferred  0..3, the action taken when several steps back are as short; imagined: a view,
               brought up to date
    """
    new_cells = 0
    cell = goal
    while distance[cell] > 0:
        if visited[cell] == 0:
            row = cell // cols
            new = count_visible(imagined, row, cell - row * cols)
            if new > 0:
                mark_discovered(imagined, row, cell - row * cols)
                new_cells += new
        for k in range(4):
            back = (preferred + k) & 3
            near = neighbour(cell, back, rows, cols)
            if near >= 0 and distance[near] == distance[cell] - 1:
                cell = near
                first[0] = (back + 2) & 3  # walked forwards, this step is the opposite action
                break
    return new_cells


@kernel
def plan(codes, visited, start, target, tours, view, imagined, scratch, weights, state):
    """The first action of the shortest of `tours` imagined tours, or -1.

    codes, visited   uint8[rows, cols] and uint8[rows * cols]; start: the rover's cell; target:
                     cells to be known
    view, imagined   of `visibility`: what is known, and room for what a tour imagines; they share
                     all but `unknown`
    weights          float64[POWERS, n + 1], see `distance_weights`; state: uint64[1], of
                     `random_numbers`
    """
    rows, cols = codes.shape
    is_open, distance, queue = scratch
    radius = view[5]

    # 1. Set out what is known. Unknown cells count as open: a tour walks through them.
    fill_bitboards(codes, view)
    at_start = np.int64(0)
    for row in range(rows):
        for col in range(cols):
            is_open[row * cols + col] = codes[row, col] != OBSTACLE
            at_start += codes[row, col] != 0
    largest = 0
    for d_row in range(-radius, radius + 1):
        for d_col in range(-radius, radius + 1):
            largest += d_row * d_row + d_col * d_col <= radius * radius

    best_length, best_action = np.int64(UNREACHABLE), np.int64(-1)
    first = queue[rows * cols :]
    for tour in range(tours):
        # 2. Draw how this tour judges; the first is plain. Every tour imagines anew from what is
        #    known.
        unknown, of_tour = view[0], imagined[0]
        for i in range(unknown.shape[0]):
            of_tour[i] = unknown[i]
        power = 4 if tour == 0 else 2 + below(state, 7)
        noise = 0.0 if tour == 0 else 0.6 * uniform(state)

        # 3. Go from goal to goal until enough is known, or until the tour is no shorter than the
        #    best.
        cell, known_cells, length, action = start, at_start, np.int64(0), np.int64(-1)
        while known_cells < target and length < best_length:
            preferred = below(state, 4)
            goal = next_goal(
                cell, rows, cols, visited, imagined, scratch, weights[power], noise, largest, state
            )
            if goal < 0:
                length += rows * cols  # out of reach: worse than any tour that gets there
                break
            length += distance[goal]
            known_cells += walk_back(
                goal, preferred, rows, cols, visited, imagined, distance, first
            )
            if action < 0:
                action = np.int64(first[0])
            cell = goal

        # 4. Keep the first action of the shortest.
        if action >= 0 and length < best_length:
            best_length, best_action = length, action
    return best_action


PlannerArrays = tuple[View, View, Scratch, NDArray[np.float64]]
"""(view, imagined, scratch, weights), see `plan`."""


class Planner(GuardedRule):
    """Randomised optimistic tours with the loop guard.

    The draws follow from (seed, moves made).
    """

    name = "planner"

    def __init__(self, sensor_radius: int = 6, tours: int = TOURS) -> None:
        if tours < 1:
            raise ValueError(f"tours must be at least 1, got {tours}")
        super().__init__(sensor_radius)
        self.tours = tours
        self._state = np.zeros(1, np.uint64)
        self._shape: tuple[int, ...] = ()
        self._arrays: PlannerArrays | None = None
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode and start the stream that `seed` names."""
        super().reset(seed)
        self._seed = mix(seed)

    def decide(self, memory: Memory) -> int:
        """The planner's move without the guard, for an episode remembered elsewhere."""
        codes = memory.codes
        view, imagined, scratch, weights = self._arrays_for(codes.shape)
        row, col = memory.position
        known_cells, most = int(np.count_nonzero(codes)), completion_target(codes.size)
        target = most if known_cells < most else codes.size
        tours = min(self.tours, max(2, self.tours * FULL_TOURS_CELLS // codes.size))
        self._state[0] = mix(self._seed ^ memory.steps)
        action = plan(
            codes,
            memory.visited.reshape(-1),
            row * codes.shape[1] + col,
            target,
            tours,
            view,
            imagined,
            scratch,
            weights,
            self._state,
        )
        return int(action) if action >= 0 else next(iter(valid_actions(codes, row, col)), 0)

    def _arrays_for(self, shape: tuple[int, ...]) -> PlannerArrays:
        if self._arrays is None or self._shape != shape:
            self._shape = shape
            view = VisibilityMap(shape, self.sensor_radius).view
            imagined = (np.zeros_like(view[0]), *view[1:])  # shares all but `unknown`
            weights = distance_weights(math.prod(shape))
            self._arrays = view, imagined, grid_scratch(shape), weights
        return self._arrays


def distance_weights(cells: int) -> NDArray[np.float64]:
    """distance^-(k/4) by k and distance: float64[POWERS, cells + 1].

    They are made of square roots and divisions alone, which IEEE 754 rounds in one way, so they are
    the same everywhere.
    """
    fourth = np.sqrt(np.sqrt(np.maximum(np.arange(cells + 1, dtype=np.float64), 1.0)))
    weights = np.ones((POWERS, cells + 1))
    for k in range(1, POWERS):
        weights[k] = weights[k - 1] / fourth
    return weights
