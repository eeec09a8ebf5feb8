"""Summaries of many episodes, of people and of policies alike.

There are means with intervals, coverage against steps, visits and trials. An `EpisodeGroup` weighs
once in a mean: a person with all their episodes, or one terrain of a policy. Intervals are 95 % t
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
    """One finished episode, as far as curves and means need it.

    Attributes:
        score: Normalized.
        steps: Moves of a success, the limit for any other ending.
        discoveries: Discovered cells after 0, 1, ... moves, of `cells` that coverage refers to;
            none if nothing is discovered.
        path: (row, col) after 0, 1, ... moves; none without a grid.
    """

    succeeded: bool
    score: float
    steps: int
    discoveries: Sequence[int] | NDArray[np.int32]
    path: Sequence[tuple[int, int]] | NDArray[np.int16]
    cells: int


class Curve(TypedDict):
    """Mean coverage (0..1) at some step counts, with its interval.

    Without an interval for one group.
    """

    steps: list[int]
    mean: list[float]
    low: list[float]
    high: list[float]


class Pictures(TypedDict, total=False):
    """The coverage curve and the visits of each cell.

    They are there if the task has them and episodes were replayed.
    """

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
    """An ended run's summary, in 8 bytes a move."""
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
    """A record's summary, by replay.

    Raises:
        ValueError: If the record is another version's.
    """
    return summary_of(environment, environment.replay_record(record))


EpisodeGroup = Sequence[EpisodeSummary]


def summarize_episodes(config: Configuration, groups: Sequence[EpisodeGroup]) -> EpisodesFigure:
    """Everything that is shown of some groups: at least one, and none of them empty."""
    return {
        "groups": len(groups),
        "episodes": sum(map(len, groups)),
        "score": mean_interval([_mean(episode.score for episode in group) for group in groups]),
        "steps": mean_interval([_mean(episode.steps for episode in group) for group in groups]),
        "completed": _mean(_mean(episode.succeeded for episode in group) for group in groups),
        **curve_and_visits(config, groups),
    }


def curve_and_visits(config: Configuration, groups: Sequence[EpisodeGroup]) -> Pictures:
    """The coverage curve and visit counts of some groups, if they have such."""
    pictures: Pictures = {}
    if any(len(episode.discoveries) for group in groups for episode in group):
        pictures["curve"] = coverage_curve(groups)
    if config.size and any(len(episode.path) for group in groups for episode in group):
        pictures["visits"] = visit_counts(config.size, groups)
    return pictures


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def coverage_curve(groups: Sequence[EpisodeGroup]) -> Curve:
    """Mean coverage (0..1) with its interval at some step counts.

    An episode that has ended keeps its coverage.
    """
    longest = max(len(episode.discoveries) for group in groups for episode in group) - 1
    steps = np.unique(np.linspace(0, longest, min(POINTS, longest + 1)).astype(np.int64))
    coverages = [
        [_held(episode.discoveries, steps) / episode.cells for episode in group] for group in groups
    ]
    means = np.array([np.mean(group, axis=0) for group in coverages])
    low, high = map(_short, t_interval(means.T)) if len(means) > 1 else ([], [])
    return {"steps": steps.tolist(), "mean": _short(means.mean(axis=0)), "low": low, "high": high}


def visit_counts(size: tuple[int, int], groups: Sequence[EpisodeGroup]) -> list[list[float]]:
    """How often the player is on each cell of a grid in a mean episode.

    Returns:
        [rows][cols]; the start counts.
    """
    total = np.zeros(size)
    for group in groups:
        for episode in group:
            cells = np.array(episode.path)
            inside = ((cells >= 0) & (cells < total.shape)).all(axis=1)  # a last move may lead out
            np.add.at(total, tuple(cells[inside].T), 1 / len(group))
    return [_short(row, 3) for row in total / len(groups)]


def trial_summaries(groups: Sequence[EpisodeGroup], most: int = 60) -> list[TrialSummary]:
    """Sum up each person's first, second, ... episode."""
    summaries: list[TrialSummary] = []
    for number in range(min(most, max(map(len, groups)))):
        there = [group[number] for group in groups if len(group) > number]
        score = mean_interval([episode.score for episode in there])
        steps = mean_interval([float(episode.steps) for episode in there])
        summaries.append(
            {"trial": number + 1, "players": len(there), "score": score, "steps": steps}
        )
    return summaries


def _held(discoveries: Sequence[int] | NDArray[np.int32], steps: NDArray[np.int64]) -> Floats:
    """The discovered cells at `steps`; after the end the last ones."""
    counts = np.array(discoveries, np.float64)
    return counts[np.minimum(steps, len(counts) - 1)]


def _short(values: Floats, digits: int = 4) -> list[float]:
    return [round(float(number), digits) for number in values]


def summarize_groups(
    reader: Reader, data: StudyData, synthetic: bool, progress: Progress | None = None
) -> dict[str, Pictures]:
    """The pictures of each group, over the ranked episodes of everybody.

    A player weighs once. Nothing without a grid. Episodes of another core version cannot be
    replayed, and spoilt ones are not their player's: both are left out.

    Args:
        progress: Called with (episodes replayed, episodes in all).
    """
    if data.protocol.env_config.size is None:
        return {}
    cohorts = scripts_of(data) if synthetic else [people_of(data)]
    total = sum(len(unspoilt(trials)) for cohort in cohorts for trials in cohort.ranked.values())
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
        episodes = []
        for trial, record in trial_records(reader, unspoilt(cohort.ranked[person])):
            if trial.core_version == trial.environment.version:
                episodes.append(summary_of_record(trial.environment, record))
            advance()
        if episodes:
            groups.append(episodes)
    return curve_and_visits(data.protocol.env_config, groups)
