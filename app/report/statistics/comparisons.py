"""Policies compared with people on the same terrains: differences, ratios and shares, by one test over players and terrains.

A study is a table float64[players, terrains] of one metric, NaN where a player did not finish a terrain. The unit is the
player: the figure is the mean of the players' means, never of pooled episodes. A policy plays every terrain once, so what is
tested are the cells policy - player: players and terrains are both drawn (`crossed`). Every interval for new
terrains holds exactly those values that this test at 5 % does not reject; so a difference without 0, a ratio without 1 and a
normalized score without 1 are one and the same statement, and so is a p below 0.05. Nothing is drawn at random.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from app.report.statistics.crossed import can_be_crossed, crossed_interval, crossed_p
from app.report.statistics.intervals import Interval, p_value, printed_interval
from marsexplorer.intervals import CONFIDENCE, Floats

FEWEST_TO_TEST = 5
"""Players below whom no p value is given: their spread is too poorly known."""


def player_means(table: Floats) -> Floats:
    """Return each player's mean: float64[players] from a table in which every player has at least one value."""
    return np.asarray(np.nanmean(table, axis=1))


def new_terrains_interval(table: Floats) -> Interval | None:
    """Return the 95 % interval of the mean over players and terrains alike; None where the table is too small for one.

    It never reaches less far than the interval for these terrains.
    """
    return _ends(crossed_interval(table)) if can_be_crossed(table) else None


def _ends(ends: tuple[Floats, Floats]) -> Interval | None:
    low, high = float(ends[0]), float(ends[1])
    return (low, high) if np.isfinite([low, high]).all() else None


@dataclass(frozen=True)
class PolicyComparison:
    """A policy compared with the people on the same terrains, in one metric. Intervals are 95 %.

    mean                   of the policy over the terrains
    difference             policy - people: the mean over players of a player's mean difference on the terrains they finished
    these                  interval of the difference for other players on exactly these terrains
    new                    interval of the difference for other players and other terrains
    p_value                of the test that the difference is 0 (`policy_p`); None where the protocol plans no test of it
    p_adjusted             `p_value` by Holm's method over the policies that the protocol names, without `random`
    ratio                  policy / people (the 85.8 % of the paper is this figure), over players and terrains
    normalized             (policy - random) / (people - random), over players and terrains; None for `random`, without it,
                           and where people may be no better
    """

    policy: str
    metric: str
    mean: float
    terrains: int
    difference: float
    these: Interval | None
    new: Interval | None
    ratio: float | None
    ratio_interval: Interval | None
    normalized: float | None
    normalized_interval: Interval | None
    p_value: float | None = None
    p_adjusted: float | None = None


def compare_policy(
    policy: str, metric: str, values: Floats, table: Floats, random: Floats | None = None
) -> PolicyComparison:
    """Return the comparison of a policy's values float64[terrains] with the players' table float64[players, terrains].

    random    of the policy `random` on the same terrains, None where it was not played
    """
    differences = values - table
    several, can_be_drawn = len(table) > 1, can_be_crossed(table)
    ratio, ratio_interval = _ratio(values, table)
    zero = random if policy != "random" else None
    normalized, normalized_interval = _normalized(values, zero, table)
    return PolicyComparison(
        policy=policy,
        metric=metric,
        mean=float(values.mean()),
        terrains=len(values),
        difference=float(player_means(differences).mean()),
        these=_ends(printed_interval(player_means(differences))) if several else None,
        new=_ends(crossed_interval(differences)) if can_be_drawn else None,
        ratio=ratio,
        ratio_interval=ratio_interval,
        normalized=normalized,
        normalized_interval=normalized_interval,
    )


def policy_p(
    finished: Floats,
    everybody: Floats | None,
    values: Floats,
    worst: float | None = None,
    terrains_drawn: bool = True,
) -> Floats:
    """The two-sided p that a policy equals the people: the larger p of both estimates.

    Args:
        finished: float64[..., participants, terrains] of those who finished, NaN for a gap.
        everybody: The same of everybody who began; None where no lowest value is declared.
        values: The policy's, float64[..., terrains].
        worst: The worst value that a participant's episode can have; None where none is declared.
        terrains_drawn: Whether the claim is about other terrains too.

    Returns:
        float64[...]; NaN below five who finished, and where a table is too small for the test.
    """
    worst_difference = None if worst is None else values - worst
    found = [
        p_value(values[..., None, :] - table, worst_difference, terrains_drawn)
        for table in (finished, everybody)
        if table is not None
    ]
    larger: Floats = np.maximum.reduce(found)
    return np.where(finished.shape[-2] >= FEWEST_TO_TEST, larger, np.nan)


def _ratio(values: Floats, table: Floats) -> tuple[float | None, Interval | None]:
    """Return policy / people and its interval; no ratio where the people's mean is not positive."""
    if not player_means(table).mean() > 0:
        return None, None
    return quotient_interval(np.where(np.isnan(table), np.nan, values), table)


def _normalized(
    values: Floats, random: Floats | None, table: Floats
) -> tuple[float | None, Interval | None]:
    """Return (policy - random) / (people - random) and its interval; nothing where people may be as good as random."""
    if random is None or player_means(table - random).mean() == 0:
        return None, None
    above = np.where(np.isnan(table), np.nan, values - random)
    quotient, interval = quotient_interval(above, table - random)
    return (quotient, interval) if interval is not None else (None, None)


def quotient_interval(top: Floats, bottom: Floats) -> tuple[float, Interval | None]:
    """Return the quotient of two means over players and terrains, and the values q that the test of top - q bottom = 0 keeps.

    Fieller 1954, J. R. Statist. Soc. B 16(2), with the variance over players and terrains. No interval where the test cannot
    tell the denominator from 0, since then it has no bounds, nor where the table is too small.

    top, bottom  float64[players, terrains], with the same gaps; the mean of `bottom` is not 0
    """
    quotient = float(player_means(top).mean() / player_means(bottom).mean())
    if not can_be_crossed(bottom) or not crossed_p(bottom) < 1 - CONFIDENCE:
        return quotient, None

    def kept(q: float) -> float:
        return float(crossed_p(top - q * bottom)) - (1 - CONFIDENCE)

    middle = float(player_means(bottom).mean())
    start = (float(crossed_interval(bottom)[1]) - middle) / abs(middle)
    step = max(abs(quotient), 1e-3) * max(start, 1e-9)
    return quotient, (_end(kept, quotient, -step), _end(kept, quotient, step))


def _end(kept: Callable[[float], float], inside: float, step: float) -> float:
    """Return where `kept` crosses 0 on the way from `inside` in the direction of `step`."""
    outside = inside + step
    while kept(outside) > 0 and np.isfinite(outside):
        inside, step = outside, 2 * step
        outside = inside + step
    if not kept(inside) > 0:
        return inside
    return float(scipy.optimize.brentq(kept, inside, outside, xtol=1e-13, rtol=1e-12))


def holm(p_values: Floats) -> Floats:
    """Adjust p values float64[..., policies] for their number by Holm's step-down method."""
    order = np.argsort(p_values, axis=-1, kind="stable")
    count = p_values.shape[-1]
    multiplied = np.take_along_axis(p_values, order, -1) * np.arange(count, 0, -1)
    stepped = np.minimum(np.maximum.accumulate(multiplied, axis=-1), 1.0)
    adjusted = np.empty_like(stepped)
    np.put_along_axis(adjusted, order, stepped, -1)
    return adjusted
