"""Which interval is a study's headline: the printed one, or the guaranteed one where failures are a few players'.

A failure is a ranked episode that ends short of 99 %: it costs far more than players differ otherwise. Where nearly all
failures are a few players', the sample's spread depends on how many of these players it happens to hold, and every interval
made from that spread misses too often. The rule, fixed before any data, then makes the guaranteed interval the headline. It
looks at the failures alone, never at the figure. No rule can see a kind of player who is not in the sample: `research.coverage`
measures how often the headline misses (docs/report.md).
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from app.report.statistics.intervals import RULE
from marsexplorer.intervals import Floats

FEW_PLAYERS = 5
"""Fewer players than this, by the effective number, are a few."""
CHANCE = 0.05
"""Level of the test that all players fail alike."""
HEADLINE_RULE = (
    f"{RULE}; where failures are a few players', the guaranteed interval is the headline instead. They are when one "
    "player alone has all of them, or when their numbers differ between players more than chance lets them (chi-squared test "
    f"of equal rates, p < {CHANCE:g}) and fewer than {FEW_PLAYERS} players hold them (effective number: squared sum over sum "
    "of squares)"
)


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
