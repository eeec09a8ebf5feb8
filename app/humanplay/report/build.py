"""A study's report from its data.

It says who enters, and has the estimates, the comparisons, the protocol deviations and the
cautions.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version

import numpy as np

from humanplay.report.cautions import cautions, deviations, study_deviations
from humanplay.report.checklist import checklist, exposure
from humanplay.report.costs import CostSummary, reason_not_judged, with_player_names
from humanplay.report.model import (
    SYNTHETIC,
    GroupReport,
    Metric,
    PlayerRow,
    PolicyRow,
    PolicyRun,
    Report,
)
from humanplay.report.statistics.arms import arm_comparisons, arm_rows
from humanplay.report.statistics.attestation_summary import attestation_summary
from humanplay.report.statistics.comparisons import (
    FEWEST_TO_TEST,
    PolicyComparison,
    compare_policy,
    holm,
    policy_p,
)
from humanplay.report.statistics.exclusion_sets import (
    METRICS,
    Cohort,
    Everybody,
    MetricName,
    everybody_of,
    flagged,
    members,
    people_of,
    scripts_of,
    statuses,
)
from humanplay.report.statistics.first_attempts import first_attempts
from humanplay.report.statistics.formatting import utc
from humanplay.report.statistics.intervals import INTERVAL_IN_WORDS, player_means
from humanplay.report.statistics.learning import assess_learning, trial_means
from humanplay.report.statistics.spread import iqm, iqm_interval, variance_components
from humanplay.report.statistics.study_figures import (
    headline,
    interval_for,
    status_rows,
    study_figures,
    worst_value,
)
from humanplay.report.statistics.summaries import Pictures
from humanplay.study.data import StudyData
from humanplay.study.flow import Status, participant_flow
from humanplay.study.language_counts import ANOTHER_LANGUAGE, count_languages
from humanplay.study.policy_episodes import tested_policies
from humanplay.study.protocol import Protocol
from marsexplorer.intervals import Floats

ESTIMAND = (
    "The mean, over players and instances like these, of a player's mean: every player weighs the same. Per protocol: of those "
    "who finished as the protocol asks. Everybody: of those who began a ranked episode. A difference is claimed only where "
    "both estimates show it."
)


def build(
    data: StudyData,
    runs: Sequence[PolicyRun] = (),
    synthetic: bool = False,
    pictures: Mapping[str, Pictures] | None = None,
    costs: Mapping[str, CostSummary] | None = None,
) -> Report:
    """The report of a study: over its people, or over its scripts when `synthetic`.

    Args:
        runs: Policies on the ranked terrains (`humanplay.report.making.runs_of`); none: no
            comparisons.
        pictures: By group's name, what `summarize_groups` gives; none: no curves and visit maps.
        costs: By group's name, what `humanplay.report.costs.costs_of_people` gives; none: no costs.
    """
    data = data.shown()
    cohorts = scripts_of(data) if synthetic else [people_of(data)]
    groups = []
    for cohort in cohorts:
        group = _group(data, cohort, runs, (pictures or {}).get(cohort.name, Pictures()))
        groups.append(_with_costs(data, cohort, group, costs or {}))
    policies = data.protocol.environment.policies
    names = [policies.title(run.name) for run in runs]
    return Report(
        study=data.protocol.name,
        title=data.protocol.title,
        synthetic=synthetic,
        status=_status(data),
        made_at=utc(time.time_ns() // 1_000_000),
        software_version=version("humanplay"),
        core_version=data.protocol.environment.version,
        protocol_hash=data.protocol_hash,
        commitment=data.commitment,
        frozen_at=utc(data.frozen_ms),
        closed_at=None if data.closed_ms is None else utc(data.closed_ms),
        protocol=data.protocol.model_dump(mode="json"),
        estimand=ESTIMAND,
        rule=INTERVAL_IN_WORDS,
        interval_for=interval_for(data.protocol),
        sentence=_sentence(data, groups, synthetic),
        groups=tuple(groups),
        policies=tuple(_policy_row(run, data.protocol.environment.successes) for run in runs),
        deviations=study_deviations(data),
        scripts=_script_counts(data),
        checklist=() if synthetic else checklist(data, groups[0], names),
    )


def _status(data: StudyData) -> str:
    if data.protocol.dry_run_of is not None:
        return "dry run"
    return "open" if data.closed_ms is None else "closed"


def _script_counts(data: StudyData) -> dict[str, int]:
    """How many scripted participants there are of each kind."""
    scripts = [person.script or "script" for person in data.people if person.kind == "script"]
    return dict(sorted(Counter(scripts).items()))


def _group(
    data: StudyData, cohort: Cohort, runs: Sequence[PolicyRun], pictures: Pictures
) -> GroupReport:
    """Everything about one group: its people or one kind of script."""
    finished = members(cohort, data.protocol.per_protocol)
    everybody = everybody_of(data, cohort)
    by_person = statuses(data, cohort)
    trials = [trial for ranked in cohort.ranked.values() for trial in ranked]
    began = {trial.participant for trial in data.trials if trial.phase == "ranked"}
    is_human = cohort.kind == "human"
    protocol = data.protocol
    worst: dict[str, float | None] = {
        metric: worst_value(protocol.environment, protocol.env_config, metric) for metric in METRICS
    }
    return GroupReport(
        name=cohort.name,
        words=data.protocol.environment.about.words,
        kind=cohort.kind,
        joined=len(cohort.people),
        started=len(began & set(cohort.ranked)),
        finished=sum(person.completed_ms is not None for person in cohort.people),
        left=_left(data, cohort),
        stages=dict(sorted(Counter(person.stage for person in cohort.people).items())),
        outcomes=dict(Counter(str(trial.outcome) for trial in trials)),
        labels=dict(Counter(label for trial in trials for label in trial.labels)),
        flags=_flags(data, cohort, everybody),
        figures=study_figures(data, cohort, everybody),
        worst=worst,
        statuses=status_rows(data, cohort, everybody),
        arms=arm_rows(data, cohort, everybody),
        arm_comparisons=arm_comparisons(data, cohort, everybody),
        metrics=tuple(_metric(data, cohort, finished, metric) for metric in METRICS)
        if finished
        else (),
        players=tuple(
            _player_row(everybody.cohort, person, number, by_person[person])
            for number, person in enumerate(members(everybody.cohort, {}), 1)
        ),
        comparisons=_comparisons(protocol, cohort, finished, everybody, runs),
        deviations=deviations(data, cohort),
        cautions=(),
        first_attempts=first_attempts(cohort) if is_human else None,
        exposure=exposure(data) if is_human else None,
        answers=data.answers if is_human else (),
        languages=_languages(data, cohort) if is_human and data.shows_people else {},
        flow=participant_flow(data.arrivals, by_person.values()) if is_human else None,
        attestation=attestation_summary(data) if is_human else None,
        repeated=dict(Counter(sign for person in cohort.people for sign in person.repeated)),
        pictures=pictures,
    )


def _with_costs(
    data: StudyData, cohort: Cohort, group: GroupReport, costs: Mapping[str, CostSummary]
) -> GroupReport:
    """A group's report with its costs, under the report's names, and its cautions."""
    people = members(everybody_of(data, cohort).cohort, {})
    names = {person: f"P{number:02d}" for number, person in enumerate(people, 1)}
    summary = costs.get(cohort.name)
    shown = None if summary is None else with_player_names(summary, names)
    reason = None if data.protocol.environment.courses is None else reason_not_judged(data)
    named = replace(group, costs=shown, no_costs=reason)
    return replace(named, cautions=cautions(data, named))


def _flags(data: StudyData, cohort: Cohort, everybody: Everybody) -> dict[str, int]:
    """How many who began break each rule; empty for an open study's people."""
    if cohort.kind == "human" and not data.shows_people:
        return {}
    by_words = flagged(cohort, everybody.reasons, data.protocol.flags)
    return {words: len(people) for words, people in by_words.items()}


def _left(data: StudyData, cohort: Cohort) -> int:
    """How many have withdrawn, or had not finished when the study was closed."""
    is_closed = data.closed_ms is not None
    people = cohort.people
    return sum(p.stage == "withdrawn" or (is_closed and p.completed_ms is None) for p in people)


def _languages(data: StudyData, cohort: Cohort) -> dict[str, int]:
    """How many who agreed read each of the protocol's languages, rare ones joined."""
    first, *others = data.protocol.languages
    agreed = [person for person in cohort.people if person.consent_version is not None]
    if not others:
        return {first: len(agreed)}
    people = count_languages(person.settings.get("language") for person in agreed)
    named = [*data.protocol.languages, ANOTHER_LANGUAGE]
    return {language: people[language] for language in named if language in people}


def _metric(data: StudyData, cohort: Cohort, ids: Sequence[str], metric: MetricName) -> Metric:
    table = cohort.table(ids, metric)
    several = min(table.shape) > 1 and not np.isnan(table).all(axis=0).any()
    margin = data.protocol.equivalence_margin if metric == "steps" else None
    return Metric(
        name=metric,
        mean=float(player_means(table).mean()),
        iqm=iqm(table),
        iqm_interval=iqm_interval(table) if several else None,
        variance=variance_components(table),
        learning=assess_learning(metric, cohort.table(ids, metric, "trial"), margin),
        warm_up=trial_means(cohort.warm_up_table(ids, metric)),
    )


def _player_row(cohort: Cohort, person: str, number: int, status: Status) -> PlayerRow:
    trials = cohort.ranked[person]
    score, steps = (float(player_means(cohort.table([person], metric))[0]) for metric in METRICS)
    explored = sum(trial.succeeded for trial in trials)
    counts = {"episodes": len(trials), "explored": explored, "failed": len(trials) - explored}
    return PlayerRow(f"P{number:02d}", score=score, steps=steps, status=status.value, **counts)


def _comparisons(
    protocol: Protocol,
    cohort: Cohort,
    finished: Sequence[str],
    everybody: Everybody,
    runs: Sequence[PolicyRun],
) -> tuple[PolicyComparison, ...]:
    """Every policy's comparison in each metric; none without finishers or policies."""
    if not finished or not runs:
        return ()
    began = members(everybody.cohort, {})
    rows: list[PolicyComparison] = []
    for metric in METRICS:
        worst = worst_value(protocol.environment, protocol.env_config, metric)
        second = None if worst is None else everybody.cohort.table(began, metric)
        rows += _comparisons_in(protocol, metric, cohort.table(finished, metric), second, runs)
    return tuple(rows)


def _comparisons_in(
    protocol: Protocol,
    metric: MetricName,
    finished: Floats,
    everybody: Floats | None,
    runs: Sequence[PolicyRun],
) -> list[PolicyComparison]:
    """Every policy's comparison in one metric.

    Those of the primary metric have the p values of the protocol's family.

    Args:
        finished, everybody: The tables of both estimates; without the second one no p, since a
            difference is claimed only if both show it.
    """
    # terrains that at least one player and every policy played
    shared = ~np.isnan(finished).all(axis=0)
    for run in runs:
        shared &= ~np.isnan(run.values(metric))
    values = {run.name: run.values(metric)[shared] for run in runs}
    played = finished[:, shared]
    players, random = played[~np.isnan(played).all(axis=1)], values.get("random")
    if not len(players):
        return []
    worst = worst_value(protocol.environment, protocol.env_config, metric)
    drawn = protocol.terrains_drawn
    rows = {
        name: compare_policy(name, metric, scores, players, random, worst, drawn)
        for name, scores in values.items()
    }
    if everybody is None:
        return list(rows.values())
    began = everybody[:, shared]
    for name, scores in values.items():
        second = compare_policy(name, metric, scores, began, None, worst, drawn)
        rows[name] = replace(
            rows[name], everybody=second.difference, everybody_interval=second.interval
        )
    family = [name for name in tested_policies(protocol) if name in rows]
    if metric != protocol.primary_metric or not family or len(players) < FEWEST_TO_TEST:
        return list(rows.values())
    p_of = partial(policy_p, players, began, worst=worst, terrains_drawn=drawn)
    p_values = np.array([p_of(values[name]) for name in family])
    if not np.isnan(p_values).any():
        for name, p, adjusted in zip(family, p_values, holm(p_values), strict=True):
            rows[name] = replace(rows[name], p_value=float(p), p_adjusted=float(adjusted))
    return list(rows.values())


def _policy_row(run: PolicyRun, successes: frozenset[str]) -> PolicyRow:
    has_score = ~np.isnan(run.score)
    return PolicyRow(
        name=run.name,
        episodes=int(has_score.sum()),
        score=float(run.score[has_score].mean()),
        steps=float(run.steps[has_score].mean()),
        completed=sum(outcome in successes for outcome in run.outcomes),
        failed=sum(outcome in ("collided", "out_of_bounds", "failed") for outcome in run.outcomes),
        pictures=run.pictures,
    )


def _sentence(data: StudyData, groups: Sequence[GroupReport], synthetic: bool) -> str:
    """The headline of the report."""
    if synthetic:
        return SYNTHETIC if groups else f"{SYNTHETIC} No script has played this study."
    per_protocol, everybody, *_ = groups[0].figures
    return headline(data, per_protocol, everybody)
