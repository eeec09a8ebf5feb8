"""Policies made elsewhere: whatever turns one observation into four scores, played as it would play itself.

They decide from the state matrix alone, without memory and without the guard of our own networks: the highest score wins.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import VALUES
from marsexplorer.policies.base import decode, rover_position, valid_moves

STATE: NDArray[np.float32] = np.array(VALUES, np.float32)
NEVER = -1e9

Decide = Callable[[NDArray[Any], NDArray[np.bool_]], tuple[NDArray[np.float32], float]]
"""(observation [rows, cols], valid moves bool[4]) -> (scores float32[4], value, not a number when there is none)."""


class ImportedPolicy:
    """Takes the move that scores highest.

    size     (rows, cols) it was made for; None for any
    raw      whether it expects uint8 codes instead of the float32 state matrix
    masked   whether invalid moves are left out, as sb3-contrib's MaskablePPO does; else it may drive into a wall

    thought()  after `act`: probabilities float32[4] of the moves, and the value of the last observation
    """

    def __init__(self, name: str, decide: Decide, size: tuple[int, int] | None, raw: bool, masked: bool) -> None:
        self.name, self.size = name, size
        self._decide, self._raw, self._masked = decide, raw, masked
        self._thought: tuple[NDArray[np.float32], float] = (np.full(4, 0.25, np.float32), float("nan"))

    def reset(self, seed: int) -> None:
        """Nothing is remembered and nothing drawn."""
        del seed

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3; ValueError for an observation of another size than it was made for."""
        codes = decode(observation)
        if self.size is not None and codes.shape != self.size:
            raise ValueError(wrong_size(self.name, self.size, codes.shape))
        valid = np.isin(np.arange(4), list(valid_moves(codes, *rover_position(codes))))
        scores, value = self._decide(codes if self._raw else STATE[codes], valid)
        if self._masked and valid.any():
            scores = np.where(valid, scores, np.float32(NEVER))
        shares = np.exp(scores - scores.max())
        self._thought = ((shares / shares.sum()).astype(np.float32), value)
        return int(scores.argmax())

    def thought(self) -> tuple[NDArray[np.float32], float]:
        """Return (probabilities float32[4], value) of the last observation."""
        return self._thought


def wrong_size(name: str, made_for: tuple[int, ...], came: tuple[int, ...]) -> str:
    """Return the sentence for a board that a policy was not made for."""
    board = "x".join(map(str, came))
    own = "x".join(map(str, made_for))
    return f"the policy {name} was made for {own} and cannot play {board}; choose that size, or another policy"
