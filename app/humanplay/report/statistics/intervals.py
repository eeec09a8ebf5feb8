"""The 95 % interval of a mean over participants, and the p that inverts it.

A study is a table of one metric, participants by terrains. An end of the interval is the lowest or
highest mean that is still likely when participants, terrains, or half of each weigh otherwise
(`likelihood`). On the side of the worst value a quarter of a participant is added who had it in
every episode, since no sample's spread knows of a failure that happened to nobody in it. Everything
works along leading axes, so that `research.coverage` measures the very code that the report prints
with.

The low end for the values x of n participants (or terrains, whose equal weights 1/n become w) is
the least sum of w x with -sum log(n w) <= r(n, 1). Here r(n, s) is the radius at which the normal
scores of ranks i, inverse normal of (i - 3/8) / (n + 1/4), have the lowest mean
-s t(n - 1; 0.975) / sqrt(n); if none is so low, the end is the least x. For half of each it is half
the sum of the two lowest means within r(n, sqrt 2). With fewer participants P than terrains T, the
radius of terrains is at most -log P - (T - 1) log((1 - P/T) / (1 - 1/T)), so that no episode weighs
more than in its participant's mean. The high end is the same for -x. With gaps a terrain's first
weight is the share that its episodes have in the mean.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from humanplay.report.statistics.likelihood import LEVELS, TAIL, lowest_mean, radii
from marsexplorer.intervals import FEWEST, Floats

Interval = tuple[float, float]
"""Low and high."""

Ends = tuple[Floats, Floats]
"""Low and high of many intervals."""

UNSEEN = 0.25
"""Of a participant, at the worst value in every episode, by whom the end on that side is moved."""
_BOTH = float(np.sqrt(2))
_AT_TAIL = int(np.flatnonzero(LEVELS == TAIL)[0])
INTERVAL_IN_WORDS = (
    "empirical likelihood on the means of participants and of instances, calibrated to Student's t; on the side of the worst "
    "value a quarter of a participant is added who had it in every episode; for other participants and other instances, or "
    f"for other participants alone where the protocol has fewer than {FEWEST} ranked instances or names fixed ones"
)


@dataclass(frozen=True)
class Estimate:
    """A mean over players with its interval.

    Attributes:
        interval: (low, high) at 95 %, cut off at the metric's bounds; None below FEWEST
            players, and where its ends are one.
    """

    mean: float
    players: int
    sd: float | None = None
    interval: Interval | None = None


def player_means(table: Floats) -> Floats:
    """Each player's mean: float64[players] from a table without an empty row."""
    return np.asarray(np.nanmean(table, axis=1))


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
        worst: the worst value of a cell, a scalar or float64[..., terrains]; None if none is
            declared.
        terrains_drawn: whether the interval is for other terrains too; at least five terrains.
        unseen: participants at the worst value, by whom the end on that side is moved.

    Returns:
        Low and high, float64[...] each; NaN below five participants, and for other terrains below
        five terrains.
    """

    def ends(studies: Floats, worst: Floats | None) -> Floats:
        low, high = _with_the_unseen(studies, worst, unseen)
        at = np.full(len(studies), _AT_TAIL)
        lows = (
            _lowest(_Margins(low, terrains_drawn), at),
            _lowest(_Margins(-high, terrains_drawn), at),
        )
        return np.stack([lows[0], -lows[1]], -1)

    both = _by_participants(ends, table, worst, terrains_drawn, (2,))
    return both[..., 0], both[..., 1]


def p_value(
    table: Floats,
    worst: float | Floats | None,
    terrains_drawn: bool = True,
    unseen: float = UNSEEN,
) -> Floats:
    """The two-sided p that the mean is 0: below 0.05 if `interval` leaves 0 out.

    It is 0.05 or more exactly if `interval` holds 0. It is no lower than 2^-n for n participants,
    the chance that all are on one side of the mean.

    Args:
        table: of policy minus people, as in `interval`.
        worst: the policy's value minus the worst that a participant can have on a terrain.
        terrains_drawn: whether the test is for other terrains too.
        unseen: as in `interval`.
    """

    def p_values(studies: Floats, worst: Floats | None) -> Floats:
        p = 2 * _level_at_zero(_facing(studies, worst, terrains_drawn, unseen))
        return np.clip(p, 2.0 ** -studies.shape[1], 1.0)

    return _by_participants(p_values, table, worst, terrains_drawn, ())


def differs_from_zero(
    table: Floats, worst: float | Floats | None, terrains_drawn: bool = True
) -> NDArray[np.bool_]:
    """Whether `p_value` is below 0.05; faster, since it looks at this level alone.

    Args:
        table, worst, terrains_drawn: As in `p_value`.
    """

    def is_beyond(studies: Floats, worst: Floats | None) -> Floats:
        at = np.full(len(studies), _AT_TAIL)
        end = _lowest(_facing(studies, worst, terrains_drawn, UNSEEN), at)
        return np.where(end > 0, 1.0, 0.0)

    return np.asarray(_by_participants(is_beyond, table, worst, terrains_drawn, ()) == 1)


def _facing(studies: Floats, worst: Floats | None, terrains_drawn: bool, unseen: float) -> _Margins:
    """The margins of studies whose mean is above 0, and of the others mirrored at 0."""
    low, high = _with_the_unseen(studies, worst, unseen)
    is_above = _means(low) > 0
    return _Margins(np.where(is_above[:, None, None], low, -high), terrains_drawn)


def _by_participants(
    function: Callable[[Floats, Floats | None], Floats],
    table: Floats,
    worst: float | Floats | None,
    terrains_drawn: bool,
    shape: tuple[int, ...],
) -> Floats:
    """Apply a function to the studies of each number of participants.

    NaN if there are too few.
    """
    leading, (rows, columns) = table.shape[:-2], table.shape[-2:]
    studies = table.reshape(-1, rows, columns)
    is_row = np.asarray(~np.isnan(studies).all(-1))
    participants = is_row.sum(-1)
    limits = None
    if worst is not None:
        limits = np.broadcast_to(worst, (*leading, columns)).reshape(-1, columns)
    ends = np.full((len(studies), *shape), np.nan)
    if terrains_drawn and columns < FEWEST:
        return ends.reshape((*leading, *shape))
    for count in np.unique(participants[participants >= FEWEST]):
        has_count = participants == count
        order = np.argsort(~is_row[has_count], axis=-1, kind="stable")[:, :count, None]
        chosen = np.take_along_axis(studies[has_count], order, 1)
        ends[has_count] = function(chosen, None if limits is None else limits[has_count])
    return ends.reshape((*leading, *shape))


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
    """Means of participants and of terrains, with the weights of a study's mean."""

    def __init__(self, studies: Floats, terrains_drawn: bool) -> None:
        has_value = ~np.isnan(studies)
        values = np.where(has_value, studies, 0.0)
        count = studies.shape[1]
        cells = has_value / (count * has_value.sum(-1, keepdims=True))
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
        """The radius up to which no episode outweighs its share in its player's mean."""
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
    """The one-sided level at which each study's low end is 0.

    It is interpolated between the nearest of LEVELS. 0.5 if the mean is not above 0; the last level
    if the end is above 0 even there.
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
    if not high - low > 1e-9 * max(1.0, abs(mean)):
        return Estimate(mean, count, sd)
    lowest, highest = min(bounds[0], float(means.min())), max(bounds[1], float(means.max()))
    return Estimate(mean, count, sd, (max(low, lowest), min(high, highest)))


def _pair(ends: Ends) -> Interval:
    return float(ends[0]), float(ends[1])
