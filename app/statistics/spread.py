"""The spread of a study's table float64[players, terrains], NaN where not finished: variance components and the middle half.

The unit is the player; see `app.statistics.comparisons`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from app.statistics.intervals import TAIL, Interval
from marsexplorer.evaluation.intervals import Floats

CROSSED_RESAMPLES = 2000
MAX_RESAMPLED_VALUES = 4_000_000
"""Values of resampled tables held at a time."""


@dataclass(frozen=True)
class VarianceComponents:
    """One-way random effects: players the groups, their episodes the replicates (ANOVA estimator).

    icc            share of the variance that lies between players; below 0 where the means differ less than chance would
    icc_interval   95 %, exact for equal numbers of episodes and normal values (Searle 1971)
    between_sd     0 where the estimate of the variance is negative
    n0             episodes a player, the mean that unequal numbers call for
    design_effect  1 + (n0 - 1) icc, at least 1: how many times too small the variance from pooled episodes is
    effective      episodes / design_effect
    """

    icc: float
    icc_interval: Interval
    between_sd: float
    within_sd: float
    n0: float
    design_effect: float
    players: int
    episodes: int
    effective: float


def variance_components(table: Floats) -> VarianceComponents | None:
    """Return the variance components; None without two players, or without a spread or two episodes within players."""
    groups = [row[~np.isnan(row)] for row in table]
    sizes = np.array([len(group) for group in groups], np.float64)
    k, total = len(groups), sizes.sum()
    if k < 2 or total <= k:
        return None
    means = np.array([group.mean() for group in groups])
    grand = float((sizes * means).sum() / total)
    between = float((sizes * (means - grand) ** 2).sum() / (k - 1))
    within = float(sum(((group - group.mean()) ** 2).sum() for group in groups) / (total - k))
    n0 = float((total - (sizes**2).sum() / total) / (k - 1))
    if between + (n0 - 1) * within <= 0:
        return None
    icc = (between - within) / (between + (n0 - 1) * within)
    effect = max(1.0, 1 + (n0 - 1) * icc)
    spread = float(np.sqrt(max(0.0, (between - within) / n0)))
    ends = _icc_ends(between, within, n0, k, int(total)) if within > 0 else (1.0, 1.0)
    return VarianceComponents(
        icc=icc,
        icc_interval=ends,
        between_sd=spread,
        within_sd=float(np.sqrt(within)),
        n0=n0,
        design_effect=effect,
        players=k,
        episodes=int(total),
        effective=total / effect,
    )


def _icc_ends(between: float, within: float, n0: float, players: int, episodes: int) -> Interval:
    ratio = between / within
    freedom = players - 1, episodes - players
    low, high = ratio / stats.f.ppf([1 - TAIL, TAIL], *freedom)
    return float((low - 1) / (low + n0 - 1)), float((high - 1) / (high + n0 - 1))


def iqm(table: Floats) -> float:
    """Return the interquartile mean over all episodes: the mean of the middle half (Agarwal et al. 2021)."""
    return float(stats.trim_mean(table[~np.isnan(table)], 0.25))


def iqm_interval(table: Floats, resamples: int = CROSSED_RESAMPLES) -> Interval:
    """Return the 95 % percentile interval of the IQM over resamples of whole players."""
    rng = np.random.default_rng(len(table))
    picks = rng.integers(0, len(table), (resamples, len(table)))
    stack = max(1, MAX_RESAMPLED_VALUES // table.size)
    middles = [_iqms(table[picks[at : at + stack]]) for at in range(0, resamples, stack)]
    low, high = np.quantile(np.concatenate(middles), [TAIL, 1 - TAIL])
    return float(low), float(high)


def _iqms(drawn: Floats) -> Floats:
    """Return the IQM of each table in float64[tables, players, terrains]."""
    flat = np.sort(drawn.reshape(len(drawn), -1), axis=1)  # NaN last
    counts = (~np.isnan(flat)).sum(1)
    cut = (0.25 * counts).astype(np.int64)
    sums = np.concatenate([np.zeros((len(flat), 1)), np.cumsum(np.nan_to_num(flat), axis=1)], axis=1)
    rows = np.arange(len(flat))
    middles: Floats = (sums[rows, counts - cut] - sums[rows, cut]) / (counts - 2 * cut)
    return middles
