"""Variance components of participants and terrains that were both drawn at random.

Tables are float64[..., participants, terrains] of one metric, NaN where a participant did not
finish a terrain; leading axes are studies. The crossed random-effects model is value = mean +
participant + terrain + rest. Its components come from the analysis of variance, with gaps from
three sums of squares (Gao and Owen 2017, Electron. J. Statist. 11(1), after Henderson's method 1),
which are the same where there are none.
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

    Two participants and two terrains at least, a value in every row and column, and more values
    than either.
    """
    has_value = ~np.isnan(table)
    has_each = has_value.any(0).all() and has_value.any(1).all()
    return bool(min(table.shape) > 1 and has_each and has_value.sum() > max(table.shape))


def crossed_components(table: Floats) -> CrossedComponents:
    """The variance components of tables.

    The three sums of squares within players, within terrains and over all are set equal to their
    expectations. A table without a player and a terrain that two values share has no estimate of
    its own for the rest: NaN.

    Args:
        table: float64[..., players, terrains], at least two of each, NaN for a gap, and a value in
            every row and column.
    """
    has_value = ~np.isnan(table)
    values = np.where(has_value, table, 0.0)
    total = has_value.sum((-2, -1)).astype(np.float64)
    middle = (values.sum((-2, -1)) / total)[..., None, None]
    values = np.where(has_value, values - middle, 0.0)  # sums of squares near 0 stay exact
    rows, columns = has_value.sum(-1).astype(np.float64), has_value.sum(-2).astype(np.float64)
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
