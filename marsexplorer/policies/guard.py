"""The loop guard: it takes over from a policy that repeats itself.

A policy that decides from the map alone may do so for ever.

When the pair (position, cells known) occurs a second time in an episode, the guard follows the
nearest frontier until something new is seen, and for at least GUARD_STEPS moves. The frontier rule
always finds something new if there is anything, so a guarded policy finishes every terrain that can
be finished.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.compiled import kernel
from marsexplorer.policies.base import Memory
from marsexplorer.policies.frontier import FrontierCost

GUARD_STEPS = 8
"""Fewest moves that the guard makes once it has taken over."""


@kernel
def update_guard(
    cells: NDArray[np.int64],
    known_counts: NDArray[np.int64],
    known_before: NDArray[np.int64],
    steps_left: NDArray[np.int64],
    known_at_start: NDArray[np.int64],
    is_guarded: NDArray[np.bool_],
) -> None:
    """Update the guard of a stack of episodes with their newest observations.

    Call it once a move.

    cells           int64[num], row * cols + col of each rover
    known_counts    int64[num], cells known
    known_before    int64[num, rows * cols], how many were known when the rover last stood on a
                    cell, -1 before that
    steps_left      int64[num], moves that the guard still makes
    known_at_start  int64[num], cells known when it took over
    is_guarded      bool[num], written: whether the guard makes this move
    """
    for i in range(cells.shape[0]):
        # 1. What is known never shrinks, so the pair was met before exactly when the cell's last
        #    count is today's.
        if steps_left[i] == 0 and known_before[i, cells[i]] == known_counts[i]:
            steps_left[i], known_at_start[i] = GUARD_STEPS, known_counts[i]
        known_before[i, cells[i]] = known_counts[i]

        # 2. The last of its moves is repeated until something new has been seen.
        is_guarded[i] = steps_left[i] > 0
        if steps_left[i] > 1 or (steps_left[i] == 1 and known_counts[i] != known_at_start[i]):
            steps_left[i] -= 1


class LoopGuard:
    """Watches one episode's memory and takes over when it repeats itself.

    overruled   moves that the guard has made in this episode
    """

    def __init__(self, sensor_radius: int = 6) -> None:
        self._frontier = FrontierCost(sensor_radius)
        self._is_guarded: NDArray[np.bool_] = np.zeros(1, np.bool_)
        self.reset()

    def reset(self) -> None:
        """Forget the last episode."""
        self._known_before: NDArray[np.int64] = np.zeros((1, 0), np.int64)
        self._steps_left: NDArray[np.int64] = np.zeros(1, np.int64)
        self._known_at_start: NDArray[np.int64] = np.full(1, -1)
        self.overruled = 0
        self._is_guarded[0] = False

    def overrule(self, memory: Memory) -> int | None:
        """The action to take instead of the policy's, or None; once an observation."""
        rows, cols = memory.codes.shape
        if self._known_before.shape[1] != rows * cols:
            self._known_before = np.full((1, rows * cols), -1)
        cell = memory.position[0] * cols + memory.position[1]
        known_count = int(np.count_nonzero(memory.codes))
        state = (self._known_before, self._steps_left, self._known_at_start, self._is_guarded)
        update_guard(np.array([cell]), np.array([known_count]), *state)
        if not self._is_guarded[0]:
            return None
        self.overruled += 1
        return self._frontier.decide(memory)

    def goal(self) -> tuple[int, int] | None:
        """The cell (row, col) that the guard goes to, if it chose the last action."""
        return self._frontier.goal() if self._is_guarded[0] else None


class GuardedRule:
    """A rule with its memory and the loop guard; a subclass has `decide`."""

    def __init__(self, sensor_radius: int) -> None:
        self.sensor_radius = sensor_radius
        self.memory, self.guard = Memory(), LoopGuard(sensor_radius)

    def reset(self, seed: int) -> None:
        """Forget the last episode."""
        del seed
        self.memory.forget()
        self.guard.reset()

    def act(self, observation: NDArray[Any]) -> int:
        """Choose an action 0..3: the guard's if it takes over."""
        self.memory.observe(observation)
        guarded = self.guard.overrule(self.memory)
        return self.decide(self.memory) if guarded is None else guarded

    def decide(self, memory: Memory) -> int:
        """Choose the action for an episode remembered elsewhere, without the guard."""
        raise NotImplementedError
