"""The floor every policy is measured from: valid moves, uniformly."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from marsexplorer.policies.base import decode, draw, rover_position, valid_moves


class RandomPolicy:
    """Uniform over the moves known to be valid; north when there is none.

    Its draws are a pure function of (seed, number of moves made), the same on every platform and library version.
    """

    name = "random"

    def __init__(self) -> None:
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Start the stream that `seed` names."""
        self._seed, self._moves = seed, 0

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3."""
        codes = decode(observation)
        moves = valid_moves(codes, *rover_position(codes))
        self._moves += 1
        if not moves:
            return 0
        return moves[draw(self._seed, self._moves, len(moves))]
