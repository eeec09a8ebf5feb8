"""People's first attempts, as ARC-AGI-3 counts them: the upper median and the second best of those who completed a terrain.

Every participant meets every ranked terrain once, so every ranked episode is a first attempt. ARC-AGI-3 (ARC Prize 2026, arXiv
2603.24621) compares with the second best first attempt by number of actions, and since April 2026 with the median one. The
upper median is the larger of the two middle values where their number is even.
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
    """One terrain: how many people ended it, how many completed it, and the moves of these; None for fewer than two.

    interval  95 % of the median of those who complete it, from order statistics; None below six
    score, best_score  upper median and best of the scores of all who ended it; None for fewer than two
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
    """A mean over terrains, with its 95 % t interval for other terrains and these people; None for one terrain."""

    mean: float
    interval: Interval | None


@dataclass(frozen=True)
class FirstAttempts:
    """All terrains, and the means over those that two people or more completed (`counted`); None without any."""

    terrains: tuple[TerrainAttempts, ...]
    counted: int
    upper_median: MeanOfTerrains | None
    second_best: MeanOfTerrains | None


def first_attempts(cohort: Cohort) -> FirstAttempts:
    """Return everybody's first attempts; an episode that was given up or spoilt was not completed."""
    trials = [trial for person in members(cohort, {}) for trial in cohort.ranked[person]]
    found = []
    for terrain in range(cohort.terrains):
        own = [trial for trial in trials if trial.terrain_index == terrain]
        moves = sorted(trial.steps_to_target or 0 for trial in own if trial.succeeded)
        each = _terrain(terrain, len(own), moves)
        if len(own) >= FEWEST:
            scores = [metric_value(trial, "score") for trial in own]
            each = replace(each, score=statistics.median_high(scores), best_score=max(scores))
        found.append(each)
    counted = [each for each in found if each.completed >= FEWEST]
    return FirstAttempts(
        terrains=tuple(found),
        counted=len(counted),
        upper_median=_mean([each.upper_median or 0 for each in counted]),
        second_best=_mean([each.second_best or 0 for each in counted]),
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
    known = np.array(values, np.float64)
    if len(known) < 2:
        return MeanOfTerrains(float(known.mean()), None)
    low, high = map(float, t_interval(known))
    return MeanOfTerrains(float(known.mean()), (low, high))
