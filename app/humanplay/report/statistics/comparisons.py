"""Policies compared with people on the same terrains, by one test.

A study is a table float64[participants, terrains] of one metric, NaN where a participant did not
finish a terrain. A policy plays every terrain once, so the cells policy - person are tested. Every
interval holds exactly the values that this test does not reject at 5 %. So these say the same: a
p below 0.05, a difference without 0, a ratio without 1, a normalized score without 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from humanplay.report.statistics.intervals import (
    Interval,
    differs_from_zero,
    interval,
    p_value,
    player_means,
)
from marsexplorer.intervals import Floats

FEWEST_TO_TEST = 5
"""With fewer players no p value is given: their spread is too poorly known."""

XTOL, RTOL = 1e-13, 1e-12
"""The absolute and the relative tolerance of a quotient's interval."""


def finite_ends(ends: tuple[Floats, Floats]) -> Interval | None:
    """Both ends of an interval; None if one is not finite."""
    low, high = float(ends[0]), float(ends[1])
    return (low, high) if np.isfinite([low, high]).all() else None


@dataclass(frozen=True)
class PolicyComparison:
    """A policy compared with the people on the same terrains, in one metric.

    All is per protocol, except `everybody` and the p-values, which are the larger of both
    estimates. Intervals are 95 %.

    Attributes:
        mean: The policy's over the terrains.
        terrains: How many the policy played.
        difference: Policy - people: the mean over players of a player's mean difference on the
            terrains they finished.
        interval: Of the difference.
        ratio: Policy / people, over players and terrains; the paper's 85.8 % is this figure.
        normalized: (policy - random) / (people - random), over players and terrains. None for
            `random`, if it was not played, and if people are not significantly better than it.
        everybody: Policy - everybody who began; None if no lowest score is declared.
        p_value: Of the test that the difference is 0 (`policy_p`); None if the protocol plans no
            test of it.
        p_adjusted: `p_value` by Holm's method over the policies that the protocol names,
            without `random`.
    """

    policy: str
    metric: str
    mean: float
    terrains: int
    difference: float
    interval: Interval | None
    ratio: float | None
    ratio_interval: Interval | None
    normalized: float | None
    normalized_interval: Interval | None
    everybody: float | None = None
    everybody_interval: Interval | None = None
    p_value: float | None = None
    p_adjusted: float | None = None


def compare_policy(
    policy: str,
    metric: str,
    values: Floats,
    table: Floats,
    random: Floats | None = None,
    worst: float | None = None,
    terrains_drawn: bool = True,
) -> PolicyComparison:
    """Compare a policy with the people on the same terrains.

    Args:
        policy: Its name.
        metric: `score` or `steps`.
        values: The policy's, float64[terrains].
        table: The people's, float64[participants, terrains], NaN for a gap.
        random: The values of the policy `random`; None if it was not played.
        worst: The worst value that a participant's episode can have; None if none is declared.
        terrains_drawn: Whether the intervals are for other terrains too.
    """
    differences = values - table
    worst_difference = None if worst is None else values - worst
    ratio, ratio_interval = quotient_interval(values, table, worst, terrains_drawn)
    normalized, normalized_interval = None, None
    if random is not None and policy != "random":
        worst_above_random = None if worst is None else worst - random
        normalized, normalized_interval = quotient_interval(
            values - random, table - random, worst_above_random, terrains_drawn
        )
    return PolicyComparison(
        policy=policy,
        metric=metric,
        mean=float(values.mean()),
        terrains=len(values),
        difference=float(player_means(differences).mean()),
        interval=finite_ends(interval(differences, worst_difference, terrains_drawn)),
        ratio=ratio,
        ratio_interval=ratio_interval,
        normalized=None if normalized_interval is None else normalized,
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

    It is 1 if the estimates contradict: the policy is ahead of those who finished and behind
    everybody, or the reverse.

    Args:
        finished: float64[..., participants, terrains] of those who finished, NaN for a gap.
        everybody: The same of everybody who began; None if no lowest value is declared.
        values: The policy's, float64[..., terrains].
        worst: The worst value that a participant's episode can have; None if none is declared.
        terrains_drawn: Whether the claim is about other terrains too.

    Returns:
        float64[...]; NaN if fewer than five finished, or if the claim is about other terrains and
        there are fewer than five.
    """
    worst_difference = None if worst is None else values - worst
    differences, is_one_side = _differences(finished, everybody, values)
    p_values = [p_value(table, worst_difference, terrains_drawn) for table in differences]
    p = np.where(is_one_side, np.maximum(p_values[0], p_values[-1]), 1.0)
    return np.where(finished.shape[-2] >= FEWEST_TO_TEST, p, np.nan)


def policy_differs(
    finished: Floats,
    everybody: Floats | None,
    values: Floats,
    worst: float | None = None,
    terrains_drawn: bool = True,
) -> NDArray[np.bool_]:
    """Whether `policy_p` is below 0.05; faster, since it looks at this level alone.

    False where that is NaN.
    """
    worst_difference = None if worst is None else values - worst
    differences, is_one_side = _differences(finished, everybody, values)
    differs = [differs_from_zero(table, worst_difference, terrains_drawn) for table in differences]
    return np.asarray(is_one_side & differs[0] & differs[-1])


def _differences(
    finished: Floats, everybody: Floats | None, values: Floats
) -> tuple[list[Floats], NDArray[np.bool_]]:
    """A policy minus finishers and minus everybody, and whether their signs agree."""
    tables = [finished] if everybody is None else [finished, everybody]
    differences = [values[..., None, :] - table for table in tables]
    signs = [np.sign(np.nanmean(table, -1).mean(-1)) for table in differences]
    return differences, np.asarray(signs[0] == signs[-1])


def quotient_interval(
    top: Floats,
    people: Floats,
    worst: float | Floats | None = None,
    terrains_drawn: bool = True,
) -> tuple[float | None, Interval | None]:
    """The quotient of two means, top / people, and its 95 % interval.

    The interval holds the quotients q for which the test that top - q people = 0 does not reject.

    Args:
        top: float64[terrains].
        people: float64[participants, terrains], NaN for a gap.
        worst: The worst value of the people's cells, a scalar or float64[terrains].
        terrains_drawn: Whether the interval is for other terrains too.

    Returns:
        No quotient unless the people's mean is above 0. No interval unless the test tells their
        mean from 0: it has no bounds then (Fieller 1954, J. R. Statist. Soc. B 16(2)).
    """
    people_mean = float(player_means(people).mean())
    if people_mean <= 0:
        return None, None
    numerator = np.where(np.isnan(people), np.nan, top)
    quotient = float(player_means(numerator).mean()) / people_mean
    if not differs_from_zero(people, worst, terrains_drawn):
        return quotient, None

    def reach(q: float) -> float:
        """How far the interval of top - q people reaches beyond 0, on its nearer side."""
        lowest = None if worst is None else top - q * np.asarray(worst)
        low, high = interval(numerator - q * people, lowest, terrains_drawn)
        return float(min(high, -low))

    low, high = interval(people, worst, terrains_drawn)
    step = max(abs(quotient), 1e-3) * max(float(high - low) / people_mean, 1e-9)
    return quotient, (_end(reach, quotient, -step), _end(reach, quotient, step))


def _end(reach: Callable[[float], float], inside: float, step: float) -> float:
    """Where `reach` crosses 0 on the way from `inside` in the direction of `step`."""
    outside = inside + step
    while reach(outside) > 0 and np.isfinite(outside):
        inside, step = outside, 2 * step
        outside = inside + step
    if not reach(inside) > 0:
        return inside
    return _crossing(reach, inside, outside)


def _crossing(reach: Callable[[float], float], start: float, end: float) -> float:
    """Where `reach` is 0 between two numbers at which its signs differ.

    This is Chandrupatla's method (1997, Advances in Engineering Software 28): inverse quadratic
    interpolation if that is safe, else halving. SciPy has it, but `humanplay.score` must run
    without SciPy.
    """
    # the paper's x1, x2, x3 are newest, opposite, dropped; its f1, f2, f3 are `reach` at them
    newest, opposite = end, start
    at_newest, at_opposite = reach(newest), reach(opposite)
    share = 0.5  # of the way from newest to opposite: the paper's t
    while True:
        # 1. try a point between the two
        between = newest + share * (opposite - newest)
        at_between = reach(between)
        # 2. keep two points with different signs, and remember the one that is dropped
        if (at_between > 0) == (at_newest > 0):
            dropped, at_dropped = newest, at_newest
        else:
            dropped, at_dropped = opposite, at_opposite
            opposite, at_opposite = newest, at_newest
        newest, at_newest = between, at_between

        # 3. stop once the two are as near as the tolerance
        is_newest_nearer = abs(at_newest) < abs(at_opposite)
        nearest = newest if is_newest_nearer else opposite
        least_share = (XTOL + RTOL * abs(nearest)) / abs(opposite - newest)
        if least_share > 0.5 or min(abs(at_newest), abs(at_opposite)) == 0:
            return nearest

        # 4. halve, or interpolate by the inverse parabola if it is monotone between the two
        xi = (newest - opposite) / (dropped - opposite)
        phi = (at_newest - at_opposite) / (at_dropped - at_opposite)
        share = 0.5
        if phi**2 < xi and (1 - phi) ** 2 < 1 - xi:
            by_opposite = at_newest / (at_opposite - at_newest) * at_dropped
            by_dropped = at_newest / (at_dropped - at_newest) * at_opposite
            ratio = (dropped - newest) / (opposite - newest)
            share = by_opposite / (at_opposite - at_dropped) + ratio * by_dropped / (
                at_dropped - at_opposite
            )
        # 5. stay at least the tolerance away from both
        share = min(1 - least_share, max(least_share, share))


def holm(p_values: Floats) -> Floats:
    """Adjust p values for their number by Holm's step-down method.

    Args:
        p_values: float64[..., policies].
    """
    order = np.argsort(p_values, axis=-1, kind="stable")
    count = p_values.shape[-1]
    multiplied = np.take_along_axis(p_values, order, -1) * np.arange(count, 0, -1)
    stepped = np.minimum(np.maximum.accumulate(multiplied, axis=-1), 1.0)
    adjusted = np.empty_like(stepped)
    np.put_along_axis(adjusted, order, stepped, -1)
    return adjusted
