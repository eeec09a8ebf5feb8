"""Summaries of many episodes, of people and of policies alike: means with intervals, coverage against steps, visits, trials.

An `EpisodeGroup` weighs once in a mean: a person with all their episodes, or one terrain of a policy. Intervals are 95 % t
intervals over groups, as in `humanplay.report.statistics.human_level`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from humanplay.db.reader import Reader
from humanplay.jobs import Progress
from humanplay.report.statistics.exclusion_sets import (
    Cohort,
    members,
    people_of,
    scripts_of,
    unspoilt,
)
from humanplay.report.statistics.human_level import mean_interval
from humanplay.report.statistics.study_figures import MeanInterval
from humanplay.study.data import StudyData, trial_records
from humanplay.task import Configuration, Environment, Record, Run
from marsexplorer.intervals import Floats, t_interval

POINTS = 120
"""Points of a drawn curve, at most."""


@dataclass(frozen=True)
class EpisodeSummary:
    """One finished episode, as far as figures need it.

    score        normalized
    steps        moves of a success, the limit for any other ending
    discoveries  discovered cells after 0, 1, ... moves, of `cells` that coverage refers to; none if nothing is discovered
    path         (row, col) after 0, 1, ... moves; none without a grid
    """

    succeeded: bool
    score: float
    steps: int
    discoveries: Sequence[int] | NDArray[np.int32]
    path: Sequence[tuple[int, int]] | NDArray[np.int16]
    cells: int


class Curve(TypedDict):
    """Mean coverage (0..1) with its interval at some step counts; no interval for one group."""

    steps: list[int]
    mean: list[float]
    low: list[float]
    high: list[float]


class Pictures(TypedDict, total=False):
    """The coverage curve and the visits of each cell, where a task has them and episodes were replayed."""

    curve: Curve
    visits: list[list[float]]


class EpisodesFigure(Pictures):
    """What is shown of some groups of episodes."""

    groups: int
    episodes: int
    score: MeanInterval
    steps: MeanInterval
    completed: float


class TrialSummary(TypedDict):
    """How people fared in their first, second, ... episode."""

    trial: int
    players: int
    score: MeanInterval
    steps: MeanInterval


def summary_of(environment: Environment, run: Run) -> EpisodeSummary:
    """Return what figures need of an ended run, in 8 bytes a move."""
    record, cells = run.record(), environment.cells(run.record())
    places = [run.place(step) for step in range(record.steps + 1)] if record.config.size else []
    succeeded = record.outcome in environment.successes
    return EpisodeSummary(
        succeeded=succeeded,
        score=record.score,
        steps=record.steps if succeeded else record.config.limit,
        discoveries=np.array(run.counts() if cells else [], np.int32),
        path=np.array([(place["row"], place["col"]) for place in places if place], np.int16),
        cells=cells,
    )


def summary_of_record(environment: Environment, record: Record) -> EpisodeSummary:
    """Return what figures need of a record, replayed; ValueError where it is another version's."""
    return summary_of(environment, environment.replay_record(record))


EpisodeGroup = Sequence[EpisodeSummary]


def summarize_episodes(config: Configuration, groups: Sequence[EpisodeGroup]) -> EpisodesFigure:
    """Return everything that is shown of some groups (at least one, none of them empty)."""
    return {
        "groups": len(groups),
        "episodes": sum(map(len, groups)),
        "score": mean_interval([_mean(each.score for each in group) for group in groups]),
        "steps": mean_interval([_mean(each.steps for each in group) for group in groups]),
        "completed": _mean(_mean(episode.succeeded for episode in group) for group in groups),
        **curve_and_visits(config, groups),
    }


def curve_and_visits(config: Configuration, groups: Sequence[EpisodeGroup]) -> Pictures:
    """The coverage curve and visit counts of some groups, where they have such."""
    pictures: Pictures = {}
    if any(len(each.discoveries) for group in groups for each in group):
        pictures["curve"] = coverage_curve(groups)
    if config.size and any(len(each.path) for group in groups for each in group):
        pictures["visits"] = visit_counts(config.size, groups)
    return pictures


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def coverage_curve(groups: Sequence[EpisodeGroup]) -> Curve:
    """Return mean coverage (0..1) with its interval at some step counts; an episode that has ended keeps what it had."""
    longest = max(len(each.discoveries) for group in groups for each in group) - 1
    steps = np.unique(np.linspace(0, longest, min(POINTS, longest + 1)).astype(np.int64))
    held = [[_held(each.discoveries, steps) / each.cells for each in group] for group in groups]
    means = np.array([np.mean(group, axis=0) for group in held])
    low, high = map(_short, t_interval(means.T)) if len(means) > 1 else ([], [])
    return {"steps": steps.tolist(), "mean": _short(means.mean(axis=0)), "low": low, "high": high}


def visit_counts(size: tuple[int, int], groups: Sequence[EpisodeGroup]) -> list[list[float]]:
    """Return how often the player is on each cell of a grid in a mean episode, [rows][cols]; the start counts."""
    total = np.zeros(size)
    for group in groups:
        for each in group:
            cells = np.array(each.path)
            inside = ((cells >= 0) & (cells < total.shape)).all(axis=1)  # a last move may lead out
            np.add.at(total, tuple(cells[inside].T), 1 / len(group))
    return [_short(row, 3) for row in total / len(groups)]


def trial_summaries(groups: Sequence[EpisodeGroup], most: int = 60) -> list[TrialSummary]:
    """Sum up each person's first, second, ... episode."""
    summaries: list[TrialSummary] = []
    for number in range(min(most, max(map(len, groups)))):
        there = [group[number] for group in groups if len(group) > number]
        score = mean_interval([each.score for each in there])
        steps = mean_interval([float(each.steps) for each in there])
        summaries.append(
            {"trial": number + 1, "players": len(there), "score": score, "steps": steps}
        )
    return summaries


def _held(discoveries: Sequence[int] | NDArray[np.int32], steps: NDArray[np.int64]) -> Floats:
    """Return the discovered cells at `steps`, the last ones after the end."""
    known = np.array(discoveries, np.float64)
    return known[np.minimum(steps, len(known) - 1)]


def _short(values: Floats, digits: int = 4) -> list[float]:
    return [round(float(value), digits) for value in values]


def summarize_groups(
    reader: Reader, data: StudyData, synthetic: bool, progress: Progress | None = None
) -> dict[str, Pictures]:
    """The pictures of each group, over the ranked episodes of everybody (a player weighs once).

    Nothing without a grid. Those of another core version cannot be replayed, and spoilt ones are not their
    player's: both are left out.
    progress: (episodes replayed, in all)
    """
    if data.protocol.env_config.size is None:
        return {}
    cohorts = scripts_of(data) if synthetic else [people_of(data)]
    total = sum(len(unspoilt(own)) for cohort in cohorts for own in cohort.ranked.values())
    done = 0

    def advance() -> None:
        nonlocal done
        done += 1
        if progress:
            progress(done, total)

    return {cohort.name: _pictures(reader, data, cohort, advance) for cohort in cohorts}


def _pictures(
    reader: Reader, data: StudyData, cohort: Cohort, advance: Callable[[], None]
) -> Pictures:
    groups: list[Sequence[EpisodeSummary]] = []
    for person in members(cohort, {}):
        own = []
        for trial, record in trial_records(reader, unspoilt(cohort.ranked[person])):
            if trial.core_version == trial.environment.version:
                own.append(summary_of_record(trial.environment, record))
            advance()
        if own:
            groups.append(own)
    return curve_and_visits(data.protocol.env_config, groups)
