"""The floor that every policy is measured from: valid moves, uniformly."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from marsexplorer.observation import decode, rover_position, valid_actions
from marsexplorer.random_numbers import draw_below


class RandomPolicy:
    """Draw uniformly from the moves known to be valid; go north when there is none.

    The draws are a pure function of (seed, number of moves made), the same on every platform and library version.
    """

    name = "random"

    def __init__(self) -> None:
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Start the stream that `seed` names."""
        self._seed, self._steps = seed, 0

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3."""
        codes = decode(observation)
        actions = valid_actions(codes, *rover_position(codes))
        self._steps += 1
        if not actions:
            return 0
        return actions[draw_below(self._seed, self._steps, len(actions))]
