"""Several boards decided together: networks look at all of them in one call, other policies one after the other.

The moves are those of single decisions: where rounding in a batch could turn the order of two moves, the board is judged
alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from marsexplorer.policies.base import Policy

CLOSE = 1e-3
"""Scores of the two best moves that differ by less are judged again alone; a batch moves them by some millionths."""


@runtime_checkable
class Judged(Policy, Protocol):
    """A policy whose `act` is `settle(*net.decide(*see(observation)))`, so that one call can serve several boards."""

    net: Any
    """Judges stacks of what `see` returns: decide(*arrays) -> (scores float32[num, 4], values float32[num])."""

    def see(self, observation: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Take in an observation and return the network's input, arrays [1, ...] that the next call may overwrite."""

    def settle(self, scores: NDArray[np.float32], value: float) -> int:
        """Return the action for what was seen last, from its scores float32[4] and value."""


def shared_net(policy: Policy) -> object | None:
    """Return the network that decides for the policy when it can decide for several at once, else None."""
    return policy.net if isinstance(policy, Judged) else None


def act_many(policies: Sequence[Policy], observations: Sequence[NDArray[Any]]) -> list[int | Exception]:
    """Return every board's action, or what its policy raised: the others are decided all the same.

    policies      different objects, each with its own memory; networks shared by several are asked once
    observations  one for each, of any sizes
    """
    answers: list[int | Exception] = [RuntimeError("not decided")] * len(policies)
    seen: dict[int, list[tuple[int, Judged, tuple[NDArray[Any], ...]]]] = {}
    for at, (policy, observation) in enumerate(zip(policies, observations, strict=True)):
        try:
            if isinstance(policy, Judged):
                seen.setdefault(id(policy.net), []).append((at, policy, policy.see(observation)))
            else:
                answers[at] = int(policy.act(observation))
        except Exception as error:
            answers[at] = error
    for group in seen.values():
        for (at, _, _), answer in zip(group, _together(group), strict=True):
            answers[at] = answer
    return answers


def _together(group: Sequence[tuple[int, Judged, tuple[NDArray[Any], ...]]]) -> list[int | Exception]:
    """Return the actions of boards that share a network."""
    net = group[0][1].net
    try:
        inputs = [own for _, _, own in group]
        stacked = inputs[0] if len(inputs) == 1 else tuple(np.concatenate(arrays) for arrays in zip(*inputs, strict=True))
        scores, values = net.decide(*stacked)
        for at, own in enumerate(inputs):
            best, second = np.sort(scores[at])[:-3:-1]
            if len(inputs) > 1 and best - second < CLOSE:
                scores[at : at + 1], values[at : at + 1] = net.decide(*own)
    except Exception as error:
        return [error] * len(group)
    answers: list[int | Exception] = []
    for (_, policy, _), own_scores, value in zip(group, scores, values, strict=True):
        try:
            answers.append(policy.settle(own_scores, float(value)))
        except Exception as error:
            answers.append(error)
    return answers
