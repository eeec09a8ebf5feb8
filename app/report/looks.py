"""What a report says of a planned look: which one it is, its boundary, its interval, and whether a policy lies beyond it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.report.policies import PolicyRun
from app.statistics.comparisons import player_means
from app.statistics.exclusion_sets import METRICS, MetricName, members, people_of
from app.statistics.intervals import Interval, printed_interval
from app.statistics.sequential import Boundary, look_boundary
from app.statistics.study_figures import primary_set
from app.study.data import LookTaken, StudyData
from marsexplorer.evaluation.intervals import Floats, t_quantile


@dataclass(frozen=True)
class Crossing:
    """A policy at a look: whether its difference from the people's mean has crossed the boundary.

    difference  policy - people, over the terrains that both played
    interval    of it for other players on these terrains, at the look's level
    crossed     whether the interval leaves 0 out: then stopping here is allowed for a conclusion about this policy
    """

    policy: str
    metric: str
    difference: float
    interval: Interval
    crossed: bool


@dataclass(frozen=True)
class LookSection:
    """A planned look, or the final analysis of a study that had looks.

    number, of  which look, of how many
    players     finished players it is of; `planned` in all
    fraction    of the planned players
    spending    how alpha is spent; `spent` of 0.05 so far
    z           the boundary for normal means; None where none can be crossed so early
    t           the same for this many players: what the printed interval uses; None likewise
    confidence  level of the printed interval
    crossings   by policy and metric
    taken       looks that were taken while the study was open, in the order of time
    """

    number: int
    of: int
    players: int
    planned: int
    is_final: bool
    fraction: float
    spending: str
    spent: float
    z: float | None
    t: float | None
    confidence: float
    crossings: tuple[Crossing, ...]
    taken: tuple[LookTaken, ...]


def look_section(data: StudyData, runs: Sequence[PolicyRun]) -> LookSection | None:
    """Return the section of the look that is shown; None where none is. `data` is what `app.study.looks.present` gives."""
    boundary, view = look_boundary(data), data.view
    if boundary is None or view is None or view.players is None:
        return None
    cohort = people_of(data)
    ids = members(cohort, data.protocol.exclusion.get(primary_set(data), {}))
    is_open_end = boundary.confidence >= 1
    has_t = len(ids) > 1 and not is_open_end
    return LookSection(
        number=len(view.fractions),
        of=max(len(data.protocol.looks), len(view.fractions)),
        players=view.players,
        planned=data.protocol.players,
        is_final=data.closed_ms is not None,
        fraction=boundary.fraction,
        spending=data.protocol.spending,
        spent=boundary.spent,
        z=None if is_open_end else boundary.z,
        t=t_quantile(len(ids) - 1, boundary.confidence) if has_t else None,
        confidence=boundary.confidence,
        crossings=tuple(
            crossing
            for metric in METRICS
            for run in runs
            if has_t
            and (crossing := _crossing(run, metric, cohort.table(ids, metric), boundary))
            is not None
        ),
        taken=data.looks,
    )


def _crossing(
    run: PolicyRun, metric: MetricName, table: Floats, boundary: Boundary
) -> Crossing | None:
    """Return where a policy stands at a look; None without a terrain that both played."""
    differences = run.values(metric) - table
    differences = differences[:, ~np.isnan(differences).all(axis=0)]
    if not differences.size or np.isnan(differences).all(axis=1).any():
        return None
    means = player_means(differences)
    low, high = (float(end) for end in printed_interval(means, boundary.confidence))
    return Crossing(run.name, metric, float(means.mean()), (low, high), not low <= 0 <= high)
