"""How much each policy moves like people: the share of people's ranked moves that the policy would have made too.

The policy is shown what the rover saw before each move. The leaderboard shows the share.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from app.db.reader import Reader
from app.report.statistics.exclusion_sets import Cohort
from app.series.data import StudyData, trial_records
from app.task import PolicyError

SAMPLED_PLAYERS, SAMPLED_EPISODES = 20, 2
NO_PLAN = "random"
"""The policy whose moves are drawn: agreement with it says nothing."""

Agreement = Any
"""Moves made, and how many of them a policy would have made too: `moves`, `agreed`, `share`; can be added up."""
PlayerAgreements = Mapping[str, Mapping[str, Agreement]]
"""By player, by policy."""


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


def mean_agreement(agreements: PlayerAgreements, policy: str) -> float | None:
    """Return the mean over players of their agreement with a policy, 0..1: its likeness to people; None without a move."""
    known = [own[policy] for own in agreements.values() if own.get(policy) is not None]
    shares = [each.share for each in known if each.moves]
    return float(np.mean(shares)) if shares else None
