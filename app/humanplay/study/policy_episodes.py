"""A policy's episodes on a study's ranked terrains, played or replayed.

An episode is its cause: the terrain's seed and the moves. The report's figures of policies are made from these, and a release
holds them, so that they can be derived again where the policy's file is not at hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from humanplay.study.data import StudyData
from humanplay.study.policy_files import PolicyFiles
from humanplay.study.protocol import Protocol
from humanplay.study.seeds import seed
from humanplay.task import Configuration, Environment, Run


@dataclass(frozen=True)
class PolicyEpisode:
    """One episode of a policy.

    Attributes:
        policy: Its name or path, as in the protocol.
        policy_hash: SHA-256 (hex) of its file; None for code.
        terrain, seed: Index of the ranked terrain, and its seed.
        actions: One byte a move.
        trajectory_hash: Of the episode as it was played.
    """

    policy: str
    policy_hash: str | None
    terrain: int
    seed: int
    actions: bytes
    trajectory_hash: str

    def replay(self, environment: Environment, config: Configuration) -> Run:
        """Replay the episode, at most to its end."""
        run = environment.run(config, self.seed)
        for action in self.actions:
            if run.ended:
                break
            run.step(action)
        return run

    def replayed_hash(self, environment: Environment, config: Configuration) -> str:
        """Hash of the replayed trajectory; or a sentence if moves go on after the end."""
        if replace(self, actions=self.actions[:-1]).replay(environment, config).ended:
            return "the recorded moves go on after the end"
        return str(self.replay(environment, config).record().trajectory_hash)


def closed_seeds(data: StudyData) -> dict[int, int]:
    """Index -> seed of a closed study's ranked terrains; empty without its secret."""
    if data.secret is None:
        return {}
    secret, ranked = bytes.fromhex(data.secret), range(data.protocol.ranked)
    return {i: seed(secret, data.protocol_hash, "ranked", i) for i in ranked}


def compared_policies(protocol: Protocol) -> list[str]:
    """The policies of the report: those of the protocol, and `random` as the zero."""
    return list(dict.fromkeys((*protocol.policies, "random")))


def tested_policies(protocol: Protocol) -> list[str]:
    """The policies that are tested against people: the protocol's, without `random`.

    None in a score without a lowest value: those who leave have none, so only finishers could claim it. And none where the
    arms are the family that is tested.
    """
    if protocol.primary_family == "arms":
        return []
    lowest, _ = protocol.environment.bounds(protocol.env_config)
    if protocol.primary_metric == "score" and not math.isfinite(lowest):
        return []
    return [name for name in dict.fromkeys(protocol.policies) if name != "random"]


def play_policies(
    names: Sequence[str],
    environment: Environment,
    config: Configuration,
    seeds: Mapping[int, int],
    progress: Callable[[int, int], None] | None = None,
    files: PolicyFiles | None = None,
) -> tuple[PolicyEpisode, ...]:
    """Play each policy (a name or path) on every terrain.

    Args:
        seeds: Terrain index -> seed.
        progress: Called with (episodes played, episodes in all).
        files: Of the study's policies; None: the files that are there today.

    Returns:
        The episodes, sorted by policy and terrain.

    Raises:
        PolicyError: Before anything is played, if a policy cannot be played.
    """
    if not names:
        return ()
    sources = {name: (files or PolicyFiles()).source(name) for name in names}
    chosen = list(dict.fromkeys(sources.values()))
    hashes = {source: environment.policies.hash_of(source) for source in chosen}
    index_of = {number: index for index, number in seeds.items()}
    episodes: dict[tuple[str, int], PolicyEpisode] = {}
    for source, number, moves, trajectory in environment.policies.play_all(
        chosen, config, list(seeds.values())
    ):
        terrain = index_of[number]
        # several names may stand for one source
        for name, its_source in sources.items():
            if its_source == source:
                episodes[name, terrain] = PolicyEpisode(
                    name, hashes[source], terrain, number, moves, trajectory
                )
        if progress:
            progress(len(episodes), len(sources) * len(seeds))
    return tuple(episodes[name, index] for name in sources for index in sorted(seeds))
