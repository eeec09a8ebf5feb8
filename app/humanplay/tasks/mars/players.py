"""What is done with policies away from boards: files are found, many terrains played, and moves compared with theirs."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from humanplay.jobs import Jobs
from humanplay.task import PolicyError
from humanplay.tasks.mars.explanation import explanation_of, unjudged
from humanplay.tasks.mars.run import MarsRun
from marsexplorer import policies
from marsexplorer.config import ACTIONS, LEVELS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.cost import CostEstimator, check_judged
from marsexplorer.evaluation.episodes import (
    FEW_CHUNKS,
    Agreement,
    make_chunks,
    play_chunks,
    play_out,
    play_terrain,
)
from marsexplorer.evaluation.mistakes import MistakeKind
from marsexplorer.policies import find_shipped, is_rule, title
from marsexplorer.policies.files.card import of_paper, shipped

OFFERED = (
    *(EnvConfig.of(level, 21) for level in LEVELS), EnvConfig.of("random", 42), EnvConfig.of("random", 84),
)  # fmt: skip
"""The configurations that the page's terrain dialog offers: each has a board of figures, even if unplayed."""

__all__ = [
    "OFFERED",
    "Agreement",
    "CostEstimator",
    "MistakeKind",
    "NoisyPolicy",
    "begin",
    "check_judged",
    "explanation_of",
    "file_of",
    "find_shipped",
    "hash_of",
    "hash_with_code",
    "is_rule",
    "judges_moves",
    "load",
    "of_paper",
    "play",
    "play_all",
    "play_terrain",
    "shipped",
    "title",
    "unjudged",
]  # fmt: skip


def load(source: str, config: EnvConfig) -> policies.Policy:
    """Return a new policy for a configuration; PolicyError where none goes by this name or path, or none can be played."""
    with _policy_errors():
        return policies.load(source, config.sensor_radius)


@contextmanager
def _policy_errors() -> Iterator[None]:
    try:
        yield
    except (LookupError, ValueError, OSError) as error:
        raise PolicyError(str(error)) from error


def file_of(source: str) -> Any:
    """Return the path of a policy's file; PolicyError where there is none."""
    with _policy_errors():
        return policies.find_file(source)


def hash_of(source: str) -> str | None:
    """Return SHA-256 (hex) of a policy's file; None for a rule that is code; PolicyError where it cannot be read."""
    with _policy_errors():
        return policies.policy_hash(source)


def hash_with_code(source: str) -> str:
    """Return SHA-256 (hex) of a policy: of its file where it has one, and of the code of all policies."""
    found = hashlib.sha256()
    files = sorted(Path(policies.__file__).parent.rglob("*.py"))
    for path in (*files, shipped().get(source, Path(source))):
        if path.is_file():
            found.update(path.read_bytes())
    return found.hexdigest()


def judges_moves() -> bool:
    """Return True: Expert judges moves, if not on every board (`check_judged`)."""
    return True


def begin(config: EnvConfig, seed: int) -> MarsRun:
    """Return a run at its start on the terrain of a seed."""
    return MarsRun(Episode.begin(config, seed=seed))


def play(policy: policies.Policy, config: EnvConfig, seed: int, policy_seed: int) -> MarsRun:
    """Return the ended run of a policy, reset with `policy_seed`, on the terrain of a seed."""
    return MarsRun(play_out(policy, Episode.begin(config, seed=seed), policy_seed))


def play_all(
    sources: Sequence[str], config: EnvConfig, seeds: Sequence[int]
) -> Iterator[tuple[str, int, bytes, str]]:
    """Yield source, seed, actions and trajectory hash of each policy's episode on each terrain, in any order.

    PolicyError when a policy cannot be played; nothing is played then.
    """
    for source in sources:
        load(source, config)
    chunks = make_chunks(sources, [config], seeds, traces=True)
    with Jobs() as jobs:
        for part in play_chunks(chunks, jobs if len(chunks) > FEW_CHUNKS else None):
            for each in part:
                assert each.trace is not None
                yield each.policy, each.seed, bytes(each.trace.actions), each.trace.trajectory_hash


def occupancy_codes(frame: Mapping[str, Any]) -> NDArray[np.uint8]:
    """Return what a frame shows: uint8[rows, cols], 0 unknown, 1 free, 2 rover, 3 obstacle."""
    return np.array([["?.@#".index(cell) for cell in row] for row in frame["grid"]], np.uint8)


class NoisyPolicy:
    """A policy of which some moves are replaced by random valid ones."""

    def __init__(self, name: str, noise: float, radius: int, seed: int = 0) -> None:
        """Load a policy by name or path; PolicyError where none can be.

        noise   probability (0..1) that a move is the random policy's
        radius  of the sensor, cells
        """
        with _policy_errors():
            self._policy, self._random = policies.load(name, radius), policies.load("random")
        self._noise, self._dice = noise, random.Random(seed)

    def reset(self) -> None:
        """Begin another episode."""
        self._policy.reset(self._dice.getrandbits(31))
        self._random.reset(self._dice.getrandbits(31))

    def choose(self, frame: Mapping[str, Any]) -> str:
        """Return the action that answers a frame."""
        policy = self._random if self._dice.random() < self._noise else self._policy
        return ACTIONS[policy.act(occupancy_codes(frame))]
