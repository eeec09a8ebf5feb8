"""Decide several boards together: a network that they share is asked once for all.

The moves are those of single decisions: where rounding in a batch could exchange the two best
moves, the board is decided alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from marsexplorer.policies.base import Policy

CLOSE = 1e-3
"""Where the scores of the two best moves differ by less, the board is decided alone; a batch
moves them by some millionths.
"""
CLOSE_SHARE = 1e-5
"""The same as a share of the best score: values of moves may be hundreds."""


class ActionScorer(Protocol):
    """A network that scores moves: `policy.OnnxNet`, or one with its methods."""

    def rules_that_count(self, rows: int, cols: int) -> Sequence[int] | None:
        """The `rules` of `FeatureExtractor` that it needs at this size; None: all."""

    def infer(
        self, planes: NDArray[np.uint8], moves: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(logits float32[num, 4], values float32[num]) of a `FeatureExtractor`'s arrays."""


@runtime_checkable
class BatchablePolicy(Policy, Protocol):
    """A policy of a network, so that one call can serve several boards.

    Its `act` is `choose(*net.infer(*extract_features(observation)))`.
    """

    net: Any
    """Has `infer(*arrays) -> (logits float32[num, 4], values float32[num])` for stacks of what
    `extract_features` returns.
    """

    def extract_features(self, observation: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Remember an observation; return the network's input, arrays [1, ...].

        The next call may overwrite them.
        """

    def choose(self, logits: NDArray[np.float32], value: float) -> int:
        """Choose the action for the last observation, from logits float32[4] and value."""


Waiting = tuple[int, BatchablePolicy, tuple[NDArray[Any], ...]]
"""(number of the board, its policy, what its network is shown)."""


def batch_network(policy: Policy) -> object | None:
    """The policy's network if it can decide several boards at once, else None."""
    return policy.net if isinstance(policy, BatchablePolicy) else None


def act_many(
    policies: Sequence[Policy], observations: Sequence[NDArray[Any]]
) -> list[int | Exception]:
    """Decide all boards; an element is an action, or the error that its policy raised.

    Args:
        policies: Different objects, each with its own memory; networks shared by several are asked
            once.
        observations: One for each policy, of any sizes.
    """
    answers: list[int | Exception] = [RuntimeError("not decided")] * len(policies)
    groups: dict[int, list[Waiting]] = {}
    for at, (policy, observation) in enumerate(zip(policies, observations, strict=True)):
        try:
            if isinstance(policy, BatchablePolicy):
                waiting = (at, policy, policy.extract_features(observation))
                groups.setdefault(id(policy.net), []).append(waiting)
            else:
                answers[at] = int(policy.act(observation))
        except Exception as error:
            answers[at] = error
    for group in groups.values():
        for (at, _, _), answer in zip(group, _act_with_shared_net(group), strict=True):
            answers[at] = answer
    return answers


def _act_with_shared_net(group: Sequence[Waiting]) -> list[int | Exception]:
    """Decide boards that share a network."""
    net = group[0][1].net
    try:
        inputs = [arrays for _, _, arrays in group]
        stacked = (np.concatenate(parts) for parts in zip(*inputs, strict=True))
        logits, values = net.infer(*(stacked if len(inputs) > 1 else inputs[0]))
        for at, arrays in enumerate(inputs):
            best, second = np.sort(logits[at])[:-3:-1]
            if len(inputs) > 1 and best - second < max(CLOSE, CLOSE_SHARE * abs(best)):
                logits[at : at + 1], values[at : at + 1] = net.infer(*arrays)
    except Exception as error:
        return [error] * len(group)
    answers: list[int | Exception] = []
    for (_, policy, _), scores, value in zip(group, logits, values, strict=True):
        try:
            answers.append(policy.choose(scores, float(value)))
        except Exception as error:
            answers.append(error)
    return answers
