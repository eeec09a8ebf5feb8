"""95 % intervals for the mean over players, and the rule that says which one is printed.

Every function takes player means as float64[..., n] and works along the last axis, so that the simulation in `coverage`
measures the very code that the report prints with.

The rule, fixed before any data (RULE): the t interval, and on the side of the longer tail, as the sample's skewness says, the
further of t and Hall's transformed t. Under symmetry that costs little; under skewness t alone misses the truth on the side of
the long tail two to four times as often as it should. No interval made from the sample's spread can know of a catastrophe that
happened to nobody in it; `guaranteed` is given for that, and it
becomes the headline where failures are a few players'.

A failure is a ranked episode that ends short of 99 %: it costs far more than players differ otherwise. Where nearly all
failures are a few players', the sample's spread depends on how many of these players it happens to hold, and every interval
made from that spread misses too often. HEADLINE_RULE, fixed before any data, then makes the guaranteed interval the headline.
It looks at the failures alone, never at the figure. No rule can see a kind of player who is not in the sample:
`research.coverage` measures how often the headline misses (docs/report.md).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from app.report.statistics.likelihood import LEVELS, TAIL, lowest_mean, radii
from marsexplorer.intervals import CONFIDENCE, Floats, t_interval, t_quantile

Interval = tuple[float, float]
"""Low and high."""

Ends = tuple[Floats, Floats]
"""Low and high of many intervals."""

FEWEST = 5
"""Participants, and terrains that are drawn, below which no interval is given.

With n values on a side of the truth every interval that follows (a worse episode moves no end
towards better) misses it, which four values do in one study of eight.
"""
UNSEEN = 0.25
"""Of a participant, at the worst value in every episode, by whom the end on that side is moved."""
_BOTH = float(np.sqrt(2))
_AT_TAIL = int(np.flatnonzero(LEVELS == TAIL)[0])
RULE = "t interval on player means, widened on the side of the longer tail to Hall's transformed t where that reaches further"
FEW_PLAYERS = 5
"""Fewer players than this, by the effective number, are a few."""
CHANCE = 0.05
"""Level of the test that all players fail alike."""
HEADLINE_RULE = (
    "empirical likelihood on the means of participants and of terrains, calibrated to Student's t; on the side of the worst "
    "value a quarter of a participant is added who had it in every episode; for other participants and other terrains, or "
    "for other participants alone where the protocol has one ranked terrain or names fixed ones"
)

_FLAT = 1e-9
"""A spread below this share of the largest value is rounding."""


@dataclass(frozen=True)
class Estimate:
    """A mean over players with its interval.

    interval  (low, high) at 95 %, cut off at the metric's bounds; None for one player
    headline  "printed": t, widened on the side of the longer tail (RULE); or "guaranteed"
    skewness  of the player means, bias-corrected; None below three players or without spread
    widened   "low", "high" or None: the end that RULE moved
    """

    mean: float
    players: int
    sd: float | None = None
    interval: Interval | None = None
    headline: str = "printed"
    skewness: float | None = None
    widened: str | None = None


def interval(
    table: Floats,
    worst: float | Floats | None,
    terrains_drawn: bool = True,
    unseen: float = UNSEEN,
) -> Ends:
    """The 95 % interval of the mean of participants' means, for other participants.

    Args:
        table: float64[..., participants, terrains] of one metric; NaN where there is no value.
            Rows without a value are nobody. Leading axes are studies.
        worst: the worst value of a cell, a scalar or float64[..., terrains]; None if none is declared.
        terrains_drawn: whether the interval is for other terrains too; at least five terrains.
        unseen: participants at the worst value, by whom the end on that side is moved.

    Returns:
        Low and high, float64[...] each; NaN below five participants.
    """

    def ends(studies: Floats, worst: Floats | None) -> Floats:
        low, high = _with_the_unseen(studies, worst, unseen)
        at = np.full(len(studies), _AT_TAIL)
        lows = (
            _lowest(_Margins(low, terrains_drawn), at),
            _lowest(_Margins(-high, terrains_drawn), at),
        )
        return np.stack([lows[0], -lows[1]], -1)

    both = _by_participants(ends, table, worst, (2,))
    return both[..., 0], both[..., 1]


def p_value(
    table: Floats,
    worst: float | Floats | None,
    terrains_drawn: bool = True,
    unseen: float = UNSEEN,
) -> Floats:
    """The two-sided p that the mean is 0: below 0.05 exactly where `interval` leaves 0 out.

    It is no lower than 2^-n for n participants, the chance that all are on one side of the mean.

    Args:
        table: of policy minus people, as in `interval`.
        worst: the policy's value minus the worst that a participant can have on a terrain.
        terrains_drawn: whether the test is for other terrains too.
        unseen: as in `interval`.
    """

    def p_values(studies: Floats, worst: Floats | None) -> Floats:
        low, high = _with_the_unseen(studies, worst, unseen)
        is_above = _means(low) > 0
        facing = np.where(is_above[:, None, None], low, -high)
        p = 2 * _level_at_zero(_Margins(facing, terrains_drawn))
        return np.clip(p, 2.0 ** -studies.shape[1], 1.0)

    return _by_participants(p_values, table, worst, ())


def _by_participants(
    function: Callable[[Floats, Floats | None], Floats],
    table: Floats,
    worst: float | Floats | None,
    shape: tuple[int, ...],
) -> Floats:
    """Apply a function to the studies of each number of participants; NaN below five."""
    leading, (rows, columns) = table.shape[:-2], table.shape[-2:]
    studies = table.reshape(-1, rows, columns)
    is_row = np.asarray(~np.isnan(studies).all(-1))
    participants = is_row.sum(-1)
    limits = None
    if worst is not None:
        limits = np.broadcast_to(worst, (*leading, columns)).reshape(-1, columns)
    found = np.full((len(studies), *shape), np.nan)
    for count in np.unique(participants[participants >= FEWEST]):
        own = participants == count
        order = np.argsort(~is_row[own], axis=-1, kind="stable")[:, :count, None]
        chosen = np.take_along_axis(studies[own], order, 1)
        found[own] = function(chosen, None if limits is None else limits[own])
    return found.reshape((*leading, *shape))


def _with_the_unseen(studies: Floats, worst: Floats | None, unseen: float) -> tuple[Floats, Floats]:
    """Two tables in which participants at the worst value move one end each."""
    if worst is None:
        return studies, studies
    share = unseen / studies.shape[1]
    away = worst[:, None, :] - studies
    return studies + share * np.minimum(away, 0.0), studies + share * np.maximum(away, 0.0)


def _means(studies: Floats) -> Floats:
    """The mean of participants' means of each study."""
    return np.asarray(np.nanmean(studies, -1).mean(-1))


class _Margins:
    """Means of participants and of terrains, with the weights that give a study's mean."""

    def __init__(self, studies: Floats, terrains_drawn: bool) -> None:
        known = ~np.isnan(studies)
        values = np.where(known, studies, 0.0)
        count = studies.shape[1]
        cells = known / (count * known.sum(-1, keepdims=True))
        self.terrains_drawn = terrains_drawn
        self.participants = count * (cells * values).sum(-1)
        self.shares = np.full_like(self.participants, 1 / count)
        self.terrain_shares = cells.sum(1)
        total = (cells * values).sum(1)
        # a terrain that nobody played weighs nothing
        middle = np.broadcast_to(total.sum(-1, keepdims=True), total.shape)
        self.terrains = np.divide(
            total, self.terrain_shares, out=middle.copy(), where=self.terrain_shares > 0
        )

    @property
    def largest_terrain_radius(self) -> float:
        """The radius up to which no episode weighs more than in its participant's own mean."""
        participants, terrains = self.participants.shape[-1], self.terrains.shape[-1]
        if participants >= terrains:
            return np.inf
        others = (1 - participants / terrains) / (1 - 1 / terrains)
        return float(-np.log(participants) - (terrains - 1) * np.log(others))

    def some(self, chosen: NDArray[np.bool_]) -> _Margins:
        """The margins of some studies."""
        some = copy(self)
        for name in ("participants", "shares", "terrains", "terrain_shares"):
            setattr(some, name, getattr(self, name)[chosen])
        return some


def _lowest(margins: _Margins, levels: NDArray[np.int64]) -> Floats:
    """The low end of each study, at the level with this number.

    The lowest of three: other weights on participants, on terrains, and half on each. The third
    is as far again from the mean where both differ alike, as the square root of two squares is.
    """

    def of_participants(stretch: float) -> Floats:
        radius = radii(margins.participants.shape[-1], stretch)[levels]
        return lowest_mean(margins.participants, margins.shares, radius)

    def of_terrains(stretch: float) -> Floats:
        radius = radii(margins.terrains.shape[-1], stretch)[levels]
        radius = np.minimum(radius, margins.largest_terrain_radius)
        return lowest_mean(margins.terrains, margins.terrain_shares, radius)

    if not margins.terrains_drawn:
        return of_participants(1.0)
    half = (of_participants(_BOTH) + of_terrains(_BOTH)) / 2
    lowest: Floats = np.minimum.reduce([of_participants(1.0), of_terrains(1.0), half])
    return lowest


def _level_at_zero(margins: _Margins) -> Floats:
    """The one-sided level at which each study's low end is 0, between the nearest of LEVELS.

    0.5 where the mean is not above 0; the last level where the end is above 0 even there.
    """
    mean = margins.participants.mean(-1)
    near, far = np.zeros(len(mean), np.int64), np.full(len(mean), len(LEVELS) - 1)
    ends = np.stack([mean, _lowest(margins, far)])
    is_between = (mean > 0) & (ends[1] <= 0)
    is_open = is_between & (far - near > 1)
    while is_open.any():
        guess = near + (far - near) * ends[0] / np.where(is_open, ends[0] - ends[1], 1.0)
        level = np.clip(np.rint(guess), near + 1, far - 1).astype(np.int64)[is_open]
        end = _lowest(margins.some(is_open), level)
        is_above, places = end > 0, np.flatnonzero(is_open)
        near[places[is_above]], ends[0, places[is_above]] = level[is_above], end[is_above]
        far[places[~is_above]], ends[1, places[~is_above]] = level[~is_above], end[~is_above]
        is_open &= far - near > 1
    share = np.divide(ends[0], ends[0] - ends[1], out=np.zeros_like(mean), where=is_between)
    level = np.exp(np.log(LEVELS[near]) + share * np.log(LEVELS[far] / LEVELS[near]))
    return np.where(is_between, level, np.where(mean > 0, LEVELS[-1], 0.5))


def estimate(
    table: Floats, bounds: Interval, worst: float | Floats | None, terrains_drawn: bool = True
) -> Estimate:
    """The estimate of one study, its interval cut off at the metric's bounds.

    Args:
        table: float64[participants, terrains], at least one participant (see `interval`).
        bounds: lowest and highest mean of a participant; widened to a value that leaves them.
        worst: the worst value of a cell, None if none is declared.
        terrains_drawn: whether the interval is for other terrains too.
    """
    means = np.nanmean(table, -1)
    mean, count = float(means.mean()), len(means)
    sd = float(means.std(ddof=1)) if count > 1 else None
    if count < FEWEST:
        return Estimate(mean, count, sd)
    low, high = _pair(interval(table, worst, terrains_drawn))
    lowest, highest = min(bounds[0], float(means.min())), max(bounds[1], float(means.max()))
    return Estimate(mean, count, sd, (max(low, lowest), min(high, highest)))


def estimate_of_means(values: Floats, bounds: Interval, is_guaranteed: bool = False) -> Estimate:
    """Return the estimate for player means float64[n] (n at least 1) of a metric within `bounds`.

    Bounds that a value leaves, as declared ones of an environment may turn out to be, are widened to it.

    is_guaranteed  whether the interval is the guaranteed one (`is_a_few_players`)
    """
    n = len(values)
    mean = float(values.mean())
    bounds = min(bounds[0], float(values.min())), max(bounds[1], float(values.max()))
    if n < 2:
        return Estimate(mean, n)
    plain, reached = _pair(t_interval(values)), _pair(printed_interval(values))
    within = max(reached[0], bounds[0]), min(reached[1], bounds[1])  # the mean cannot leave them
    sd = float(values.std(ddof=1))
    return Estimate(
        mean=mean,
        players=n,
        sd=sd,
        interval=_pair(guaranteed_interval(values, bounds)) if is_guaranteed else within,
        headline="guaranteed" if is_guaranteed else "printed",
        skewness=float(skewness(values)) if n > 2 and sd > 0 else None,
        widened="low" if reached[0] < plain[0] else "high" if reached[1] > plain[1] else None,
    )


def _check_within(values: Floats, bounds: Interval) -> None:
    floor, ceiling = bounds
    if values.min() < floor - 1e-9 or values.max() > ceiling + 1e-9:
        found = f"{values.min()}..{values.max()}"
        raise ValueError(f"values must lie in {floor}..{ceiling}, got {found}")


def _pair(ends: Ends) -> Interval:
    return float(ends[0]), float(ends[1])


def skewness(values: Floats) -> Floats:
    """Return the bias-corrected skewness G1 along the last axis; 0 below three values or without spread."""
    n = values.shape[-1]
    centred = values - values.mean(-1, keepdims=True)
    second = np.mean(centred**2, -1)
    flat = np.sqrt(second) <= _FLAT * np.abs(values).max(-1)
    if n < 3:
        return np.zeros_like(second)
    plain = np.where(flat, 0.0, np.mean(centred**3, -1) / np.where(flat, 1.0, second) ** 1.5)
    corrected: Floats = plain * np.sqrt(n * (n - 1)) / (n - 2)
    return corrected


def hall_interval(values: Floats, confidence: float = CONFIDENCE) -> Ends:
    """Return low and high by Hall's monotone cubic transformation of t, which takes its first-order skewness out.

    Hall 1992, "On the removal of skewness by transformation", J. R. Statist. Soc. B 54(1): with T = sqrt(n)(mean - mu)/s and
    a = skewness/sqrt(n), g(T) = T + a T^2/3 + a^2 T^3/27 + a/6 is nearly symmetric; solved for mu with t quantiles.
    """
    n = values.shape[-1]
    mean, sd, root = values.mean(-1), values.std(-1, ddof=1), np.sqrt(n)
    skew, quantile = skewness(values) / root, t_quantile(n - 1, confidence)
    # in the order of t_interval, so that both agree to the last bit where there is no skewness
    low, high = (_untransformed(each, skew) * sd / root for each in (quantile, -quantile))
    return mean - low, mean - high


def _untransformed(quantile: float, skew: Floats) -> Floats:
    """Return T with g(T) = quantile; `skew` is skewness / sqrt(n)."""
    small = np.abs(skew) < 1e-6
    divisor = np.where(small, 1.0, skew)
    solved = 3 / divisor * (np.cbrt(1 + divisor * (quantile - divisor / 6)) - 1)
    return np.where(small, quantile, solved)


def printed_interval(values: Floats, confidence: float = CONFIDENCE) -> Ends:
    """Return low and high as the rule prints them (RULE)."""
    t, hall = t_interval(values, confidence), hall_interval(values, confidence)
    skew = skewness(values)
    low = np.where(skew < 0, np.minimum(t[0], hall[0]), t[0])
    high = np.where(skew > 0, np.maximum(t[1], hall[1]), t[1])
    return low, high


_STAKES: Floats = np.sin(np.pi * (np.arange(200) + 0.5) / 400) ** 2
"""Shares staked, in 0..1: quantiles of the arcsine law, so that some nearly all is staked on few players."""


def guaranteed_interval(values: Floats, bounds: Interval) -> Ends:
    """Return low and high that cover the mean with at least 95 % whatever the distribution within `bounds`.

    Betting against each candidate mean with a fixed mixture of stakes; by Markov's inequality the wealth of a bettor against
    the true mean exceeds 40 with a probability of at most 1/40 (Waudby-Smith and Ramdas 2024, J. R. Statist. Soc. B 86(1)).
    ValueError when a value lies outside the bounds. Where a bound is infinite, so is the end on the other side.
    """
    _check_within(values, bounds)
    floor, ceiling = bounds
    if not np.isfinite(ceiling - floor):
        least, most = np.full((2, *values.shape[:-1]), np.inf)
        low = floor + _lower_bound(values - floor) if np.isfinite(floor) else -least
        high = ceiling - _lower_bound(ceiling - values) if np.isfinite(ceiling) else most
        return low, high
    share = np.clip((values - floor) / (ceiling - floor), 0, 1)
    low, high = _lower_bound(share), 1 - _lower_bound(1 - share)
    return floor + (ceiling - floor) * low, floor + (ceiling - floor) * high


def guaranteed_covers(values: Floats, bounds: Interval, truth: Floats) -> NDArray[np.bool_]:
    """Return whether `guaranteed_interval` covers `truth`, without working its ends out."""
    floor, ceiling = bounds
    share = np.clip((values - floor) / (ceiling - floor), 0, 1)
    mean = (truth - floor) / (ceiling - floor)
    covered: NDArray[np.bool_] = ~_is_rejected(share, mean) & ~_is_rejected(1 - share, 1 - mean)
    return covered


def _lower_bound(share: Floats) -> Floats:
    """Return the largest mean that the bettors still reject, by bisection; `share` float64[..., n], none below 0."""
    low, high = np.zeros(share.shape[:-1]), share.mean(-1)
    for _ in range(40):
        middle = (low + high) / 2
        rejected = _is_rejected(share, middle)
        low, high = np.where(rejected, middle, low), np.where(rejected, high, middle)
    return low


def _is_rejected(share: Floats, mean: Floats) -> NDArray[np.bool_]:
    """Return whether bets that the mean is larger than `mean` made 40 out of 1 on average over the stakes."""
    returns = share / np.maximum(mean, 1e-12)[..., None] - 1  # of one unit staked
    wealth = np.log1p(_STAKES[:, None] * returns[..., None, :]).sum(-1)
    most = wealth.max(-1)
    average = most + np.log(np.exp(wealth - most[..., None]).mean(-1))
    return np.asarray(average >= -np.log(TAIL))


def is_a_few_players(failed: Floats, episodes: Floats) -> NDArray[np.bool_]:
    """Return whether failures are a few players'; without failures they are nobody's.

    failed, episodes  float64[..., players]: how many ranked episodes a player failed and played; at least two players
    """
    total = failed.sum(-1)
    alone = (failed > 0).sum(-1) == 1
    many = np.full_like(total, np.inf)
    held_by = np.divide(total**2, (failed**2).sum(-1), out=many, where=total > 0)
    is_unequal = _p_of_equal_rates(failed, episodes) < CHANCE
    return np.asarray(alone | (is_unequal & (held_by < FEW_PLAYERS)))


def _p_of_equal_rates(failed: Floats, episodes: Floats) -> Floats:
    """Return the p of Pearson's chi-squared test that all players fail at one rate; 1 where none or all episodes failed."""
    rate = failed.sum(-1, keepdims=True) / episodes.sum(-1, keepdims=True)
    spread = rate * (1 - rate)
    is_open = spread > 0
    expected = episodes * rate
    none = np.zeros_like(expected)
    squares = np.divide((failed - expected) ** 2, episodes * spread, out=none, where=is_open)
    p = scipy.special.chdtrc(failed.shape[-1] - 1, squares.sum(-1))
    return np.asarray(np.where(is_open[..., 0], p, 1.0))
