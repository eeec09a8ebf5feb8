"""The statistics of a study apart from its primary interval: variance components, new terrains, comparisons.

A study is a table float64[players, terrains] of one metric, NaN where a player did not finish a terrain. The unit is the
player: the figure is the mean of the players' means, never of pooled episodes. Draws depend on the table's shape alone, so a
report comes out the same twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import stats

from app.statistics.intervals import TAIL, Interval, printed_interval
from marsexplorer.evaluation.intervals import Floats, t_quantile

CROSSED_RESAMPLES = 2000
PERMUTATIONS = 9999
MAX_RESAMPLED_VALUES = 4_000_000
"""Values of resampled tables held at a time."""


def player_means(table: Floats) -> Floats:
    """Return each player's mean: float64[players] from a table in which every player has at least one value."""
    return np.asarray(np.nanmean(table, axis=1))


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


@lru_cache(maxsize=16)
def _draws(players: int, terrains: int, resamples: int) -> tuple[Floats, Floats]:
    """Return how often each player and each terrain is drawn: float64[resamples, players] and [resamples, terrains]."""
    rng = np.random.default_rng([players, terrains])
    rows, cols = (rng.multinomial(n, np.full(n, 1 / n), size=resamples).astype(np.float64) for n in (players, terrains))
    return rows, cols


def crossed_means(table: Floats, resamples: int = CROSSED_RESAMPLES) -> Floats:
    """Return means of tables whose players and terrains were both drawn anew: float64[resamples].

    Owen 2007, "The pigeonhole bootstrap", Ann. Appl. Statist. 1(2). A drawn player without a drawn terrain is left out.
    """
    rows, cols = _draws(*table.shape, resamples)
    known = ~np.isnan(table)
    # not @: BLAS would start threads for so little, and they spin where the cores are busy
    counts = np.einsum("pt,rt->pr", known.astype(np.float64), cols)
    sums = np.einsum("pt,rt->pr", np.where(known, table, 0.0), cols)
    there = counts > 0
    means = np.where(there, sums / np.where(there, counts, 1), 0.0)
    weights = np.where(there, rows.T, 0.0)
    total: Floats = (means * weights).sum(0) / weights.sum(0)
    return total


def drawn_terrains(values: Floats, players: int, resamples: int = CROSSED_RESAMPLES) -> Floats:
    """Return the mean of a policy's values float64[terrains] over the terrains that `crossed_means` draws for `players`."""
    cols = _draws(players, len(values), resamples)[1]
    mean: Floats = cols @ values / len(values)
    return mean


def new_terrains_interval(table: Floats) -> Interval:
    """Return the 95 % interval of the mean over players and terrains alike: the crossed bootstrap's standard error times t.

    Its percentiles are too narrow for few players; t with min(players, terrains) - 1 degrees of freedom holds. It never
    reaches less far than the interval for these terrains. At least two players and two terrains.
    """
    means = player_means(table)
    half = _quantile(table) * float(crossed_means(table).std(ddof=1))
    low, high = printed_interval(means)
    mean = float(means.mean())
    return min(mean - half, float(low)), max(mean + half, float(high))


def _quantile(table: Floats) -> float:
    """Return the t quantile with min(players, terrains) - 1 degrees of freedom."""
    return t_quantile(min(table.shape) - 1)


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


@dataclass(frozen=True)
class PolicyComparison:
    """A policy compared with the people on the same terrains, in one metric. Intervals are 95 %.

    mean                   of the policy over the terrains
    difference             policy - people; `these` covers other players, `new` other players and other terrains
    p_value                sign-flip permutation test over terrains of the paired differences; p_adjusted by Holm's method
    ratio                  policy / people (the 85.8 % of the paper is this figure), over players and terrains
    normalized             (policy - random) / (people - random), over players and terrains; None for `random` and without it
    better                 terrains on which the policy scores better than the people's mean does
    """

    policy: str
    metric: str
    mean: float
    terrains: int
    difference: float
    these: Interval | None
    new: Interval | None
    p_value: float | None
    p_adjusted: float | None
    ratio: float | None
    ratio_interval: Interval | None
    normalized: float | None
    normalized_interval: Interval | None
    better: int


def compare_policy(
    policy: str, metric: str, values: Floats, table: Floats, random: Floats | None = None, up: bool = True
) -> PolicyComparison:
    """Return the comparison of a policy's values float64[terrains] with the players' table float64[players, terrains].

    random  of the policy `random` on the same terrains, None where it was not played; up: more is better
    """
    means = player_means(table)
    people = float(means.mean())
    mean = float(values.mean())
    paired = values - np.nanmean(table, axis=0)
    several = len(table) > 1 and table.shape[1] > 1
    low, high = printed_interval(means) if len(table) > 1 else (None, None)
    these = (mean - float(high), mean - float(low)) if low is not None and high is not None else None
    drawn, drawn_people = drawn_terrains(values, len(table)), crossed_means(table)
    half = _quantile(table) * float((drawn - drawn_people).std(ddof=1)) if several else 0.0
    difference = mean - people
    new = (min(difference - half, these[0]), max(difference + half, these[1])) if several and these else None
    ratio = mean / people if people > 0 else None
    normalized, normalized_interval = _normalized(values, random if policy != "random" else None, table, several)
    return PolicyComparison(
        policy=policy,
        metric=metric,
        mean=mean,
        terrains=len(values),
        difference=difference,
        these=these,
        new=new,
        p_value=permutation_p(paired),
        p_adjusted=None,
        ratio=ratio,
        ratio_interval=log_interval(drawn, drawn_people, ratio, table) if several else None,
        normalized=normalized,
        normalized_interval=normalized_interval,
        better=int((paired > 0).sum() if up else (paired < 0).sum()),
    )


def log_interval(top: Floats, bottom: Floats, ratio: float | None, table: Floats) -> Interval | None:
    """Return the interval of a ratio policy / people over players and terrains.

    The t interval of log(top / bottom) brought back, never nearer than the people's printed interval allows. None where a mean
    or an end is not positive.

    top, bottom  the policy's and the people's means in the same resamples; ratio: policy / people, None when there is none
    """
    people = player_means(table)
    low, high = (float(end) for end in printed_interval(people))
    if ratio is None or ratio <= 0 or low <= 0 or (top <= 0).any() or (bottom <= 0).any():
        return None
    half = _quantile(table) * float(np.log(top / bottom).std(ddof=1))
    policy = ratio * float(people.mean())
    return min(float(ratio * np.exp(-half)), policy / high), max(float(ratio * np.exp(half)), policy / low)


def _normalized(values: Floats, random: Floats | None, table: Floats, several: bool) -> tuple[float | None, Interval | None]:
    """Return (policy - random) / (people - random) and its interval, by the same rule as the ratio's."""
    if random is None:
        return None, None
    means = player_means(table)
    zero, difference = float(random.mean()), float(values.mean() - random.mean())
    if means.mean() == zero:
        return None, None
    share = difference / (float(means.mean()) - zero)
    if not several:
        return share, None
    zeros = drawn_terrains(random, len(table))
    gaps, ends = crossed_means(table) - zeros, np.array(printed_interval(means)) - zero
    if len({*np.sign(gaps), *np.sign(ends)}) > 1:  # people may be no better than random: the share has no bounds
        return share, None
    half = _quantile(table) * float(((drawn_terrains(values, len(table)) - zeros) / gaps).std(ddof=1))
    outer = sorted((difference / float(ends[0]), difference / float(ends[1])))
    return share, (min(share - half, outer[0]), max(share + half, outer[1]))


def permutation_p(differences: Floats) -> float | None:
    """Return the two-sided p of the sign-flip test that paired differences float64[n] centre on 0; None below two."""
    if len(differences) < 2:
        return None
    if not differences.any():
        return 1.0
    test = stats.permutation_test(
        (differences,),
        lambda flipped, axis: flipped.mean(axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=PERMUTATIONS,
        rng=np.random.default_rng(len(differences)),
    )
    return float(test.pvalue)


def holm(p_values: list[float]) -> list[float]:
    """Return p values adjusted for their number by Holm's step-down method, in the order given."""
    order = np.argsort(p_values, kind="stable")
    adjusted, worst = [0.0] * len(p_values), 0.0
    for rank, at in enumerate(order):
        worst = max(worst, min(1.0, (len(p_values) - rank) * p_values[at]))
        adjusted[at] = worst
    return adjusted
