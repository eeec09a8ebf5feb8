"""Variance components of players and terrains, both drawn at random.

The crossed random-effects model is value = mean + player + terrain + rest. Its components are
estimated from three sums of squares (Gao and Owen 2017, Electron. J. Statist. 11(1), after
Henderson's method 1). Without gaps, these are the estimates of the analysis of variance.

A table is float64[..., players, terrains] of one metric, NaN where a player did not finish a
terrain; leading axes are studies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marsexplorer.intervals import Floats


@dataclass(frozen=True)
class CrossedComponents:
    """Variances between players, between terrains and of the rest, float64[...].

    An estimate may be below 0.
    """

    player: Floats
    terrain: Floats
    rest: Floats


def can_be_crossed(table: Floats) -> bool:
    """Whether a table has enough values for `crossed_components`.

    Two players and two terrains at least, a value in every row and column, and more values
    than either.
    """
    has_value = ~np.isnan(table)
    fills_axes = has_value.any(0).all() and has_value.any(1).all()
    return bool(min(table.shape) > 1 and fills_axes and has_value.sum() > max(table.shape))


def crossed_components(table: Floats) -> CrossedComponents:
    """The variance components of tables.

    The sums of squares within players, within terrains and over all are set equal to their
    expectations. All components are NaN if every two values share a player or a terrain.

    Args:
        table: float64[..., players, terrains], at least two of each, NaN for a gap, and a value in
            every row and column.
    """
    players, terrains = table.shape[-2:]
    has_value = ~np.isnan(table)
    count = has_value.sum((-2, -1)).astype(np.float64)
    per_player = has_value.sum(-1).astype(np.float64)
    per_terrain = has_value.sum(-2).astype(np.float64)

    # 1. values around the table's mean, so that sums of squares near 0 stay exact; 0 in gaps
    values = np.where(has_value, table, 0.0)
    mean = (values.sum((-2, -1)) / count)[..., None, None]
    values = np.where(has_value, values - mean, 0.0)

    # 2. the three sums of squares
    squares = (values**2).sum((-2, -1))
    in_players = squares - (values.sum(-1) ** 2 / per_player).sum(-1)
    in_terrains = squares - (values.sum(-2) ** 2 / per_terrain).sum(-1)
    over_all = squares - values.sum((-2, -1)) ** 2 / count

    # 3. their expectations, with N = count, P = players, T = terrains, n_p = per_player and
    # n_t = per_terrain:
    # E in_players = (terrain + rest)(N - P); E in_terrains = (player + rest)(N - T);
    # E over_all = player (N - sum n_p^2 / N) + terrain (N - sum n_t^2 / N) + rest (N - 1)
    terrain_and_rest = in_players / (count - players)
    player_and_rest = in_terrains / (count - terrains)
    player_weight = count - (per_player**2).sum(-1) / count
    terrain_weight = count - (per_terrain**2).sum(-1) / count

    # 4. the third equation, solved for the rest
    numerator = player_weight * player_and_rest + terrain_weight * terrain_and_rest - over_all
    denominator = player_weight + terrain_weight - (count - 1)
    # the denominator counts the pairs of values that share neither, over N: 0 without such a pair
    has_rest = denominator > 1e-9 * count
    rest = np.divide(numerator, denominator, out=np.full_like(numerator, np.nan), where=has_rest)
    return CrossedComponents(player_and_rest - rest, terrain_and_rest - rest, rest)
