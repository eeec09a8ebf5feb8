"""A study's report from its data: who enters, the figures, the comparisons, what deviates, what to beware of."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from statistics import median
from typing import Any

import numpy as np

from app.report.cautions import cautions, deviations, study_deviations
from app.report.checklist import Facts, checklist
from app.report.model import SYNTHETIC, GroupReport, Metric, PlayerRow, PolicyRow, Report
from app.report.policies import PolicyRun
from app.statistics.comparisons import (
    Comparison,
    compare,
    holm,
    iqm,
    iqm_interval,
    new_terrains_interval,
    player_means,
    variance,
)
from app.statistics.exclusion_sets import METRICS, Cohort, MetricName, members, people_of, scripts_of
from app.statistics.intervals import RULE, RULE_VERSION
from app.statistics.learning import at_trials, learning
from app.statistics.study_figures import NO_HUMAN_FIGURE, figure_sentence, primary_set, study_figures
from app.study.data import StudyData
from app.study.plausibility import RULES_VERSION
from marsexplorer.config import CORE_VERSION
from marsexplorer.evaluation.intervals import Floats

ESTIMAND = (
    "The mean, over players like these, of a player's mean over exactly these terrains: every player weighs the same, and the "
    "terrains are taken as given. The line for new terrains takes players and terrains alike as drawn at random."
)
Pictures = Mapping[str, dict[str, Any]]


def build(data: StudyData, runs: Sequence[PolicyRun] = (), synthetic: bool = False, pictures: Pictures | None = None) -> Report:
    """Return the report of a study: over its people, or over its scripts when `synthetic`, never over both.

    runs      policies on the ranked terrains (`app.report.policies.play`); none: no comparisons
    pictures  by group's name, what `app.statistics.group_summaries.of_groups` gives; none: no curves and visit maps
    """
    people = people_of(data)
    cohorts = scripts_of(data) if synthetic else [people]
    groups = tuple(_group(data, cohort, runs, (pictures or {}).get(cohort.name, {})) for cohort in cohorts)
    scripts = Counter(person.script or "script" for person in data.people if person.kind == "script")
    return Report(
        study=data.protocol.name,
        title=data.protocol.title,
        synthetic=synthetic,
        status="open" if data.closed_ms is None else "closed",
        made_at=_iso(time.time_ns() // 1_000_000),
        software_version=version("marsexplorer-playground"),
        core_version=CORE_VERSION,
        protocol_hash=data.protocol_hash,
        commitment=data.commitment,
        frozen_at=_iso(data.frozen_ms),
        closed_at=None if data.closed_ms is None else _iso(data.closed_ms),
        protocol=data.protocol.model_dump(mode="json"),
        estimand=ESTIMAND,
        rule=RULE,
        rule_version=RULE_VERSION,
        labels_version=RULES_VERSION,
        sentence=_sentence(groups, synthetic),
        groups=groups,
        policies=tuple(_policy_row(run) for run in runs),
        deviations=study_deviations(data),
        scripts=dict(sorted(scripts.items())),
        checklist=checklist(_facts(data, groups, runs)) if not synthetic else (),
    )


def _group(data: StudyData, cohort: Cohort, runs: Sequence[PolicyRun], pictures: dict[str, Any]) -> GroupReport:
    figures, primary = study_figures(data, cohort), primary_set(data)
    everybody = members(cohort, {})
    ids = members(cohort, data.protocol.exclusion.get(primary, {}))
    trials = [trial for person in everybody for trial in cohort.ranked[person]]
    finished = sum(person.completed_ms is not None for person in cohort.people)
    gone = [
        person for person in cohort.people if person.stage == "withdrawn" or (data.closed_ms and person.completed_ms is None)
    ]
    group = GroupReport(
        name=cohort.name,
        kind=cohort.kind,
        joined=len(cohort.people),
        started=len({trial.participant for trial in data.trials if trial.phase == "ranked"} & set(cohort.ranked)),
        finished=finished,
        left=len(gone),
        stages=dict(Counter(person.stage for person in cohort.people)),
        outcomes=dict(Counter(str(trial.outcome) for trial in trials)),
        labels=dict(Counter(label for trial in trials for label in trial.labels)),
        primary=primary,
        figures=figures,
        metrics=tuple(_metric(data, cohort, ids, metric) for metric in METRICS) if ids else (),
        players=tuple(_player_row(cohort, person, number, person in ids) for number, person in enumerate(everybody, 1)),
        comparisons=_comparisons(cohort, ids, runs),
        deviations=deviations(data, cohort),
        cautions=(),
        pictures=pictures,
    )
    return replace(group, cautions=cautions(data, group))


def _metric(data: StudyData, cohort: Cohort, ids: Sequence[str], metric: MetricName) -> Metric:
    table = cohort.table(ids, metric)
    several = min(table.shape) > 1 and not np.isnan(table).all(axis=0).any()
    margin = data.protocol.equivalence_margin if metric == "steps" else None
    return Metric(
        metric,
        float(player_means(table).mean()),
        new_terrains_interval(table) if several else None,
        iqm(table),
        iqm_interval(table) if several else None,
        variance(table),
        learning(metric, cohort.table(ids, metric, "trial"), margin),
        at_trials(cohort.practised(ids, metric)),
    )


def _player_row(cohort: Cohort, person: str, number: int, is_in: bool) -> PlayerRow:
    trials = cohort.ranked[person]
    score, steps = (float(player_means(cohort.table([person], metric))[0]) for metric in METRICS)
    explored = sum(trial.outcome == "explored" for trial in trials)
    return PlayerRow(f"P{number:02d}", len(trials), score, steps, explored, len(trials) - explored, is_in)


def _comparisons(cohort: Cohort, ids: Sequence[str], runs: Sequence[PolicyRun]) -> tuple[Comparison, ...]:
    found = []
    for metric in METRICS:
        table = cohort.table(ids, metric)
        by_name = {run.name: run for run in runs}
        if not len(ids) or not runs:
            continue
        shared = _shared(table, runs, metric)
        zero = by_name["random"].values(metric)[shared] if "random" in by_name else None
        rows = [
            compare(run.name, metric, run.values(metric)[shared], table[:, shared], zero, up=metric == "score") for run in runs
        ]
        adjusted = holm([row.p_value if row.p_value is not None else 1.0 for row in rows])
        found += [
            replace(row, p_adjusted=p if row.p_value is not None else None) for row, p in zip(rows, adjusted, strict=True)
        ]
    return tuple(found)


def _shared(table: Floats, runs: Sequence[PolicyRun], metric: MetricName) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Return the terrains that somebody and every policy played."""
    known = ~np.isnan(table).all(axis=0)
    for run in runs:
        known &= ~np.isnan(run.values(metric))
    return np.flatnonzero(known)


def _policy_row(run: PolicyRun) -> PolicyRow:
    known = ~np.isnan(run.score)
    explored = sum(outcome == "explored" for outcome in run.outcomes)
    failed = sum(outcome in ("collided", "out_of_bounds") for outcome in run.outcomes)
    means = float(run.score[known].mean()), float(run.steps[known].mean())
    return PolicyRow(run.name, int(known.sum()), *means, explored, failed, run.pictures)


def _sentence(groups: Sequence[GroupReport], synthetic: bool) -> str:
    if synthetic:
        return SYNTHETIC if groups else f"{SYNTHETIC} No script has played this study."
    group = groups[0]
    if group.figure.players:
        return figure_sentence(group.figure)
    if group.figures[0].players:
        return f"Nobody has finished the study yet. So far: {figure_sentence(group.figures[0])}"
    return NO_HUMAN_FIGURE


def _facts(data: StudyData, groups: Sequence[GroupReport], runs: Sequence[PolicyRun]) -> Facts:
    people = groups[0]
    ids = {person.id for person in data.people if person.kind == "human"}
    ranked = [each for each in data.trials if each.participant in ids and each.phase == "ranked" and each.ended_ms is not None]
    minutes = [((trial.ended_ms or 0) - trial.started_ms) / 60_000 for trial in ranked]
    told = "; ".join(f"{figure.name}: {figure_sentence(figure)}" for figure in people.figures if figure.players)
    return Facts(
        data.protocol,
        _iso(data.frozen_ms),
        data.protocol_hash,
        data.closed_ms is not None,
        version("marsexplorer-playground"),
        people.figure.players,
        people.joined,
        people.finished,
        len(ranked),
        sum(bool(trial.labels) for trial in ranked),
        median(minutes) if minutes else None,
        tuple(run.name for run in runs),
        told,
    )


def _iso(ms: int) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(ms / 1000))
