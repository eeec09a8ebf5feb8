"""Policies of other libraries: models that turn an observation into logits.

They decide without the guard of our own networks, and remember what their file carries as states.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from marsexplorer.observation import STATE_VALUES, action_masks, decode, rover_position
from marsexplorer.policies.base import INVALID_LOGIT, begin_draws, draw_action


class Evaluation(Protocol):
    """Turns observations into logits, and may carry states through an episode."""

    def begin(self) -> None:
        """Start an episode: forget the states."""

    def evaluate(
        self, observation: NDArray[Any], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], float]:
        """Turn an observation [rows, cols] and an action mask bool[4] into scores.

        Returns:
            Logits float32[4] and a value, NaN if there is none.
        """


class ImportedPolicy:
    """Take the move with the highest logit, or draw it.

    evaluation  turns an observation and an action mask into logits and a value
    size      (rows, cols) it was made for; None for any
    raw       whether it expects uint8 codes instead of the float32 state matrix
    masked    whether invalid moves are left out, as MaskablePPO does; else it may drive into an
              obstacle
    samples   whether each move is drawn from the probabilities; the seed of `reset` fixes the draws
    has_value  whether it gives a value; else values are NaN

    thought()  after `act`: probabilities float32[4] of the moves, and the value of the last
               observation
    """

    def __init__(
        self,
        name: str,
        evaluation: Evaluation,
        size: tuple[int, int] | None,
        raw: bool,
        masked: bool,
        samples: bool = False,
        has_value: bool = False,
    ) -> None:
        self.name, self.size, self.has_value = name, size, has_value
        self._evaluation, self._raw, self._masked, self._samples = evaluation, raw, masked, samples
        self._thought = np.full(4, 0.25, np.float32), float("nan")
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Begin an episode; the seed fixes what is drawn."""
        self._draws = begin_draws(seed)
        self._evaluation.begin()

    def act(self, observation: NDArray[Any]) -> int:
        """Choose an action 0..3; ValueError if it was made for another size."""
        codes = decode(observation)
        if self.size is not None and codes.shape != self.size:
            raise ValueError(wrong_size(self.name, self.size, codes.shape))
        mask = action_masks(codes[None], np.array([rover_position(codes)]))[0]
        logits, value = self._evaluation.evaluate(codes if self._raw else STATE_VALUES[codes], mask)
        if self._masked and mask.any():
            logits = np.where(mask, logits, np.float32(INVALID_LOGIT))
        shares = np.exp(logits - logits.max())
        probabilities = (shares / shares.sum()).astype(np.float32)
        self._thought = (probabilities, value)
        if self._samples:
            return draw_action(probabilities, self._draws)
        return int(logits.argmax())

    def thought(self) -> tuple[NDArray[np.float32], float]:
        """(probabilities float32[4], value) of the last observation."""
        return self._thought


def wrong_size(name: str, made_for: tuple[int, ...], came: tuple[int, ...]) -> str:
    """The sentence for a board that a policy was not made for."""
    board = "x".join(map(str, came))
    size = "x".join(map(str, made_for))
    return f"the policy {name} was made for {size} and cannot play {board}; choose that size, or another policy"
