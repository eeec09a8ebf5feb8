"""Learning over the ranked trials: what each trial came to, the slope, and whether performance was flat within a margin.

Every participant meets the terrains in an order of their own, so a trial is not a terrain: what trends is the player.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from marsexplorer.evaluation.intervals import CONFIDENCE, Floats, t_interval

Pair = tuple[float, float]
AtTrial = tuple[int, float, float | None, float | None]
"""Players, mean, low and high; low and high None below two players."""

LEVEL = 1 - CONFIDENCE
"""Of each of the two one-sided tests."""


@dataclass(frozen=True)
class Learning:
    """What happened over the ranked trials. `table` there is float64[players, trials], in the order played.

    by_trial      per trial, with its t interval over players
    slope         change a trial: the mean of each player's least-squares slope, with its t interval over players
    change        last third minus first third of the trials, mean over players, with its 95 % t interval
    equivalence   the 90 % interval of the change: flat when it lies within +-margin (two one-sided tests at 5 %)
    verdict       "flat", "changed" (the 95 % interval leaves 0 out), "changed, within the margin", or "undecided"
    """

    metric: str
    by_trial: tuple[AtTrial, ...]
    slope: float | None
    slope_interval: Pair | None
    change: float | None
    change_interval: Pair | None
    equivalence: Pair | None
    margin: float | None
    p_equivalence: float | None
    verdict: str


def learning(metric: str, table: Floats, margin: float | None) -> Learning:
    """Return what trials changed; `margin` in the metric's unit, None where the protocol fixes none for it."""
    by_trial = at_trials(table)
    slopes = np.array([_slope(row) for row in table if (~np.isnan(row)).sum() > 2])
    third = table.shape[1] // 3
    pieces = (table[:, :third], table[:, -third:]) if third else (table[:, :0], table[:, :0])
    whole = [not np.isnan(first).all() and not np.isnan(last).all() for first, last in zip(*pieces, strict=True)]
    changes = np.array([np.nanmean(b) - np.nanmean(a) for a, b, ok in zip(*pieces, whole, strict=True) if ok])
    if len(changes) < 2:
        slope = float(slopes.mean()) if len(slopes) else None
        return Learning(metric, by_trial, slope, None, None, None, None, margin, None, "undecided")
    low, high = t_interval(changes)
    equivalence, p = tost(changes, margin)
    inside = margin is not None and -margin < equivalence[0] and equivalence[1] < margin
    moved = bool(low > 0 or high < 0)
    verdict = ("changed, within the margin" if moved else "flat") if inside else "changed" if moved else "undecided"
    slope_ends = t_interval(slopes) if len(slopes) > 1 else None
    ends = (float(slope_ends[0]), float(slope_ends[1])) if slope_ends else None
    change = float(changes.mean())
    slope = float(slopes.mean()) if len(slopes) else None
    return Learning(metric, by_trial, slope, ends, change, (float(low), float(high)), equivalence, margin, p, verdict)


def tost(changes: Floats, margin: float | None) -> tuple[Pair, float | None]:
    """Return the 90 % t interval of the mean, and the p of two one-sided t tests against +-margin (Schuirmann 1987)."""
    freedom, mean = len(changes) - 1, float(changes.mean())
    error = float(changes.std(ddof=1) / np.sqrt(len(changes)))
    low, high = t_interval(changes, 1 - 2 * LEVEL)
    ends = (float(low), float(high))
    if margin is None:
        return ends, None
    if error == 0:
        return ends, 0.0 if abs(mean) < margin else 1.0
    p = stats.t.sf([(mean + margin) / error, (margin - mean) / error], freedom)
    return ends, float(p.max())


def at_trials(table: Floats) -> tuple[AtTrial, ...]:
    """Return every trial of float64[players, trials], NaN where a player has none."""
    return tuple(_at_trial(column[~np.isnan(column)]) for column in table.T)


def _at_trial(values: Floats) -> AtTrial:
    if len(values) < 2:
        return len(values), float(values[0]) if len(values) else float("nan"), None, None
    low, high = t_interval(values)
    return len(values), float(values.mean()), float(low), float(high)


def _slope(row: Floats) -> float:
    trials = np.flatnonzero(~np.isnan(row)).astype(np.float64)
    centred = trials - trials.mean()
    return float((centred * row[~np.isnan(row)]).sum() / (centred**2).sum())
