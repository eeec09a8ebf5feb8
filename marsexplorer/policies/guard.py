"""A way out of loops: a policy that decides from the map alone may go round in circles for ever.

When the pair (position, cells known) comes up a second time in an episode, the guard follows the nearest frontier
until something new has been seen, and for at least 8 moves. The frontier rule always ends in something new where
there is anything, so a guarded policy finishes every terrain that can be finished.
"""

from __future__ import annotations

import numpy as np

from marsexplorer.policies.base import Memory
from marsexplorer.policies.frontier import FrontierCost

MOVES = 8


class LoopGuard:
    """Watches an episode's memory and takes over when it repeats itself."""

    def __init__(self, sensor_radius: int = 6) -> None:
        self._frontier = FrontierCost(sensor_radius)
        self.reset()

    def reset(self) -> None:
        """Forget the last episode."""
        self._met: set[tuple[int, int, int]] = set()
        self._left, self._stuck_at = 0, -1
        self.overruled = 0

    def overrule(self, memory: Memory) -> int | None:
        """Return the action to take instead of the policy's, or None; call it once for every observation taken in."""
        known = int(np.count_nonzero(memory.codes))
        here = (*memory.position, known)
        if self._left == 0 and here in self._met:
            self._left, self._stuck_at = MOVES, known
        self._met.add(here)
        if self._left == 0:
            return None
        if self._left > 1 or known != self._stuck_at:
            self._left -= 1
        self.overruled += 1
        return self._frontier.decide(memory)
