"""Agents of a closed evaluation, policies and people on one scale: derived from receipts, policies' episodes and a study.

Where the instances are those that people played, each agent is compared with them instance by instance, by the test of
`humanplay.report.statistics.comparisons`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from humanplay.agents.evaluation import Protocol
from humanplay.db.trial import LEFT
from humanplay.report.statistics.comparisons import compare_policy
from humanplay.report.statistics.exclusion_sets import METRICS, members, people_of
from humanplay.report.statistics.first_attempts import first_attempts
from humanplay.report.statistics.study_figures import live_figure, worst_value
from humanplay.study.data import StudyData
from humanplay.study.policy_episodes import PolicyEpisode
from marsexplorer.intervals import Floats


@dataclass(frozen=True)
class _Played:
    """What somebody came to on each instance; what has not succeeded took all the moves that there are."""

    name: str
    score: Floats
    steps: Floats
    outcomes: tuple[str, ...]

    @classmethod
    def of(
        cls, name: str, protocol: Protocol, episodes: Mapping[int, Mapping[str, Any]]
    ) -> _Played:
        """Take episodes by instance; what was left has the score that it has for people (`Trial.as_left`)."""
        rules, config = protocol.rules, protocol.env_config
        cause: Any = SimpleNamespace(config=config)
        score, steps = np.full((2, protocol.instances), np.nan)
        outcomes = [""] * protocol.instances
        for index, episode in episodes.items():
            outcome = outcomes[index] = episode["outcome"]
            score[index] = episode["score"]
            if outcome in LEFT:
                score[index] = rules.given_up_score(
                    cause, outcome, episode["total"], episode["score"]
                )
            steps[index] = episode["steps"] if outcome in rules.successes else config.limit
        return cls(name, score, steps, tuple(outcomes))


def compare(
    protocol: Protocol,
    receipts: Sequence[Mapping[str, Any]],
    episodes: Sequence[PolicyEpisode],
    data: StudyData | None,
) -> dict[str, Any]:
    """Return the comparison, ready for JSON: its words, the people's row, a row for each policy and agent, and each instance.

    data  of the closed study whose people the agents are compared with; None for none
    """
    tables: dict[str, Floats] = {}
    if data is not None:
        cohort = people_of(data)
        ids = members(cohort, data.protocol.per_protocol)
        tables = {name: cohort.table(ids, name) for name in METRICS} if ids else {}
    is_drawn = data is not None and data.protocol.terrains_drawn
    policies = _policies(protocol, episodes)
    random = next((policy for policy in policies if policy.name == "random"), None)
    rows = []
    for policy in policies:
        figures = _figures(policy, protocol, tables, random, is_drawn)
        rows.append({"kind": "policy", "name": policy.name, "rank": None, **figures})
    for receipt in receipts:
        own = {episode["index"]: episode for episode in receipt["episodes"]}
        agent = _Played.of(receipt["card"]["id"], protocol, own)
        rows.append(
            {
                "kind": "agent",
                "name": receipt["agent"].get("agent") or f"card {receipt['card']['id']}",
                "rank": None,
                "attempts": sum(episode["begun"] for episode in receipt["episodes"]),
                **{name: receipt[name] for name in ("card", "agent", "sees", "seen_by")},
                **_figures(agent, protocol, tables, random, is_drawn),
            }
        )
    better, words = protocol.rules.metrics[0].is_better, protocol.rules.words
    sign = 1 if better == "higher" else -1
    ranked = [row for row in rows if row["kind"] == "agent" and row["card"]["ranks"]]
    means = [sign * row["score"]["mean"] for row in ranked]
    for row, mean in zip(ranked, means, strict=True):
        row["rank"] = 1 + sum(other > mean for other in means)
    people = None
    if data is not None:
        people = {
            **live_figure(data),
            "sees": protocol.rules.observations_in_words(protocol.env_config),
        }
    return {
        "words": {"score": words.score, "steps": words.steps, "definition": words.definition},
        "terrains_drawn": is_drawn,
        "better": better,
        "limit": int(protocol.env_config.limit),
        "people": people,
        "instances": [] if data is None else _instances(data),
        "rows": rows,
    }


def _policies(protocol: Protocol, episodes: Sequence[PolicyEpisode]) -> list[_Played]:
    """What each policy came to, its episodes replayed."""
    rules, config = protocol.rules, protocol.env_config
    by_policy: dict[str, dict[int, dict[str, Any]]] = {}
    for episode in episodes:
        record = episode.replay(rules, config).record()
        ending = {name: getattr(record, name) for name in ("outcome", "score", "steps", "total")}
        by_policy.setdefault(episode.policy, {})[episode.terrain] = ending
    return [_Played.of(name, protocol, own) for name, own in by_policy.items()]


def _figures(
    played: _Played,
    protocol: Protocol,
    tables: Mapping[str, Floats],
    random: _Played | None,
    is_drawn: bool,
) -> dict[str, Any]:
    """Return the mean in each metric, its difference to people with intervals where they are paired, and each instance's."""
    figures: dict[str, Any] = {"outcomes": list(played.outcomes)}
    for metric in METRICS:
        values: Floats = getattr(played, metric)
        mean = float(values.mean())
        row: dict[str, Any] = {"mean": mean, "values": values.tolist(), "difference": None}
        if metric in tables:
            shared = ~np.isnan(tables[metric]).all(axis=0)
            zero = None if random is None else getattr(random, metric)[shared]
            people = tables[metric][:, shared]
            worst = worst_value(protocol.rules, protocol.env_config, metric)
            compared = compare_policy(
                played.name, metric, values[shared], people, zero, worst, is_drawn
            )
            names = ("terrains", "difference", "interval", "normalized")
            row |= {name: getattr(compared, name) for name in names}
        figures[metric] = row
    return figures


def _instances(data: StudyData) -> list[dict[str, Any]]:
    """Return for each instance how many people played and completed it, their means, upper median and best number of moves.

    All of it is of everybody who ended it, and None where nobody did.
    """
    cohort = people_of(data)
    ids = members(cohort, {})
    own = [trial for person in ids for trial in cohort.ranked[person]]
    tables = {name: cohort.table(ids, name) for name in METRICS}
    rows = []
    for attempts in first_attempts(cohort).terrains:
        here = [trial for trial in own if trial.terrain_index == attempts.terrain]
        moves = [trial.steps for trial in here if trial.succeeded]
        row: dict[str, Any] = {
            "index": attempts.terrain, "players": attempts.played, "completed": attempts.completed,
            "upper_median": attempts.upper_median, "best": min(filter(None, moves), default=None),
        }  # fmt: skip
        for metric, table in tables.items():
            column = table[:, attempts.terrain]
            row[metric] = None if np.isnan(column).all() else float(np.nanmean(column))
        rows.append(row)
    return rows
