"""How many players a study needs: from the spread of players and episodes to the half-width of the interval for the mean.

A player's mean over m ranked episodes has the variance player_sd^2 + episode_sd^2 / m, so more episodes cannot make up for few
players. The t interval's half-width is itself random; `expected` is its mean for normal player means, `assured` is not exceeded
in the share of studies asked for. Skewed scores widen the printed interval beyond t (research/coverage/README.md: column "width
/ t").
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from app.report.statistics.exclusion_sets import members, people_of
from app.report.statistics.spread import variance_components
from app.series.data import StudyData
from marsexplorer.evaluation.intervals import Floats, t_quantile

MAX_PLAYERS = 2000
"""Players beyond which no study is planned here."""
LISTED_PLAYERS = (5, 8, 10, 15, 20, 30, 50, 100)


@dataclass(frozen=True)
class Width:
    """Half-widths of the 95 % t interval with so many players, in the metric's unit."""

    players: int
    expected: float
    assured: float


@dataclass(frozen=True)
class SampleSizePlan:
    """How many players reach a half-width.

    players   fewest whose expected half-width is at most the wanted one; None when MAX_PLAYERS are too few
    assured   fewest who reach it in the share `assurance` of studies; None likewise
    mean_sd   standard deviation of a player's mean over `ranked` episodes
    table     half-widths for some numbers of players, the two above among them
    """

    mean_sd: float
    players: int | None
    assured: int | None
    table: tuple[Width, ...]


def plan_sample_size(
    player_sd: float, episode_sd: float, half_width: float, ranked: int = 30, assurance: float = 0.8
) -> SampleSizePlan:
    """Return how many players give a 95 % interval of the mean whose half-width is at most `half_width`.

    player_sd   standard deviation between players' true means, in the metric's unit (score or steps)
    episode_sd  standard deviation of an episode around its player's mean
    ranked      episodes a player; assurance: share of studies, in (0, 1), in which the width is to be reached

    ValueError for a spread or width that cannot be.
    """
    if player_sd < 0 or episode_sd < 0 or not player_sd + episode_sd > 0:
        given = f"{player_sd} and {episode_sd}"
        raise ValueError(f"the SDs must be at least 0, and one above 0; got {given}")
    if not half_width > 0:
        raise ValueError(f"the half-width must be above 0, got {half_width}")
    if ranked < 1 or not 0 < assurance < 1:
        given = f"{ranked} and {assurance}"
        raise ValueError(f"ranked must be at least 1 and assurance in (0, 1), got {given}")
    spread = float(np.sqrt(player_sd**2 + episode_sd**2 / ranked))
    widths = _widths(spread, assurance)
    players = next((width.players for width in widths if width.expected <= half_width), None)
    assured = next((width.players for width in widths if width.assured <= half_width), None)
    shown = sorted({*LISTED_PLAYERS, *(count for count in (players, assured) if count is not None)})
    return SampleSizePlan(spread, players, assured, tuple(widths[count - 2] for count in shown))


def _widths(spread: float, assurance: float) -> list[Width]:
    """Return the half-widths for 2, 3, ... MAX_PLAYERS players."""
    players = np.arange(2, MAX_PLAYERS + 1)
    freedom = players - 1
    unit = _t_quantiles() * spread / np.sqrt(players)
    log_ratio = scipy.special.gammaln(players / 2) - scipy.special.gammaln(freedom / 2)
    mean_sd = np.sqrt(2 / freedom) * np.exp(log_ratio)  # of the sample SD, for SD 1
    assured = unit * np.sqrt(chi_squared_quantile(assurance, freedom) / freedom)
    columns = players.tolist(), (unit * mean_sd).tolist(), assured.tolist()
    return [Width(*row) for row in zip(*columns, strict=True)]


def chi_squared_quantile(probability: float | Floats, freedom: int | NDArray[np.int64]) -> Floats:
    """Return what a chi-squared variable with `freedom` degrees of freedom stays below with this probability (0..1)."""
    quantile: Floats = 2 * scipy.special.gammaincinv(freedom / 2, probability)
    return quantile


@cache
def _t_quantiles() -> Floats:
    """Return the t quantiles for 2, 3, ... MAX_PLAYERS players."""
    return np.array([t_quantile(freedom) for freedom in range(1, MAX_PLAYERS)])


def spread_of(data: StudyData, metric: Literal["score", "steps"] = "score") -> tuple[float, float]:
    """Return (player SD, episode SD) of the people of a study; ValueError when they are too few to estimate them.

    The episode SD leaves out what a terrain adds to everybody's episodes, since it adds nothing between players.
    """
    why = "shows no figure until it is closed"
    found = None
    if data.closed_ms is not None:
        why = "has too few players with a spread to plan from"
        cohort = people_of(data)
        ids = members(cohort, {})
        found = variance_components(cohort.table(ids, metric)) if ids else None
    if found is None:
        raise ValueError(f"the study {data.protocol.name!r} {why}: give the SDs instead")
    return found.between_sd, found.rest_sd
