"""Agents of a closed evaluation, policies and people on one scale: derived from receipts, policies' episodes and a study.

Where the instances are those that people played, each agent is compared with them instance by instance, by the test of
`humanplay.report.statistics.comparisons`; where they are others of the same distribution, only the means stand side by side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from humanplay.db.trial import LEFT
from humanplay.report.making import runs_of
from humanplay.report.model import PolicyRun
from humanplay.report.statistics.comparisons import compare_policy
from humanplay.report.statistics.exclusion_sets import METRICS, members, people_of
from humanplay.report.statistics.first_attempts import first_attempts
from humanplay.report.statistics.study_figures import live_figure, worst_value
from humanplay.series.data import StudyData
from humanplay.series.policy_episodes import PolicyEpisode
from humanplay.series.protocol import Protocol
from marsexplorer.intervals import Floats


def compare_agents(
    protocol: Protocol,
    receipts: Sequence[Mapping[str, Any]],
    episodes: Sequence[PolicyEpisode],
    data: StudyData | None,
) -> dict[str, Any]:
    """Return the comparison, ready for JSON: its words, the people's row, a row for each policy and agent, and each instance.

    data  of the closed study whose people the agents are compared with; None for none
    """
    agents = protocol.agents
    assert agents is not None
    is_paired = data is not None and not agents.unpaired
    tables: dict[str, Floats] = {}
    if data is not None and is_paired:
        cohort = people_of(data)
        ids = members(cohort, data.protocol.per_protocol)
        tables = {name: cohort.table(ids, name) for name in METRICS} if ids else {}
    policies = runs_of(episodes, protocol) if protocol.rules.players is not None else ()
    random = next((run for run in policies if run.name == "random"), None)
    named = ({"kind": "policy", "name": run.name, "rank": None} for run in policies)
    made = (_figures(run, protocol, tables, random) for run in policies)
    rows = [{**each, **own} for each, own in zip(named, made, strict=True)]
    for receipt in receipts:
        run = _run_of(receipt, protocol)
        about = {name: receipt[name] for name in ("card", "agent", "sees", "seen_by")}
        begun = sum(each["begun"] for each in receipt["episodes"])
        name = receipt["agent"].get("agent") or f"card {receipt['card']['id']}"
        figures = _figures(run, protocol, tables, random)
        row = {"kind": "agent", "name": name, "rank": None, "attempts": begun}
        rows.append({**row, **about, **figures})
    better, words = protocol.rules.metrics[0].is_better, protocol.rules.words
    sign = 1 if better == "higher" else -1
    ranked = [row for row in rows if row["kind"] == "agent" and row["card"]["ranks"]]
    means = [sign * row["score"]["mean"] for row in ranked]
    for row, own in zip(ranked, means, strict=True):
        row["rank"] = 1 + sum(mean > own for mean in means)
    return {
        "paired": is_paired,
        "unpaired": agents.unpaired or None,
        "words": {"score": words.score, "steps": words.steps, "definition": words.definition},
        "terrains_drawn": protocol.terrains_drawn,
        "better": better,
        "limit": int(protocol.env_config.limit),
        "people": None
        if data is None
        else {**live_figure(data), "sees": protocol.rules.sees(protocol.env_config)},
        "instances": _instances(data) if data is not None and is_paired else [],
        "rows": rows,
    }


def _run_of(receipt: Mapping[str, Any], protocol: Protocol) -> PolicyRun:
    """Return a card's episodes by instance; what has not succeeded took all the moves that there are.

    What was left has the score that it has for people (`Trial.as_left`).
    """
    cause: Any = SimpleNamespace(config=protocol.env_config)
    score, steps = np.full((2, protocol.ranked), np.nan)
    outcomes = [""] * protocol.ranked
    for each in receipt["episodes"]:
        succeeded = each["outcome"] in protocol.rules.successes
        score[each["index"]] = each["score"]
        if each["outcome"] in LEFT:
            came_to = (each[name] for name in ("outcome", "total", "score"))
            score[each["index"]] = protocol.rules.forfeited_score(cause, *came_to)
        steps[each["index"]] = each["steps"] if succeeded else protocol.env_config.limit
        outcomes[each["index"]] = each["outcome"]
    return PolicyRun(receipt["card"]["id"], score, steps, tuple(outcomes))


def _figures(
    run: PolicyRun, protocol: Protocol, tables: Mapping[str, Floats], random: PolicyRun | None
) -> dict[str, Any]:
    """Return the mean in each metric, its difference to people with intervals where they are paired, and each instance's."""
    found: dict[str, Any] = {"outcomes": list(run.outcomes)}
    for metric in METRICS:
        values = run.values(metric)
        mean = float(values.mean())
        row: dict[str, Any] = {"mean": mean, "values": values.tolist(), "difference": None}
        if metric in tables:
            shared = ~np.isnan(tables[metric]).all(axis=0)
            zero = None if random is None else random.values(metric)[shared]
            people = tables[metric][:, shared]
            worst = worst_value(protocol.rules, protocol.env_config, metric)
            compared = compare_policy(
                run.name, metric, values[shared], people, zero, worst, protocol.terrains_drawn
            )
            names = ("terrains", "difference", "interval", "normalized")
            row |= {name: getattr(compared, name) for name in names}
        found[metric] = row
    return found


def _instances(data: StudyData) -> list[dict[str, Any]]:
    """Return for each instance how many people played and completed it, their means, upper median and best number of moves.

    All of it is of everybody who ended it, and None where nobody did.
    """
    cohort = people_of(data)
    ids = members(cohort, {})
    own = [trial for person in ids for trial in cohort.ranked[person]]
    tables = {name: cohort.table(ids, name) for name in METRICS}
    found = []
    for attempts in first_attempts(cohort).terrains:
        here = [each for each in own if each.terrain_index == attempts.terrain]
        moves = [each.steps for each in here if each.succeeded]
        row: dict[str, Any] = {
            "index": attempts.terrain, "players": attempts.played, "completed": attempts.completed,
            "upper_median": attempts.upper_median, "best": min(filter(None, moves), default=None),
        }  # fmt: skip
        for metric, table in tables.items():
            column = table[:, attempts.terrain]
            row[metric] = None if np.isnan(column).all() else float(np.nanmean(column))
        found.append(row)
    return found
