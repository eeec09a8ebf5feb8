"""MarsExplorer's policies: the shipped ones by name, others from files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from humanplay import task
from humanplay.jobs import Jobs
from humanplay.task import Configuration, NotReadyError, PolicyError, PolicyOffer
from humanplay.tasks.base import BasePolicies
from humanplay.tasks.mars.narrowing import own_config
from humanplay.tasks.mars.run import MarsRun, occupancy_codes
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import FEW_CHUNKS, make_chunks, play_chunks, play_out
from marsexplorer.policies import Policy
from marsexplorer.policies.files.card import of_paper, shipped
from marsexplorer.policies.files.imported import wrong_size
from marsexplorer.policies.network import batch


class PolicyCatalogue(BasePolicies):
    """The policies that load by name, and further ones on offer from paths.

    The shipped ones play every size, and are loaded when somebody chooses them. A file is loaded and decides once before
    anybody can, so that one that is no policy is found at the start.
    """

    compared = ("ppo", "frontier-cost", "frontier-utility", "random")
    shown = "ppo"
    slow = ("random", "lookahead")  # by hundreds of moves, by milliseconds a move
    simulated = "frontier-cost"
    sees_frames = True

    def __init__(self, paths: Iterable[Path] = ()) -> None:
        self._of_files = [_try_out(path) for path in paths]

    @cached_property
    def _offers(self) -> dict[str, PolicyOffer]:
        by_name = [
            PolicyOffer(name, policies.describe(name), name, None, True)
            for name in policies.names()
        ]
        return {offer.name: offer for offer in (*by_name, *self._of_files)}

    def offers(self) -> list[PolicyOffer]:
        """What may be chosen."""
        return list(self._offers.values())

    def check_size(self, names: Iterable[str], config: Configuration) -> None:
        """Raise ValueError, naming the policy, if one cannot play boards of this size."""
        for name in names:
            size = self._offers[name].size if name in self._offers else None
            if size is not None and size != config.size:
                raise ValueError(wrong_size(name, size, own_config(config).size))

    def load(self, source: str, config: Configuration | None = None) -> Policy:
        """A new policy by its name or path; PolicyError if it is absent or cannot play."""
        path = self._offers[source].source if source in self._offers else source
        with _policy_errors():
            if config is None:
                return policies.load(path)
            return policies.load(path, own_config(config).sensor_radius)

    def reset(self, policy: task.Policy, config: Configuration, seed: int) -> None:
        """Reset a policy for an episode, and tell it the level if it asks."""
        policies.begin(own_policy(policy), config.level, seed)

    def act_many(
        self, policies: Sequence[task.Policy], observations: Sequence[object]
    ) -> list[int | Exception]:
        """Every board's action, or what its policy raised."""
        maps = [own_observation(observation) for observation in observations]
        return batch.act_many([own_policy(policy) for policy in policies], maps)

    def batch_network(self, policy: task.Policy) -> object | None:
        """The policy's network, if it can decide for several boards at once."""
        return batch.batch_network(own_policy(policy))

    def observation_in(self, frame: Mapping[str, object]) -> NDArray[np.uint8]:
        """What a frame shows, as a policy is given it: uint8[rows, cols]."""
        return occupancy_codes(frame)

    def is_rule(self, source: str) -> bool:
        """Whether a name stands for a rule, which is code."""
        return policies.is_rule(source)

    def file_of(self, source: str) -> Path:
        """The path of a policy's file; PolicyError if there is none."""
        with _policy_errors():
            return policies.find_file(source)

    def hash_of(self, source: str) -> str | None:
        """SHA-256 (hex) of a policy's file; None for a rule. PolicyError if unreadable."""
        with _policy_errors():
            return policies.policy_hash(source)

    def hash_with_code(self, source: str) -> str:
        """SHA-256 (hex) of a policy's file, if it has one, and of all policies' code."""
        digest = hashlib.sha256()
        files = sorted(Path(policies.__file__).parent.rglob("*.py"))
        for path in (*files, shipped().get(source, Path(source))):
            if path.is_file():
                digest.update(path.read_bytes())
        return digest.hexdigest()

    def find_shipped(self, digest: str) -> Path | None:
        """The shipped file of this SHA-256 (hex)."""
        return policies.find_shipped(digest)

    def unlisted(self) -> Mapping[str, Path]:
        """The agents of the paper's algorithms, in a checkout."""
        return of_paper()

    def title(self, name: str) -> str:
        """What reports call a policy."""
        return policies.title(name)

    def play(
        self, policy: task.Policy, config: Configuration, seed: int, policy_seed: int
    ) -> MarsRun:
        """The ended run of a policy, reset with `policy_seed`, on the terrain of a seed."""
        episode = Episode.begin(own_config(config), seed=seed)
        return MarsRun(play_out(own_policy(policy), episode, policy_seed))

    def play_all(
        self, sources: Sequence[str], config: Configuration, seeds: Sequence[int]
    ) -> Iterator[tuple[str, int, bytes, str]]:
        """Yield source, seed, actions and trajectory hash of each episode, in any order.

        PolicyError if a policy cannot be played; nothing is played then.
        """
        for source in sources:
            self.load(source, config)
        chunks = make_chunks(sources, [own_config(config)], seeds, traces=True)
        with Jobs() as jobs:
            for rows in play_chunks(chunks, jobs if len(chunks) > FEW_CHUNKS else None):
                for row in rows:
                    assert row.trace is not None
                    yield row.policy, row.seed, bytes(row.trace.actions), row.trace.trajectory_hash


def own_policy(policy: task.Policy) -> Policy:
    """A policy as one of MarsExplorer's own; TypeError if it is not."""
    if not _decides(policy):
        raise TypeError(f"expected a policy of MarsExplorer's, got a {type(policy).__name__}")
    return policy


def _decides(policy: task.Policy) -> TypeGuard[Policy]:
    return callable(getattr(policy, "act", None))


def own_observation(observation: object) -> NDArray[np.uint8]:
    """What a run shows, as its policies are given it; TypeError for another task's."""
    if not isinstance(observation, np.ndarray):
        raise TypeError(f"expected a map of cells, got a {type(observation).__name__}")
    return observation


def check_file(path: Path) -> None:
    """Read a policy file's card; PolicyFileError or PolicyNotFoundError otherwise."""
    policies.describe(str(path))


@contextmanager
def _policy_errors() -> Iterator[None]:
    try:
        yield
    except (LookupError, ValueError, OSError) as error:
        raise PolicyError(str(error)) from error


def _try_out(path: Path) -> PolicyOffer:
    """The offer of a policy file, after one decision and one move on a board.

    PolicyFileError or PolicyNotFoundError if it cannot play.
    """
    while True:
        try:
            policy = policies.load(path)
            policy.reset(0)
            size: tuple[int, int] | None = getattr(policy, "size", None)
            episode = Episode.begin(EnvConfig.of("random", size or 5), seed=0)
            episode.step(policy.act(episode.codes.copy()))
            return PolicyOffer(policy.name, policies.describe(str(path)), str(path), size, False)
        except NotReadyError as error:
            error.ready.result()
