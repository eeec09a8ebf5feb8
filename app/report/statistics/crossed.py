"""The mean over players and terrains that were both drawn at random: variance components, its test and its interval.

Tables are float64[..., players, terrains] of one metric, NaN where a player did not finish a terrain; leading axes are studies.
The figure is the mean of the players' means. Its variance comes from the crossed random-effects model
value = mean + player + terrain + rest, by the analysis of variance: without gaps it is (MS_P + MS_T - MS_E) / (PT). Tables
with gaps take moment estimates from three sums of squares (Gao and Owen 2017, Electron. J. Statist. 11(1), after Henderson's
method 1), which are the same where there are none. Degrees of freedom are Satterthwaite's (1946, Biometrics Bull. 2(6)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from app.report.statistics.intervals import Ends, printed_interval, printed_p
from marsexplorer.intervals import CONFIDENCE, Floats


@dataclass(frozen=True)
class CrossedComponents:
    """Variances between players, between terrains and of the rest, float64[...]; an estimate may be below 0."""

    player: Floats
    terrain: Floats
    rest: Floats


@dataclass(frozen=True)
class CrossedMean:
    """The mean of the players' means, its standard error and the degrees of freedom of that, float64[...]."""

    mean: Floats
    error: Floats
    freedom: Floats


def can_be_crossed(table: Floats) -> bool:
    """Return whether float64[players, terrains] has enough values for `crossed_mean`: two players and two terrains at least, a
    value in every row and column, and more values than either."""
    known = ~np.isnan(table)
    has_each = known.any(0).all() and known.any(1).all()
    return bool(min(table.shape) > 1 and has_each and known.sum() > max(table.shape))


def crossed_components(table: Floats) -> CrossedComponents:
    """Return the variance components of tables with two players and two terrains at least, and a value in every row and column.

    The three sums of squares within players, within terrains and over all are set equal to their expectations. A table without
    a player and a terrain that two values share has no estimate of its own for the rest: NaN.
    """
    known = ~np.isnan(table)
    values = np.where(known, table, 0.0)
    total = known.sum((-2, -1)).astype(np.float64)
    middle = (values.sum((-2, -1)) / total)[..., None, None]
    values = np.where(known, values - middle, 0.0)  # sums of squares near 0 stay exact
    rows, columns = known.sum(-1).astype(np.float64), known.sum(-2).astype(np.float64)
    squares = (values**2).sum((-2, -1))
    in_players = squares - (values.sum(-1) ** 2 / rows).sum(-1)
    in_terrains = squares - (values.sum(-2) ** 2 / columns).sum(-1)
    over_all = squares - values.sum((-2, -1)) ** 2 / total
    # E in_players = (terrain + rest)(N - P); E in_terrains = (player + rest)(N - T);
    # E over_all = player (N - sum n_p^2 / N) + terrain (N - sum n_t^2 / N) + rest (N - 1)
    of_player, of_terrain = total - (rows**2).sum(-1) / total, total - (columns**2).sum(-1) / total
    players, terrains = table.shape[-2:]
    without_player = in_players / (total - players)
    without_terrain = in_terrains / (total - terrains)
    left = of_player * without_terrain + of_terrain * without_player - over_all
    share = of_player + of_terrain - (total - 1)
    rest = np.divide(left, share, out=np.full_like(left, np.nan), where=share > 1e-9 * total)
    return CrossedComponents(without_terrain - rest, without_player - rest, rest)


def crossed_mean(table: Floats) -> CrossedMean:
    """Return the mean over players and terrains with its standard error.

    The variance is V_P + V_T - V_E, where V_P leaves terrains out as a source, V_T players, V_E both. V_E is taken no larger
    than the smaller of the two others, so that the variance never falls below the larger of them: the estimate of a variance
    component below 0 counts as 0.
    """
    known = ~np.isnan(table)
    rows = known.sum(-1)
    means = np.nanmean(table, -1)
    weights = np.where(known, 1 / (table.shape[-2] * rows[..., None]), 0.0)
    found = crossed_components(table)
    each = np.maximum(found.rest, 0) * (weights**2).sum((-2, -1))
    of_players = np.maximum(found.player * (weights.sum(-1) ** 2).sum(-1) + each, 0)
    of_terrains = np.maximum(found.terrain * (weights.sum(-2) ** 2).sum(-1) + each, 0)
    of_both = np.minimum(each, np.minimum(of_players, of_terrains))
    error = np.sqrt(of_players + of_terrains - of_both)
    freedom = satterthwaite(of_players, of_terrains, of_both, known)
    return CrossedMean(means.mean(-1), error, freedom)


def satterthwaite(
    of_players: Floats, of_terrains: Floats, of_both: Floats, known: NDArray[np.bool_]
) -> Floats:
    """Return the degrees of freedom of the variance of_players + of_terrains - of_both (see `crossed_mean`).

    known  bool[..., players, terrains]: where there are values
    """
    variance = np.asarray(of_players + of_terrains - of_both)
    players, terrains = known.shape[-2] - 1, known.shape[-1] - 1
    both = np.maximum(known.sum((-2, -1)) - players - terrains - 1, 1)
    doubt = np.asarray(of_players**2 / players + of_terrains**2 / terrains + of_both**2 / both)
    without = np.full_like(variance, float(players))
    return np.asarray(np.divide(variance**2, doubt, out=without, where=doubt > 0))


def crossed_p(table: Floats) -> Floats:
    """Return the two-sided p that the mean over players and terrains is 0: below 1 - C exactly where `crossed_interval` at
    confidence C leaves 0 out."""
    found = crossed_mean(table)
    beyond = np.where(found.mean == 0, 0.0, np.inf)
    ratio = np.divide(np.abs(found.mean), found.error, out=beyond, where=found.error > 0)
    p = 2 * scipy.special.stdtr(found.freedom, -ratio)
    larger: Floats = np.maximum(p, printed_p(np.nanmean(table, -1)))
    return larger


def crossed_interval(table: Floats, confidence: float = CONFIDENCE) -> Ends:
    """Return low and high of the mean over players and terrains; never narrower than the interval for these terrains."""
    found = crossed_mean(table)
    half = scipy.special.stdtrit(found.freedom, (1 + confidence) / 2) * found.error
    low, high = printed_interval(np.nanmean(table, -1), confidence)
    return np.minimum(found.mean - half, low), np.maximum(found.mean + half, high)
