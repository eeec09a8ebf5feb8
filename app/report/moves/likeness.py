"""How much each player moves like each policy: the share of ranked moves that the policy would have made too.

The policy is shown what the rover saw before each move. The share is a description, and leaves nobody out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from app.db.reader import Reader
from app.jobs import Progress
from app.report.statistics.exclusion_sets import Cohort, members
from app.series.data import StudyData, trial_records
from app.task import PolicyError

SAMPLED_PLAYERS, SAMPLED_EPISODES = 20, 2
NO_PLAN = "random"
"""The policy whose moves are drawn: agreement with it says nothing."""

Agreement = Any
"""Moves made, and how many of them a policy would have made too: `moves`, `agreed`, `share`; can be added up."""
PlayerAgreements = Mapping[str, Mapping[str, Agreement]]
"""By player, by policy."""
EpisodeAgreements = Mapping[tuple[str, str], Agreement]
"""By (episode id, policy)."""


@dataclass(frozen=True)
class Likeness:
    """One player's agreement with one policy: share of their moves, 0..1."""

    participant: str
    policy: str
    moves: int
    share: float


def episode_agreements(
    reader: Reader, data: StudyData, policies: Sequence[str], progress: Progress | None = None
) -> dict[tuple[str, str], Agreement]:
    """Return the agreement of every finished ranked episode with each policy (names or paths; `random` is left out).

    Episodes of another core version cannot be replayed and are left out. progress: (episodes compared, in all). Errors are
    those of `players.load`. Nothing where there are no policies.
    """
    rules, config, source = data.protocol.rules, data.protocol.env_config, data.policy_files.source
    if (players := rules.players) is None:
        return {}
    names = [name for name in dict.fromkeys(policies) if name != NO_PLAN]
    loaded = {name: players.load(source(name), config) for name in names}
    trials = [each for each in data.trials if each.phase == "ranked" and each.ended_ms is not None]
    found = {}
    for done, (trial, record) in enumerate(trial_records(reader, trials), 1):
        for name, policy in loaded.items() if trial.core_version == rules.version else ():
            found[trial.id, name] = players.agreement_with(policy, record)
        if progress:
            progress(done, len(trials))
    return found


def player_agreements(
    cohort: Cohort, policies: Sequence[str], found: EpisodeAgreements
) -> dict[str, dict[str, Agreement]]:
    """Return each player's agreement with each policy over their ranked episodes, `random` left out."""
    names = [name for name in dict.fromkeys(policies) if name != NO_PLAN]
    return {
        player: {
            name: _total(found.get((trial.id, name)) for trial in cohort.ranked[player])
            for name in names
        }
        for player in members(cohort, {})
    }


def human_likeness(
    reader: Reader, data: StudyData, cohort: Cohort, ids: Sequence[str]
) -> dict[str, float]:
    """Return how much each of the protocol's policies moves like people: the mean over players of the share of moves, 0..1.

    Each of the first SAMPLED_PLAYERS `ids` enters with the first SAMPLED_EPISODES ranked terrains they finished: that takes
    seconds. A policy that cannot be loaded here is left out.
    """
    found, rules = {}, data.protocol.rules
    players: Any = rules.players
    records = {}
    for player in ids[:SAMPLED_PLAYERS]:
        first = sorted(cohort.ranked[player], key=lambda trial: trial.terrain_index)[
            :SAMPLED_EPISODES
        ]
        same = [trial for trial in first if trial.core_version == rules.version]
        records[player] = [record for _, record in trial_records(reader, same)]
    for name in data.protocol.policies:
        try:
            source = data.policy_files.source(name)
            policy = players.load(source, data.protocol.env_config) if name != NO_PLAN else None
        except PolicyError:
            continue
        if policy is None:
            continue
        agreements = {
            player: {name: _total(players.agreement_with(policy, record) for record in own)}
            for player, own in records.items()
        }
        if (share := mean_agreement(agreements, name)) is not None:
            found[name] = share
    return found


def _total(agreements: Iterable[Agreement | None]) -> Agreement | None:
    """Return all together; None without any."""
    known = [each for each in agreements if each is not None]
    return reduce(add, known) if known else None


def find_likeness(agreements: PlayerAgreements) -> tuple[Likeness, ...]:
    """Return every player's likeness to every policy, in the order given; players without a move are left out."""
    return tuple(
        Likeness(player, policy, agreement.moves, agreement.share)
        for player, own in agreements.items()
        for policy, agreement in own.items()
        if agreement is not None and agreement.moves
    )


def mean_agreement(agreements: PlayerAgreements, policy: str) -> float | None:
    """Return the mean over players of their agreement with a policy, 0..1: its likeness to people; None without a move."""
    known = [own[policy] for own in agreements.values() if own.get(policy) is not None]
    shares = [each.share for each in known if each.moves]
    return float(np.mean(shares)) if shares else None
