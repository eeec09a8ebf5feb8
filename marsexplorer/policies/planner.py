"""A planner that imagines whole tours: unknown cells are taken to be free, so a tour can be walked to its end.

At every move it makes some tours from where the rover stands and takes the first step of the shortest. A tour goes,
until 99 % of the grid is known, to the cell of the highest gain / way^p (1 + noise u), looking round at every cell
passed. The first tour is plain (p = 1, no noise); the others draw p, the noise and how corners are cut. No cell that
the rover has stood on is a goal. Re-planning could in principle go round in circles, so the loop guard stands behind
it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import inlined, kernel
from marsexplorer.policies.base import Memory, mix, valid_moves
from marsexplorer.policies.guard import LoopGuard
from marsexplorer.policies.kernels.grid import FAR, Ground, enough, neighbour, open_cells
from marsexplorer.policies.kernels.visibility import Outlook, fill_boards, learn, look

TOURS = 16
FULL_TOURS_CELLS = 42 * 42
"""Larger grids get fewer tours, in proportion and at least 2: a move at 84x84 takes 25 ms with 4 tours, 80 ms with 16."""

POWERS = 9
"""Weights way^-(k/4) for k = 0..8."""


@inlined
def random_bits(state):
    """Return 64 random bits; state is uint64[1] (splitmix64)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@inlined
def below(state, limit):
    """Return a random whole number in 0..limit-1."""
    return np.int64(((random_bits(state) >> np.uint64(32)) * np.uint64(limit)) >> np.uint64(32))


@inlined
def uniform(state):
    """Return a random float64 in [0, 1)."""
    return np.float64(random_bits(state) >> np.uint64(11)) / 9007199254740992.0


@kernel
def next_goal(
    cell, rows, cols, visited, imagined, blocked, radius, sight, seen, is_open, distance, queue, weight, noise, largest, state
):
    """Return the goal of the highest noisy utility from a cell, or -1; `distance` is right wherever it is nearer.

    weight   float64[n + 1], the value of a way's length
    largest  cells in the lidar's disc: once largest * weight cannot beat the best, farther cells are not looked at
    """
    distance[:] = FAR
    distance[cell] = 0
    queue[0] = cell
    head, tail = 0, 1
    best, best_value = -1, 0.0
    while head < tail:
        here = queue[head]
        head += 1
        way = distance[here]
        if largest * weight[way] * (1.0 + noise) <= best_value:
            break
        if way > 0 and visited[here] == 0:
            row = here // cols
            gain = look(imagined, blocked, row, here - row * cols, radius, sight, seen)
            if gain > 0:
                value = gain * weight[way]
                if noise > 0.0:
                    value *= 1.0 + noise * uniform(state)
                if value > best_value:
                    best, best_value = here, value
        for action in range(4):
            near = neighbour(here, action, rows, cols)
            if near >= 0 and is_open[near] and distance[near] == FAR:
                distance[near] = way + 1
                queue[tail] = near
                tail += 1
    return best


@kernel
def walk_back(goal, lean, rows, cols, visited, imagined, blocked, radius, sight, seen, distance, first):
    """Return how many cells are newly known on the way to a goal, walked from its end; first[0] becomes its first action.

    lean  0..3, the action preferred when several steps back are as short
    """
    known = 0
    cell = goal
    while distance[cell] > 0:
        if visited[cell] == 0:
            row = cell // cols
            found = look(imagined, blocked, row, cell - row * cols, radius, sight, seen)
            if found > 0:
                learn(imagined, row, cell - row * cols, radius, sight, seen)
                known += found
        for k in range(4):
            back = (lean + k) & 3
            near = neighbour(cell, back, rows, cols)
            if near >= 0 and distance[near] == distance[cell] - 1:
                cell = near
                first[0] = (back + 2) & 3
                break
    return known


@kernel
def plan(
    codes,
    visited,
    start,
    target,
    tours,
    radius,
    unknown,
    blocked,
    imagined,
    sight,
    seen,
    is_open,
    distance,
    queue,
    weights,
    state,
):
    """Return the first action of the shortest of `tours` imagined tours, or -1 when there is nothing to go for."""
    rows, cols = codes.shape
    fill_boards(codes, radius, unknown, blocked)
    open_cells(codes, True, is_open)
    at_start = np.int64(0)
    for row in range(rows):
        for col in range(cols):
            at_start += codes[row, col] != 0
    largest = 0
    for d_row in range(-radius, radius + 1):
        for d_col in range(-radius, radius + 1):
            largest += d_row * d_row + d_col * d_col <= radius * radius
    best_length, best_action = np.int64(FAR), np.int64(-1)
    first = queue[rows * cols :]
    for tour in range(tours):
        for i in range(unknown.shape[0]):
            for w in range(unknown.shape[1]):
                imagined[i, w] = unknown[i, w]
        power = 4 if tour == 0 else 2 + below(state, 7)
        noise = 0.0 if tour == 0 else 0.6 * uniform(state)
        cell, known, length, action = start, at_start, np.int64(0), np.int64(-1)
        while known < target and length < best_length:
            lean = below(state, 4)
            goal = next_goal(
                cell, rows, cols, visited, imagined, blocked, radius, sight, seen, is_open, distance, queue,
                weights[power], noise, largest, state,
            )  # fmt: skip
            if goal < 0:
                length += rows * cols  # the target is out of reach: worse than any tour that gets there
                break
            length += distance[goal]
            known += walk_back(goal, lean, rows, cols, visited, imagined, blocked, radius, sight, seen, distance, first)
            if action < 0:
                action = np.int64(first[0])
            cell = goal
        if action >= 0 and length < best_length:
            best_length, best_action = length, action
    return best_action


class Planner:
    """Randomised optimistic tours with the loop guard; its draws are a pure function of (seed, moves made)."""

    name = "planner"

    def __init__(self, sensor_radius: int = 6, tours: int = TOURS) -> None:
        if tours < 1:
            raise ValueError(f"tours must be at least 1, got {tours}")
        self.sensor_radius, self.tours = sensor_radius, tours
        self.memory = Memory()
        self.guard = LoopGuard(sensor_radius)
        self._state = np.zeros(1, np.uint64)
        self._room: tuple[Outlook, Ground, NDArray[np.uint64], NDArray[np.float64]] | None = None
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode and start the stream that `seed` names."""
        self._seed = mix(seed)
        self.memory.forget()
        self.guard.reset()

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3."""
        self.memory.take(observation)
        guarded = self.guard.overrule(self.memory)
        return self.decide(self.memory) if guarded is None else guarded

    def decide(self, memory: Memory) -> int:
        """Return what the planner would do, guard aside, for an episode remembered elsewhere."""
        codes = memory.codes
        outlook, ground, imagined, weights = self._room_for(codes.shape)
        row, col = memory.position
        known, share = int(np.count_nonzero(codes)), enough(codes.size)
        target = share if known < share else codes.size
        tours = min(self.tours, max(2, self.tours * FULL_TOURS_CELLS // codes.size))
        self._state[0] = mix(self._seed ^ memory.steps)
        action = plan(
            codes, memory.visited.reshape(-1), row * codes.shape[1] + col, target, tours, outlook.radius,
            outlook.unknown, outlook.blocked, imagined, outlook.sight, outlook.seen,
            ground.is_open, ground.distance, ground.queue, weights, self._state,
        )  # fmt: skip
        return int(action) if action >= 0 else next(iter(valid_moves(codes, row, col)), 0)

    def _room_for(self, shape: tuple[int, ...]) -> tuple[Outlook, Ground, NDArray[np.uint64], NDArray[np.float64]]:
        if self._room is None or self._room[0].shape != shape:
            outlook, ground = Outlook(shape, self.sensor_radius), Ground(shape)
            self._room = outlook, ground, np.zeros_like(outlook.unknown), way_weights(shape[0] * shape[1])
        return self._room


def way_weights(cells: int) -> NDArray[np.float64]:
    """Return float64[POWERS, cells + 1]: way^-(k/4) by k and way, from square roots alone, so the same on every platform."""
    fourth = np.sqrt(np.sqrt(np.maximum(np.arange(cells + 1, dtype=np.float64), 1.0)))
    weights = np.ones((POWERS, cells + 1))
    for k in range(1, POWERS):
        weights[k] = weights[k - 1] / fourth
    return weights
