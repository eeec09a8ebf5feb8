"""Agents of a closed evaluation, policies and people on one scale.

The comparison is derived from receipts, policies' episodes and a study. If the instances are those
that people played, each agent is compared with them instance by instance, by the test of
`humanplay.report.statistics.comparisons`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NotRequired, TypedDict

import numpy as np

from humanplay.agents.evaluation import EpisodeEnding, Protocol, ending_of
from humanplay.db.trial import LEFT
from humanplay.report.statistics.comparisons import compare_policy
from humanplay.report.statistics.exclusion_sets import METRICS, MetricName, members, people_of
from humanplay.report.statistics.first_attempts import first_attempts
from humanplay.report.statistics.intervals import Interval
from humanplay.report.statistics.study_figures import live_figure, worst_value
from humanplay.study.data import StudyData
from humanplay.study.policy_episodes import PolicyEpisode
from humanplay.task import DrawnInstance
from marsexplorer.intervals import Floats


class ReceiptEpisode(EpisodeEnding):
    """An instance in a receipt and how its episode ended.

    Attributes:
        actions: Its moves (hex), one byte each.
    """

    index: int
    begun: bool
    actions: str


class ReceiptCard(TypedDict):
    """The card of a receipt; its author's first one ranks."""

    id: str
    author: str
    number: int
    ranks: bool
    note: str | None


class Exposure(TypedDict):
    """Who could have seen the instances before the agent, and since when."""

    participants: int
    participants_since: str | None
    operators: str
    operators_since: str
    other_cards_before: NotRequired[int]


class Receipt(TypedDict):
    """How a card's attempts ended.

    A signed one has the public half of the key and the signature too.
    """

    format: str
    evaluation: str
    task: str
    protocol_hash: str
    commitment: str
    study: dict[str, object] | None
    sees: str
    seen_by: Exposure
    card: ReceiptCard
    agent: dict[str, str]
    agent_note: str
    versions: dict[str, str]
    began_at: str
    ended_at: str
    closed_at: str
    episodes: list[ReceiptEpisode]
    chain: str
    public_key: NotRequired[str]
    signature: NotRequired[str]


@dataclass(frozen=True)
class _InstanceResults:
    """Somebody's results on each instance.

    What has not succeeded took all the moves that there are.
    """

    name: str
    score: Floats
    steps: Floats
    outcomes: tuple[str, ...]

    @classmethod
    def of(
        cls, name: str, protocol: Protocol, episodes: Mapping[int, EpisodeEnding]
    ) -> _InstanceResults:
        """Take episodes by instance.

        What was left has the score that it has for people (`Trial.as_left`).
        """
        environment, config = protocol.environment, protocol.env_config
        cause = DrawnInstance(config, seed=0, terrain=b"", start=(0, 0))
        score, steps = np.full((2, protocol.instances), np.nan)
        outcomes = [""] * protocol.instances
        for index, episode in episodes.items():
            outcome = outcomes[index] = episode["outcome"]
            score[index] = episode["score"]
            if outcome in LEFT:
                score[index] = environment.given_up_score(
                    cause, outcome, episode["total"], episode["score"]
                )
            steps[index] = episode["steps"] if outcome in environment.successes else config.limit
        return cls(name, score, steps, tuple(outcomes))


def compare(
    protocol: Protocol,
    receipts: Sequence[Receipt],
    episodes: Sequence[PolicyEpisode],
    data: StudyData | None,
) -> dict[str, object]:
    """The comparison, ready for JSON.

    Args:
        data: Of the closed study whose people the agents are compared with; None for none.

    Returns:
        Its words, the people's row, a row for each policy and agent, and each instance.
    """
    tables: dict[str, Floats] = {}
    if data is not None:
        cohort = people_of(data)
        ids = members(cohort, data.protocol.per_protocol)
        tables = {name: cohort.table(ids, name) for name in METRICS} if ids else {}
    is_drawn = data is not None and data.protocol.terrains_drawn
    policies = _policies(protocol, episodes)
    random = next((policy for policy in policies if policy.name == "random"), None)
    rows: list[dict[str, object]] = []
    better, words = protocol.environment.metrics[0].is_better, protocol.environment.about.words
    sign = 1 if better == "higher" else -1
    ranked: list[tuple[dict[str, object], float]] = []
    for policy in policies:
        figures = _figures(policy, protocol, tables, random, is_drawn)
        rows.append({"kind": "policy", "name": policy.name, "rank": None, **figures})
    for receipt in receipts:
        by_instance = {episode["index"]: episode for episode in receipt["episodes"]}
        agent = _InstanceResults.of(receipt["card"]["id"], protocol, by_instance)
        figures = _figures(agent, protocol, tables, random, is_drawn)
        row = {
            "kind": "agent",
            "name": receipt["agent"].get("agent") or f"card {receipt['card']['id']}",
            "rank": None,
            "attempts": sum(episode["begun"] for episode in receipt["episodes"]),
            "card": receipt["card"],
            "agent": receipt["agent"],
            "sees": receipt["sees"],
            "seen_by": receipt["seen_by"],
            **figures,
        }
        rows.append(row)
        if receipt["card"]["ranks"]:
            ranked.append((row, sign * figures["score"]["mean"]))
    for row, mean in ranked:
        row["rank"] = 1 + sum(other > mean for _, other in ranked)
    people = None
    if data is not None:
        people = {
            **live_figure(data),
            "sees": protocol.environment.texts(protocol.env_config).observations,
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


def _policies(protocol: Protocol, episodes: Sequence[PolicyEpisode]) -> list[_InstanceResults]:
    """Each policy's results, its episodes replayed."""
    environment, config = protocol.environment, protocol.env_config
    by_policy: dict[str, dict[int, EpisodeEnding]] = {}
    for episode in episodes:
        came_to = ending_of(episode.replay(environment, config))
        by_policy.setdefault(episode.policy, {})[episode.terrain] = came_to
    return [_InstanceResults.of(name, protocol, endings) for name, endings in by_policy.items()]


class _Figure(TypedDict):
    """A mean in a metric, and each instance's number.

    The other fields are there if people played the same instances.
    """

    mean: float
    values: list[float]
    difference: float | None
    terrains: NotRequired[int]
    interval: NotRequired[Interval | None]
    normalized: NotRequired[float | None]


class _Figures(TypedDict):
    """Somebody's outcomes, and their mean in each metric."""

    outcomes: list[str]
    score: _Figure
    steps: _Figure


def _figures(
    played: _InstanceResults,
    protocol: Protocol,
    tables: Mapping[str, Floats],
    random: _InstanceResults | None,
    is_drawn: bool,
) -> _Figures:
    """The mean in each metric, and its difference to people if they are paired."""

    def figure(metric: MetricName) -> _Figure:
        values: Floats = getattr(played, metric)
        row: _Figure = {"mean": float(values.mean()), "values": values.tolist(), "difference": None}
        if metric in tables:
            shared = ~np.isnan(tables[metric]).all(axis=0)
            zero = None if random is None else getattr(random, metric)[shared]
            people = tables[metric][:, shared]
            worst = worst_value(protocol.environment, protocol.env_config, metric)
            compared = compare_policy(
                played.name, metric, values[shared], people, zero, worst, is_drawn
            )
            row["terrains"] = compared.terrains
            row["difference"] = compared.difference
            row["interval"] = compared.interval
            row["normalized"] = compared.normalized
        return row

    return {"outcomes": list(played.outcomes), "score": figure("score"), "steps": figure("steps")}


def _instances(data: StudyData) -> list[dict[str, object]]:
    """For each instance how people fared: everybody who ended it.

    How many played and completed it, their means, upper median and best number of moves; None if
    nobody did.
    """
    cohort = people_of(data)
    ids = members(cohort, {})
    trials = [trial for person in ids for trial in cohort.ranked[person]]
    tables = {name: cohort.table(ids, name) for name in METRICS}
    rows = []
    for attempts in first_attempts(cohort).terrains:
        here = [trial for trial in trials if trial.terrain_index == attempts.terrain]
        moves = [trial.steps for trial in here if trial.succeeded]
        row: dict[str, object] = {
            "index": attempts.terrain, "players": attempts.played, "completed": attempts.completed,
            "upper_median": attempts.upper_median, "best": min(filter(None, moves), default=None),
        }  # fmt: skip
        for metric, table in tables.items():
            column = table[:, attempts.terrain]
            row[metric] = None if np.isnan(column).all() else float(np.nanmean(column))
        rows.append(row)
    return rows
