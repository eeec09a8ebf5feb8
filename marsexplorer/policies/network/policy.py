"""The policy of a network over our features, and its ONNX model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import ROVER
from marsexplorer.observation import valid_actions
from marsexplorer.policies.base import INVALID_LOGIT, Memory, begin_draws, draw_action
from marsexplorer.policies.files.onnx import OnnxModel, check_outputs
from marsexplorer.policies.guard import LoopGuard
from marsexplorer.policies.network.batch import ActionScorer
from marsexplorer.policies.network.features import (
    ACTION_FEATURES,
    MOVE_NUMBERS,
    FeatureExtractor,
    RememberedFeatures,
)
from marsexplorer.policies.network.priced_features import NUMBERS_PER_RULE, RULES, SIDES

ACTS = ("greedy with guard", "greedy", "samples")
"""The ways in which a network's policy chooses its moves."""
NEGLIGIBLE_SHARE = 1e-5
"""Weights of the prior that count less than this at a size only count by rounding."""
WEIGHTS = {
    "prior": (len(SIDES), MOVE_NUMBERS),
    "policy_head.0.weight": (64, 128 + MOVE_NUMBERS + 4),
    "value_head.0.weight": (64, 128 + 4 * MOVE_NUMBERS),
}
"""Name -> shape of the weights of `training.network.Net` that the numbers of moves are
multiplied with.
"""


class OnnxNet:
    """A network in an ONNX model, which several policies may share.

    acts       one of ACTS, by its card
    has_value  whether it gives a value; else values are NaN

    PolicyFileError if the inputs are not our features or the outputs not those of a policy.
    """

    def __init__(self, model: OnnxModel) -> None:
        self._is_priced = model.inputs["moves"][1][-1:] != (ACTION_FEATURES,)
        self._numbers = MOVE_NUMBERS if self._is_priced else ACTION_FEATURES
        self._takes_many = all(shape[:1] == (None,) for _, shape in model.inputs.values())
        boards = 2 if self._takes_many else 1
        sample = sample_inputs(self._numbers, boards)
        for name, array in sample.items():
            kind = f"tensor({'uint8' if array.dtype == np.uint8 else 'float'})"
            if model.inputs[name] not in ((kind, array.shape), (kind, (None, *array.shape[1:]))):
                came = f"{model.inputs[name][0]} {list(model.inputs[name][1])}"
                raise model.refuse(f"{name} {kind} {[1, *array.shape[1:]]}", came)
        check_outputs(model, model.try_out(sample), boards)
        self.acts, self.has_value = model.acts(*ACTS), "value" in model.outputs
        self._model, self._weights = model, model.weights() if self._is_priced else {}

    def rules_that_count(self, rows: int, cols: int) -> tuple[int, ...] | None:
        """The rules of `priced_features` that matter at this size, by index; None: all."""
        return rules_that_count(self._weights, rows, cols) if self._is_priced else ()

    def infer(
        self, planes: NDArray[np.uint8], moves: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(logits float32[num, 4], values float32[num]) of several boards.

        A model that takes one board is run once for each.
        """
        moves = moves[:, :, : self._numbers]
        count = 1 if self._takes_many else len(planes)
        stacks = zip(np.split(planes, count), np.split(moves, count), strict=True)
        outputs = [
            self._model.run({"planes": some_planes, "moves": some_moves})
            for some_planes, some_moves in stacks
        ]
        logits = np.concatenate([output["logits"].reshape(-1, 4) for output in outputs])
        if not self.has_value:
            return logits, np.full(len(planes), np.nan, np.float32)
        return logits, np.concatenate([output["value"].reshape(-1) for output in outputs])


def rules_that_count(
    weights: Mapping[str, NDArray[np.float32]], rows: int, cols: int
) -> tuple[int, ...] | None:
    """The rules whose numbers a network of `training.network` weighs at this size.

    These are indices into RULES, or None if the weights are not such a network's. Where every
    weight of a rule's numbers is 0 the network gives the same bits without them. At 84 x 84
    rounding leaves the weights for 42 x 42 a share of 1e-7, which is left out too. While a network
    learns, its weights change: what is recorded to learn from has the numbers of all rules.

    Args:
        weights: By name.
        rows: Of the board.
        cols: Of the board.
    """
    if {name: weights[name].shape for name in WEIGHTS if name in weights} != WEIGHTS:
        return None
    prior, policy, value = (weights[name] for name in WEIGHTS)
    sides = np.log(np.square(SIDES))
    nearness = [np.interp(math.log(rows * cols), sides, unit) for unit in np.eye(len(SIDES))]
    of_moves = [
        policy[:, -MOVE_NUMBERS - 4 : -4],
        value[:, -4 * MOVE_NUMBERS :].reshape(-1, MOVE_NUMBERS),
        prior[np.array(nearness) > NEGLIGIBLE_SHARE],
    ]
    used = np.any(np.concatenate(of_moves)[:, ACTION_FEATURES:-1], axis=0)
    return tuple(np.flatnonzero(used.reshape(len(RULES), NUMBERS_PER_RULE).any(1)).tolist())


class NetworkPolicy:
    """Take the move with the network's highest logit, or draw it.

    net        the network, which several policies may share
    acts       one of ACTS; the seed of `reset` fixes what "samples" draws
    thought()  after `act`: probabilities float32[4] of the moves, and the value, as the network
               judged the last observation
    """

    def __init__(
        self, name: str, net: ActionScorer, sensor_radius: int, acts: str = ACTS[0]
    ) -> None:
        self.name = name
        self.net = net
        self.has_value = getattr(net, "has_value", True)
        self._memory, self._samples = Memory(), acts == "samples"
        self._guard = LoopGuard(sensor_radius) if acts == "greedy with guard" else None
        self._features = RememberedFeatures(sensor_radius, net.rules_that_count)
        self._thought: tuple[NDArray[np.float32], float] = (np.full(4, 0.25, np.float32), 0.0)
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the episode; the seed fixes what is drawn in the next."""
        self._draws = begin_draws(seed)
        self._memory.forget()
        if self._guard is not None:
            self._guard.reset()

    def act(self, observation: NDArray[Any]) -> int:
        logits, values = self.net.infer(*self.extract_features(observation))
        return self.choose(logits[0], float(values[0]))

    def extract_features(
        self, observation: NDArray[Any]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Remember an observation; return (planes, moves), which the next call changes."""
        self._memory.observe(observation)
        return self._features(self._memory)

    def choose(self, logits: NDArray[np.float32], value: float) -> int:
        """Choose the action of the highest logit, unless the guard takes over.

        logits  float32[4]; value is kept for `thought`
        """
        memory = self._memory
        shares = np.exp(logits - logits.max())
        self._thought = shares / shares.sum(), value
        if self._samples:
            return draw_action(self._thought[0], self._draws)
        overruled = None if self._guard is None else self._guard.overrule(memory)
        if overruled is not None:
            return overruled
        action = int(logits.argmax())
        if logits[action] > INVALID_LOGIT:
            return action
        return next(iter(valid_actions(memory.codes, *memory.position)), 0)

    def goal(self) -> tuple[int, int] | None:
        """The cell (row, col) that the loop guard goes to, if it chose the last action."""
        return None if self._guard is None else self._guard.goal()

    def thought(self) -> tuple[NDArray[np.float32], float]:
        """(probabilities float32[4], value) of the last observation."""
        return self._thought


def sample_inputs(numbers: int, boards: int = 1) -> dict[str, NDArray[Any]]:
    """The inputs for boards of the smallest size, planes and moves.

    uint8[boards, ...] and float32[boards, 4, numbers]
    """
    codes = np.ones((1, 5, 5), np.uint8)
    codes[0, 0, 0] = ROVER
    cells, visited = np.zeros(1, np.int64), np.zeros((1, 25), np.uint8)
    headings = np.ones(1, np.int64)
    planes, moves = FeatureExtractor(1, 5, 5, 1)(codes, cells, visited, headings)
    return {"planes": planes.repeat(boards, 0), "moves": moves[:, :, :numbers].repeat(boards, 0)}
