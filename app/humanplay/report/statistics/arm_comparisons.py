"""Arms compared: people nested in arms, terrains crossed with them.

A study is a table float64[..., people, terrains] for each arm, NaN where somebody did not finish a
terrain; leading axes are studies. The model is value = mean of the arm + person + terrain + terrain
in that arm + rest. A terrain's own difficulty is the same in both arms and leaves the difference.
What is left varies by the people of each arm (Welch 1938, Biometrika 29), and, for a claim about
other terrains, by how differently the arms do on each terrain. Degrees of freedom are
Satterthwaite's (1946, Biometrics Bull. 2(6)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy

from humanplay.report.statistics.comparisons import FEWEST_TO_TEST, finite_ends, holm
from humanplay.report.statistics.intervals import Interval, player_means
from marsexplorer.intervals import CONFIDENCE, Floats


@dataclass(frozen=True)
class ArmComparison:
    """Two arms compared in one metric.

    Attributes:
        difference: Of the arm minus the other one, between the means of those who finished as the
            protocol asks, with its 95 % interval; None where nobody did in one of them.
        everybody: The same of everybody who began; None where no lowest score is declared.
        p_value: The larger p of both estimates; None where the protocol plans no test of it.
        p_adjusted: `p_value` by Holm's method over all pairs of arms.
    """

    arm: str
    other: str
    metric: str
    difference: float | None
    interval: Interval | None
    everybody: float | None = None
    everybody_interval: Interval | None = None
    p_value: float | None = None
    p_adjusted: float | None = None


@dataclass(frozen=True)
class Difference:
    """Differences of two arms with variances and degrees of freedom, float64[...]."""

    mean: Floats
    variance: Floats
    freedom: Floats

    @property
    def interval(self) -> tuple[Floats, Floats]:
        """Low and high of the 95 % interval."""
        quantile = scipy.special.stdtrit(self.freedom, 1 - (1 - CONFIDENCE) / 2)
        reach = quantile * np.sqrt(self.variance)
        return self.mean - reach, self.mean + reach

    @property
    def p_value(self) -> Floats:
        """The two-sided p: below 0.05 if the interval leaves 0 out."""
        with np.errstate(invalid="ignore", divide="ignore"):
            t = np.abs(self.mean) / np.sqrt(self.variance)
        return np.asarray(2 * scipy.special.stdtr(self.freedom, -t))


def difference_of(one: Floats, other: Floats, terrains_drawn: bool = True) -> Difference:
    """The difference between the means of two arms.

    Args:
        one, other: float64[..., people, terrains] of each arm, at least two people and terrains, a
            value in every row.
        terrains_drawn: Whether the claim is about other terrains too.
    """
    means = [np.nanmean(table, -1) for table in (one, other)]
    of_people = [mean.var(-1, ddof=1) / mean.shape[-1] for mean in means]
    variance = of_people[0] + of_people[1]
    squares = sum(
        part**2 / (mean.shape[-1] - 1) for part, mean in zip(of_people, means, strict=True)
    )
    if terrains_drawn:
        by_terrain = _terrain_means(one) - _terrain_means(other)
        count = (~np.isnan(by_terrain)).sum(-1)
        of_terrains = np.nanvar(by_terrain, -1, ddof=1) / count
        # the rest is in both, and is to count once
        rest = _rest(one) + _rest(other)
        variance = variance + np.maximum(of_terrains - rest, 0.0)
        squares = squares + np.where(of_terrains > rest, of_terrains**2 / (count - 1), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        freedom = variance**2 / squares
    return Difference(means[0].mean(-1) - means[1].mean(-1), variance, freedom)


def _terrain_means(table: Floats) -> Floats:
    """The mean of each terrain, NaN where nobody finished it."""
    counts = (~np.isnan(table)).sum(-2)
    sums = np.nansum(table, -2)
    return np.asarray(np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0))


def _rest(table: Floats) -> Floats:
    """What the rest contributes to the variance of an arm's mean."""
    people, terrains = table.shape[-2:]
    left = table - np.nanmean(table, -1)[..., None] - _terrain_means(table)[..., None, :]
    left = left + np.nanmean(table, (-2, -1))[..., None, None]
    total = (~np.isnan(table)).sum((-2, -1))
    variance = np.nansum(left**2, (-2, -1)) / np.maximum(total - people - terrains + 1, 1)
    return np.asarray(variance / total)


def arm_p(
    finished: tuple[Floats, Floats],
    everybody: tuple[Floats, Floats] | None,
    terrains_drawn: bool = True,
) -> Floats:
    """The two-sided p that two arms do alike: the larger p of both estimates.

    It is 1 where these lie on opposite sides.
    """
    tables = [finished] if everybody is None else [finished, everybody]
    differences = [difference_of(*pair, terrains_drawn) for pair in tables]
    first, last = differences[0], differences[-1]
    larger = np.maximum(first.p_value, last.p_value)
    return np.asarray(np.where(np.sign(first.mean) == np.sign(last.mean), larger, 1.0))


def compare_arms(
    metric: str,
    finished: dict[str, Floats],
    everybody: dict[str, Floats] | None,
    is_tested: bool,
    terrains_drawn: bool = True,
) -> tuple[ArmComparison, ...]:
    """Every two arms compared in one metric.

    Args:
        finished, everybody: The tables of each arm of both estimates; None where no lowest value
            is declared.
        is_tested: Whether the protocol's family of tests is that of the arms, in this metric.
        terrains_drawn: Whether the claim is about other terrains too.

    Returns:
        A comparison of each pair. It has no interval if one of its arms has fewer than five people,
        or if there are fewer than five terrains for a claim about others. None has a p if any lacks
        its interval: Holm's method needs the whole family.
    """
    pairs = list(combinations(finished, 2))
    rows = []
    p_values = np.full(len(pairs), np.nan)
    for number, (arm, other) in enumerate(pairs):
        of_finished = finished[arm], finished[other]
        of_all = None if everybody is None else (everybody[arm], everybody[other])
        first = _row(of_finished, terrains_drawn)
        second = (None, None) if of_all is None else _row(of_all, terrains_drawn)
        rows.append(ArmComparison(arm, other, metric, *first, *second))
        if is_tested and _is_enough(of_finished, terrains_drawn):
            p_values[number] = arm_p(of_finished, of_all, terrains_drawn)
    if np.isnan(p_values).any():
        return tuple(rows)
    tested = zip(rows, p_values, holm(p_values), strict=True)
    return tuple(
        replace(row, p_value=float(p), p_adjusted=float(adjusted)) for row, p, adjusted in tested
    )


def _is_enough(tables: Sequence[Floats], terrains_drawn: bool) -> bool:
    """Whether each arm's people, and the terrains, suffice for an interval and a p."""
    has_terrains = tables[0].shape[-1] >= FEWEST_TO_TEST or not terrains_drawn
    return has_terrains and min(map(len, tables)) >= FEWEST_TO_TEST


def _row(tables: Sequence[Floats], terrains_drawn: bool) -> tuple[float | None, Interval | None]:
    """The difference of two arms, and its interval where people are enough."""
    one, other = tables
    if not len(one) or not len(other):
        return None, None
    difference = float(player_means(one).mean() - player_means(other).mean())
    if not _is_enough(tables, terrains_drawn):
        return difference, None
    return difference, finite_ends(difference_of(one, other, terrains_drawn).interval)
