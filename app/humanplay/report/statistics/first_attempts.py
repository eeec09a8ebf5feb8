"""People's first attempts, as ARC-AGI-3 counts them.

Every participant meets every ranked terrain once, so every ranked episode is a first attempt.
ARC-AGI-3 (ARC Prize 2026, arXiv 2603.24621) compares with the second best first attempt by number
of actions, and since April 2026 with the median one. The upper median is the larger of the two
middle values if their number is even.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from humanplay.report.statistics.exclusion_sets import Cohort, members, metric_value
from humanplay.report.statistics.intervals import Interval
from marsexplorer.intervals import CONFIDENCE, t_interval

FEWEST = 2
"""People who must have completed a terrain for its upper median and second best."""


@dataclass(frozen=True)
class TerrainAttempts:
    """One terrain: how many people ended it, and how those fared who completed it.

    Attributes:
        upper_median, second_best: Moves of those who completed it; None for fewer than two.
        interval: 95 % of the median of those who complete it, from order statistics; None below
            six.
        score, best_score: Upper median and best of the scores of all who ended it; None for fewer
            than two.
    """

    terrain: int
    played: int
    completed: int
    upper_median: int | None = None
    interval: Interval | None = None
    second_best: int | None = None
    score: float | None = None
    best_score: float | None = None


@dataclass(frozen=True)
class MeanOfTerrains:
    """A mean over terrains.

    Attributes:
        interval: 95 % t interval for other terrains and these people; None for one terrain.
    """

    mean: float
    interval: Interval | None


@dataclass(frozen=True)
class FirstAttempts:
    """All terrains, and the means over some of them.

    Attributes:
        counted: How many terrains two people or more completed: the means are over these.
        upper_median, second_best: None without such a terrain.
    """

    terrains: tuple[TerrainAttempts, ...]
    counted: int
    upper_median: MeanOfTerrains | None
    second_best: MeanOfTerrains | None


def first_attempts(cohort: Cohort) -> FirstAttempts:
    """Everybody's first attempts; an abandoned or spoilt episode is not completed."""
    trials = [trial for person in members(cohort, {}) for trial in cohort.ranked[person]]
    terrains = []
    for terrain in range(cohort.terrains):
        attempts = [trial for trial in trials if trial.terrain_index == terrain]
        moves = sorted(trial.steps_to_target or 0 for trial in attempts if trial.succeeded)
        summary = _terrain(terrain, len(attempts), moves)
        if len(attempts) >= FEWEST:
            scores = [metric_value(trial, "score") for trial in attempts]
            summary = replace(summary, score=statistics.median_high(scores), best_score=max(scores))
        terrains.append(summary)
    counted = [summary for summary in terrains if summary.completed >= FEWEST]
    return FirstAttempts(
        terrains=tuple(terrains),
        counted=len(counted),
        upper_median=_mean([summary.upper_median or 0 for summary in counted]),
        second_best=_mean([summary.second_best or 0 for summary in counted]),
    )


def _terrain(terrain: int, played: int, moves: Sequence[int]) -> TerrainAttempts:
    if len(moves) < FEWEST:
        return TerrainAttempts(terrain, played, len(moves))
    ends = scipy.stats.quantile_test(moves, q=0, p=0.5).confidence_interval(CONFIDENCE)
    low, high = float(ends.low), float(ends.high)
    interval = (low, high) if np.isfinite([low, high]).all() else None
    upper = statistics.median_high(moves)
    return TerrainAttempts(terrain, played, len(moves), upper, interval, moves[1])


def _mean(values: Sequence[int]) -> MeanOfTerrains | None:
    if not values:
        return None
    numbers = np.array(values, np.float64)
    if len(numbers) < 2:
        return MeanOfTerrains(float(numbers.mean()), None)
    low, high = map(float, t_interval(numbers))
    return MeanOfTerrains(float(numbers.mean()), (low, high))
