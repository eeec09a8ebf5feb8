"""Learning over the ranked trials: means, the slope, and whether it is flat.

Every participant meets the terrains in an order of their own, so a trial is not a terrain: what
trends is the player.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanplay.report.statistics.intervals import Interval
from marsexplorer.intervals import CONFIDENCE, Floats, t_interval, t_tail

TrialMean = tuple[int, float, float | None, float | None]
"""Players, mean, low and high; low and high None below two players."""

LEVEL = 1 - CONFIDENCE
"""Of each of the two one-sided tests."""


@dataclass(frozen=True)
class Learning:
    """What happened over the ranked trials, from float64[players, trials].

    Attributes:
        by_trial: Per trial, with its t interval over players.
        slope: Change a trial: the mean of each player's least-squares slope, with its t
            interval over players.
        change: Last third minus first third of the trials, mean over players, with its 95 % t
            interval.
        margin: That the protocol names; None: slope and change stand alone, without a test.
        equivalence: The 90 % interval of the change: flat when it lies within +-margin (two
            one-sided tests at 5 %).
        verdict: "not tested", "flat", "changed" (the 95 % interval leaves 0 out), "changed,
            within the margin", or "undecided".
    """

    metric: str
    by_trial: tuple[TrialMean, ...]
    margin: float | None
    slope: float | None
    slope_interval: Interval | None = None
    change: float | None = None
    change_interval: Interval | None = None
    equivalence: Interval | None = None
    p_equivalence: float | None = None
    verdict: str = "not tested"


def assess_learning(metric: str, table: Floats, margin: float | None) -> Learning:
    """What changed over the trials.

    Args:
        table: float64[players, trials], in the order played.
        margin: In the metric's unit; None if the protocol fixes none for it.
    """
    by_trial = trial_means(table)
    slopes = np.array([_slope(row) for row in table if (~np.isnan(row)).sum() > 2])
    slope = float(slopes.mean()) if len(slopes) else None
    changes = _changes(table)
    if len(changes) < 2:
        return Learning(metric, by_trial, margin, slope)
    interval = _interval(changes)
    equivalence, p, verdict = None, None, "not tested"
    if margin is not None:
        equivalence, p = tost(changes, margin)
        verdict = _verdict(interval, equivalence, margin)
    return Learning(
        metric,
        by_trial,
        margin,
        slope,
        slope_interval=_interval(slopes) if len(slopes) > 1 else None,
        change=float(changes.mean()),
        change_interval=interval,
        equivalence=equivalence,
        p_equivalence=p,
        verdict=verdict,
    )


def _verdict(change: Interval, equivalence: Interval, margin: float) -> str:
    """The verdict on the 95 % and the 90 % interval (`Learning.verdict`)."""
    is_inside = -margin < equivalence[0] and equivalence[1] < margin
    has_changed = change[0] > 0 or change[1] < 0
    if is_inside:
        return "changed, within the margin" if has_changed else "flat"
    return "changed" if has_changed else "undecided"


def _interval(values: Floats, confidence: float = CONFIDENCE) -> Interval:
    low, high = t_interval(values, confidence)
    return float(low), float(high)


def _changes(table: Floats) -> Floats:
    """Last third minus first third of the trials, for each player with trials in both."""
    third = table.shape[1] // 3
    first, last = table[:, :third], table[:, table.shape[1] - third :]
    has_both = ~np.isnan(first).all(axis=1) & ~np.isnan(last).all(axis=1)
    changes: Floats = np.nanmean(last[has_both], axis=1) - np.nanmean(first[has_both], axis=1)
    return changes


def tost(changes: Floats, margin: float) -> tuple[Interval, float]:
    """Two one-sided t tests of a mean against +-margin (Schuirmann 1987).

    Returns:
        The 90 % t interval of the mean, and p.
    """
    freedom, mean = len(changes) - 1, float(changes.mean())
    error = float(changes.std(ddof=1) / np.sqrt(len(changes)))
    ends = _interval(changes, 1 - 2 * LEVEL)
    if error == 0:
        return ends, 0.0 if abs(mean) < margin else 1.0
    sides = (mean + margin) / error, (margin - mean) / error
    return ends, max(t_tail(side, freedom) for side in sides)


def trial_means(table: Floats) -> tuple[TrialMean, ...]:
    """The means of every trial of float64[players, trials], NaN for a gap."""
    return tuple(_trial_mean(column[~np.isnan(column)]) for column in table.T)


def _trial_mean(values: Floats) -> TrialMean:
    if len(values) < 2:
        return len(values), float(values[0]) if len(values) else float("nan"), None, None
    return len(values), float(values.mean()), *_interval(values)


def _slope(row: Floats) -> float:
    trials = np.flatnonzero(~np.isnan(row)).astype(np.float64)
    centred = trials - trials.mean()
    return float((centred * row[~np.isnan(row)]).sum() / (centred**2).sum())
