"""A policy on the terrain of a finished episode, to compare with: the ghost of a replay."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.play.policy_catalogue import PolicyOffer
from app.replay.course import Course, course_of_policy
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Record
from marsexplorer.policies import load

PREFERRED = ("ppo", "frontier-cost")
"""The policy that is shown when none is asked for: the first of these that did not drive the episode itself."""
LONGEST_S = 30.0
"""Seconds that a policy may take for its whole episode."""


class GhostError(ValueError):
    """The policy that is asked for cannot be shown on this terrain; the text says why."""


def choices(offers: Sequence[PolicyOffer], config: EnvConfig) -> list[str]:
    """Return the names of the policies that play boards of this size."""
    return [offer.name for offer in offers if offer.size in (None, (config.rows, config.cols))]


def preferred(names: Sequence[str], driver: str) -> str | None:
    """Return the policy to show beside a driver; None where only the driver itself is on offer."""
    return next((name for name in (*PREFERRED, *names) if name in names and name != driver), None)


def play_ghost(source: str, record: Record, longest_s: float = LONGEST_S) -> Course:
    """Return the course of a policy from the start of a record on its terrain; GhostError where it cannot be had.

    The policy is given what its own rover discovers, as everywhere, and is reset with 0, so that every call gives the same.

    source  what `policies.load` takes: a name or a path
    """
    config = record.config
    try:
        policy = load(source, config.sensor_radius)
    except (LookupError, ValueError, OSError) as error:
        raise GhostError(f"the policy cannot be loaded: {error}") from error
    if getattr(policy, "size", None) not in (None, (config.rows, config.cols)):
        raise GhostError(
            f"{policy.name} plays no boards of {config.rows}x{config.cols}; choose another policy"
        )
    policy.reset(0)
    deadline_s = time.monotonic() + longest_s

    def act(codes: NDArray[np.uint8]) -> int:
        if time.monotonic() > deadline_s:
            raise GhostError(
                f"{policy.name} takes more than {longest_s:.0f} s on this terrain; choose a faster policy"
            )
        return policy.act(codes.copy())

    return course_of_policy(policy.name, record, act)
