"""The spread of a study's table: variance components and the middle half.

A table is float64[players, terrains], NaN if not finished. The unit is the player; see
`humanplay.report.statistics.comparisons`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from humanplay.report.statistics.crossed import can_be_crossed, crossed_components
from humanplay.report.statistics.intervals import Interval, interval
from humanplay.report.statistics.likelihood import TAIL
from marsexplorer.intervals import FEWEST, Floats


@dataclass(frozen=True)
class VarianceComponents:
    """Crossed random effects: players, shared terrains, and the rest.

    Intervals are 95 %, for normal effects, with gaps by n0 and its like for terrains.

    Attributes:
        icc: Share of the variance that lies between players, ICC(2,1) of Shrout and Fleiss
            1979; below 0 where the means differ less than chance would.
        icc_interval: McGraw and Wong 1996 (Psychol. Methods 1(1), table 7).
        between_sd: Between players; 0 where the estimate of the variance is negative, as for
            the others.
        terrain_sd: Between terrains; their intervals: Williams 1962 (Biometrika 49(1/2)).
        rest_sd: Of an episode beside its player and its terrain; its interval by chi-squared.
        n0: Episodes a player, the mean that unequal numbers call for.
        design_effect: How many times too small the variance of the mean over these terrains
            comes out from pooled episodes; at least 1. Its interval: F with Satterthwaite's
            degrees of freedom.
    """

    icc: float
    icc_interval: Interval
    between_sd: float
    between_interval: Interval
    terrain_sd: float
    terrain_interval: Interval
    rest_sd: float
    rest_interval: Interval
    n0: float
    design_effect: float
    design_effect_interval: Interval
    players: int
    episodes: int


def variance_components(table: Floats) -> VarianceComponents | None:
    """The variance components of a table.

    Terrains that nobody finished are left out.

    Returns:
        None without a spread, or if players and terrains cannot be told apart: that needs at least
            two players, two terrains, and more values than either.
    """
    table = table[:, ~np.isnan(table).all(axis=0)]
    if not can_be_crossed(table):
        return None
    components = crossed_components(table)
    player, terrain, rest = (
        float(components.player),
        float(components.terrain),
        float(components.rest),
    )
    total = player + terrain + rest
    if not total > 0:
        return None
    has_value = ~np.isnan(table)
    n0, p0 = (_mean_count(has_value.sum(axis)) for axis in (1, 0))
    rest_freedom = (p0 - 1) * (n0 - 1)
    return VarianceComponents(
        icc=player / total,
        icc_interval=_icc_ends(player, terrain, rest, n0, p0),
        between_sd=_sd(player),
        between_interval=_sd_ends(player, rest, n0, p0 - 1, rest_freedom),
        terrain_sd=_sd(terrain),
        terrain_interval=_sd_ends(terrain, rest, p0, n0 - 1, rest_freedom),
        rest_sd=_sd(rest),
        rest_interval=_sd_ends(rest, 0.0, 1.0, rest_freedom, rest_freedom),
        n0=n0,
        design_effect=max(1.0, (n0 * player + rest) / total),
        design_effect_interval=_effect_ends(player, terrain, rest, n0, p0),
        players=len(table),
        episodes=int(has_value.sum()),
    )


def _sd(variance: float) -> float:
    return float(np.sqrt(max(0.0, variance)))


def _mean_count(counts: NDArray[np.int64]) -> float:
    """The mean that unequal numbers of values call for; the plain mean if equal."""
    total = counts.sum()
    return float((total - (counts**2).sum() / total) / (len(counts) - 1))


def _sd_ends(
    variance: float, rest: float, count: float, freedom: float, rest_freedom: float
) -> Interval:
    """The ends of the 95 % interval of a component's standard deviation.

    Args:
        count: Values behind a mean of the component, so that its mean square is rest + count *
            variance.
        freedom: The degrees of freedom of that mean square.
        rest_freedom: Those of the rest's.
    """
    square, ends = rest + count * variance, []
    for share in (1 - TAIL, TAIL):
        ratio = scipy.special.fdtri(freedom, rest_freedom, share)
        spread = scipy.special.chdtri(freedom, 1 - share) / freedom
        ends.append(_sd(float((square - ratio * rest) / (count * spread))))
    return ends[0], ends[1]


def _effect_ends(player: float, terrain: float, rest: float, n0: float, p0: float) -> Interval:
    """The ends of the 95 % interval of the design effect.

    It is 1 / (1/n0 + the other mean squares over the players').
    """
    of_players = rest + n0 * player
    parts = (rest + p0 * terrain) / p0, (1 - 1 / n0 - 1 / p0) * rest
    doubt = parts[0] ** 2 / (n0 - 1) + parts[1] ** 2 / ((p0 - 1) * (n0 - 1))
    if not of_players > 0 or not doubt > 0:
        effect = n0 if of_players > 0 else 1.0
        return effect, effect
    freedom = sum(parts) ** 2 / doubt
    quantiles = scipy.special.fdtri([freedom, p0 - 1], [p0 - 1, freedom], 1 - TAIL)
    ratio = sum(parts) / of_players
    low, high = 1 / (1 / n0 + np.array([ratio * quantiles[1], ratio / quantiles[0]]))
    return max(1.0, float(low)), max(1.0, float(high))


def _icc_ends(player: float, terrain: float, rest: float, n0: float, p0: float) -> Interval:
    """The ends of the ICC's 95 % interval, through the components' mean squares."""
    of_players, of_terrains = rest + n0 * player, rest + p0 * terrain
    icc = player / (player + terrain + rest)
    if icc >= 1:
        return 1.0, 1.0
    odds = n0 * icc / (p0 * (1 - icc))
    parts = odds * of_terrains, (1 + (p0 - 1) * odds) * rest
    doubt = parts[0] ** 2 / (n0 - 1) + parts[1] ** 2 / ((p0 - 1) * (n0 - 1))
    freedom = max(sum(parts) ** 2 / doubt, 1.0) if doubt > 0 else 1.0
    below = n0 * of_terrains + (n0 * p0 - n0 - p0) * rest
    near, far = scipy.special.fdtri([p0 - 1, freedom], [freedom, p0 - 1], 1 - TAIL)
    low = p0 * (of_players - near * rest) / (near * below + p0 * of_players)
    high = p0 * (far * of_players - rest) / (below + p0 * far * of_players)
    return float(low), float(high)


def iqm(table: Floats) -> float:
    """The interquartile mean over all episodes (Agarwal et al. 2021)."""
    return float(scipy.stats.trim_mean(table[~np.isnan(table)], 1 / 4))


def iqm_interval(table: Floats) -> Interval | None:
    """The 95 % interval of the IQM for other participants on these terrains.

    The variance of a trimmed mean is that of the values drawn in to its ends (Tukey and McLaughlin
    1963, Sankhya A 25(3)), here with whole participants as the independent units.

    Returns:
        None below five participants.
    """
    if len(table) < FEWEST:
        return None
    low, high = interval(iqm_shares(table)[:, None], None, terrains_drawn=False)
    return float(low), float(high)


def iqm_shares(table: Floats) -> Floats:
    """Values whose mean is the IQM, and whose spread is that of the IQM over players.

    Args:
        table: float64[..., players, terrains]; leading axes are studies.
    """
    has_value = ~np.isnan(table)
    flat = np.sort(table.reshape(*table.shape[:-2], -1), axis=-1)  # NaN last
    counts = has_value.sum((-2, -1))[..., None]
    cut = counts // 4
    places = np.arange(flat.shape[-1])
    is_middle = (places >= cut) & (places < counts - cut)
    middle = np.where(is_middle, flat, 0.0).sum(-1) / (counts - 2 * cut)[..., 0]
    ends = (np.take_along_axis(flat, place, -1)[..., None] for place in (cut, counts - cut - 1))
    drawn_in = np.where(has_value, np.clip(table, *ends), 0.0)
    mean = drawn_in.sum((-2, -1)) / counts[..., 0]
    away = np.where(has_value, drawn_in - mean[..., None, None], 0.0).sum(-1)
    shares: Floats = middle[..., None] + 2 * table.shape[-2] / counts * away
    return shares
