"""Policies compared with people on the same terrains, by one test.

There are differences, ratios and shares. A study is a table float64[participants, terrains] of one
metric, NaN where a participant did not finish a terrain. A policy plays every terrain once, so what
is tested are the cells policy - person. Every interval holds exactly those values that the test at
5 % does not reject; so a difference without 0, a ratio without 1 and a normalized score without 1
are one and the same statement, and so is a p below 0.05.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from humanplay.report.statistics.intervals import Interval, interval, p_value, player_means
from marsexplorer.intervals import CONFIDENCE, Floats

FEWEST_TO_TEST = 5
"""Players below whom no p value is given: their spread is too poorly known."""

XTOL, RTOL = 1e-13, 1e-12
"""How near an end of an interval is found: this far, and this share of it further."""


def finite_ends(ends: tuple[Floats, Floats]) -> Interval | None:
    """Both ends of an interval; None if one is not finite."""
    low, high = float(ends[0]), float(ends[1])
    return (low, high) if np.isfinite([low, high]).all() else None


@dataclass(frozen=True)
class PolicyComparison:
    """A policy compared with the people on the same terrains, in one metric.

    Intervals are 95 %.

    Attributes:
        mean: Of the policy over the terrains.
        difference: Policy - people: the mean over players of a player's mean difference on the
            terrains they finished.
        interval: Of the difference.
        everybody: Policy - everybody who began, with its interval; the other fields are per
            protocol; None where no lowest score is declared.
        p_value: Of the test that the difference is 0 (`policy_p`); None where the protocol
            plans no test of it.
        p_adjusted: `p_value` by Holm's method over the policies that the protocol names,
            without `random`.
        ratio: Policy / people (the 85.8 % of the paper is this figure), over players and
            terrains.
        normalized: (policy - random) / (people - random), over players and terrains; None for
            `random`, without it, and unless people are surely better.
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
        policy: its name.
        metric: "score" or "steps".
        values: the policy's, float64[terrains].
        table: the people's, float64[participants, terrains], NaN for a gap.
        random: the values of the policy `random`; None where it was not played.
        worst: the worst value that a participant's episode can have; None if none is declared.
        terrains_drawn: whether the intervals are for other terrains too.
    """
    differences = values - table
    lowest = None if worst is None else values - worst
    ratio, ratio_interval = quotient_interval(values, table, worst, terrains_drawn)
    normalized, normalized_interval = None, None
    if random is not None and policy != "random":
        above = None if worst is None else worst - random
        normalized, normalized_interval = quotient_interval(
            values - random, table - random, above, terrains_drawn
        )
    return PolicyComparison(
        policy=policy,
        metric=metric,
        mean=float(values.mean()),
        terrains=len(values),
        difference=float(player_means(differences).mean()),
        interval=finite_ends(interval(differences, lowest, terrains_drawn)),
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

    It is 1 where the policy is ahead of those who finished and behind everybody, or the reverse.

    Args:
        finished: float64[..., participants, terrains] of those who finished, NaN for a gap.
        everybody: The same of everybody who began; None where no lowest value is declared.
        values: The policy's, float64[..., terrains].
        worst: The worst value that a participant's episode can have; None where none is declared.
        terrains_drawn: Whether the claim is about other terrains too.

    Returns:
        float64[...]; NaN below five who finished, and below five terrains for a claim about others.
    """
    worst_difference = None if worst is None else values - worst
    tables = [finished] if everybody is None else [finished, everybody]
    differences = [values[..., None, :] - table for table in tables]
    p_values = [p_value(table, worst_difference, terrains_drawn) for table in differences]
    sides = [np.sign(np.nanmean(table, -1).mean(-1)) for table in differences]
    p = np.where(sides[0] == sides[-1], np.maximum(p_values[0], p_values[-1]), 1.0)
    return np.where(finished.shape[-2] >= FEWEST_TO_TEST, p, np.nan)


def quotient_interval(
    top: Floats,
    people: Floats,
    worst: float | Floats | None = None,
    terrains_drawn: bool = True,
) -> tuple[float | None, Interval | None]:
    """The quotient q of two means, with the values of q that a test does not reject.

    The test is that top - q people = 0.

    No quotient where the people's mean is not above 0, and no interval where the test cannot tell it
    from 0, since then there are no bounds (Fieller 1954, J. R. Statist. Soc. B 16(2)).

    Args:
        top: float64[terrains].
        people: float64[participants, terrains], NaN for a gap.
        worst: the worst value of the people's cells, a scalar or float64[terrains].
        terrains_drawn: whether the interval is for other terrains too.
    """
    middle = float(player_means(people).mean())
    if middle <= 0:
        return None, None
    above = np.where(np.isnan(people), np.nan, top)
    quotient = float(player_means(above).mean()) / middle
    if not p_value(people, worst, terrains_drawn) < 1 - CONFIDENCE:
        return quotient, None

    def reach(q: float) -> float:
        """How far the interval of top - q people reaches beyond 0 on its nearer side."""
        lowest = None if worst is None else top - q * np.asarray(worst)
        low, high = interval(above - q * people, lowest, terrains_drawn)
        return float(min(high, -low))

    low, high = interval(people, worst, terrains_drawn)
    step = max(abs(quotient), 1e-3) * max(float(high - low) / middle, 1e-9)
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
    interpolation where that is safe, else halving. `score` needs it without SciPy.
    """
    newest, opposite = end, start
    at_newest, at_opposite = reach(newest), reach(opposite)
    share = 0.5
    while True:
        middle = newest + share * (opposite - newest)
        at_middle = reach(middle)
        if (at_middle > 0) == (at_newest > 0):
            dropped, at_dropped = newest, at_newest
        else:
            dropped, at_dropped = opposite, at_opposite
            opposite, at_opposite = newest, at_newest
        newest, at_newest = middle, at_middle

        is_newest_nearer = abs(at_newest) < abs(at_opposite)
        nearest = newest if is_newest_nearer else opposite
        least_share = (XTOL + RTOL * abs(nearest)) / abs(opposite - newest)
        if least_share > 0.5 or min(abs(at_newest), abs(at_opposite)) == 0:
            return nearest

        place = (newest - opposite) / (dropped - opposite)
        height = (at_newest - at_opposite) / (at_dropped - at_opposite)
        share = 0.5
        if height**2 < place and (1 - height) ** 2 < 1 - place:
            by_opposite = at_newest / (at_opposite - at_newest) * at_dropped
            by_dropped = at_newest / (at_dropped - at_newest) * at_opposite
            ratio = (dropped - newest) / (opposite - newest)
            share = by_opposite / (at_opposite - at_dropped) + ratio * by_dropped / (
                at_dropped - at_opposite
            )
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
