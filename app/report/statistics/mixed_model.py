"""The linear mixed model of a study, its second analysis: players and terrains crossed, the trial as a covariate.

value = mean + slope trial + player + terrain + rest, all three random and normal, fitted by restricted maximum likelihood
through statsmodels (Lindstrom and Bates 1988, J. Am. Stat. Assoc. 83(404)). It stands beside the interval that the design
alone justifies, which assumes no shape. It adds the slope of learning by all episodes at once, and how difficult each terrain
was. Its mean is over players and terrains that are both drawn, as *new terrains too*. statsmodels is loaded where it is needed:
that takes a second.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from app.report.statistics.crossed import can_be_crossed, crossed_components, satterthwaite
from app.report.statistics.intervals import TAIL, Interval
from marsexplorer.intervals import Floats, t_quantile

Indices = NDArray[np.intp]

FEWEST = 3
"""Players, and terrains, below which no variance between them is fitted."""
SMALLEST_START, LARGEST_START = 0.05, 100.0
"""Of a variance over that of the rest, where the search begins: at 0 it would stay."""
NO_VARIANCE = 1e-5
"""Over that of the rest: so small a variance counts as none."""


@dataclass(frozen=True)
class TerrainDifficulty:
    """What a terrain adds to everybody's value beside the mean (best linear unbiased prediction), with its 95 % interval.

    terrain  its index among the ranked ones, 0..
    """

    terrain: int
    effect: float
    interval: Interval


@dataclass(frozen=True)
class MixedModel:
    """The fitted model of one metric; where there is no fit, `note` says why and every figure is None.

    mean            at the mean trial, for other players and terrains; interval: t with Satterthwaite's degrees of freedom
    slope           change a trial; interval: t with the degrees of freedom of the rest. All players share one slope
    player_sd, terrain_sd, rest_sd   standard deviations, in the metric's unit
    terrains        the difficulty of each terrain
    note            how the fit went, a sentence
    """

    metric: str
    note: str
    converged: bool = False
    mean: float | None = None
    interval: Interval | None = None
    slope: float | None = None
    slope_interval: Interval | None = None
    player_sd: float | None = None
    terrain_sd: float | None = None
    rest_sd: float | None = None
    terrains: tuple[TerrainDifficulty, ...] = ()


def fit_mixed_model(metric: str, table: Floats, trials: Floats) -> MixedModel:
    """Return the mixed model of a metric.

    table   float64[players, terrains], NaN where not finished
    trials  in which trial (0..) each value was made, float64[players, terrains], with the same gaps
    """
    columns = np.flatnonzero(~np.isnan(table).all(axis=0))
    table, trials = table[:, columns], trials[:, columns]
    if min(table.shape) < FEWEST or not can_be_crossed(table):
        least = f"{FEWEST} players and {FEWEST} terrains at least, most of them played"
        return MixedModel(metric, f"No mixed model: it takes {least}.")
    spread = float(np.nanstd(table))
    if not spread > 1e-12 * float(np.nanmax(np.abs(table))):
        return MixedModel(metric, "No mixed model: all values are the same.")
    unit, middle = spread, float(np.nanmean(table))
    known = ~np.isnan(table)
    design = _Design.of(known, trials)
    values = (table[known] - middle) / unit
    found = crossed_components((table - middle) / unit)
    if not float(found.rest) > NO_VARIANCE:
        nothing = "No mixed model: beside players and terrains nothing is left that varies."
        return MixedModel(metric, nothing)
    start = float(found.player) / float(found.rest), float(found.terrain) / float(found.rest)
    try:
        variances = _fit(values, design, start)
    except (np.linalg.LinAlgError, ValueError) as error:
        why = f"The mixed model could not be fitted ({error}): it has no figures."
        return MixedModel(metric, why)
    if variances is None:
        return MixedModel(metric, "The mixed model did not converge: it has no figures.")
    solved = _solve(values, design, variances)
    return _in_units(metric, solved, variances, (unit, middle), design, columns)


@dataclass(frozen=True)
class _Design:
    """Which of the n values were made, float64[n, 2] of 1 and the standardized trial, and 0 or 1 by player and terrain."""

    known: NDArray[np.bool_]
    fixed: Floats
    players: Floats
    terrains: Floats
    trial_sd: float

    @classmethod
    def of(cls, known: NDArray[np.bool_], trials: Floats) -> _Design:
        player, terrain = np.nonzero(known)
        trial = trials[known]
        spread = float(trial.std())
        fixed = np.column_stack([np.ones(len(trial)), (trial - trial.mean()) / (spread or 1.0)])
        players, terrains = np.eye(known.shape[0])[player], np.eye(known.shape[1])[terrain]
        return cls(known, fixed, players, terrains, spread)


@dataclass(frozen=True)
class Variances:
    """Between players, between terrains, and of the rest."""

    player: float
    terrain: float
    rest: float


def _fit(values: Floats, design: _Design, start: tuple[float, float]) -> Variances | None:
    """Return the REML variances for values float64[n] of mean 0 and SD 1; None where the search does not converge.

    start  the players' and the terrains' variance over that of the rest, where the search begins
    """
    from statsmodels.regression.mixed_linear_model import MixedLM, MixedLMParams, VCSpec

    parts = {"player": design.players, "terrain": design.terrains}
    names = [[[f"{name}{i}" for i in range(part.shape[1])]] for name, part in parts.items()]
    effects = VCSpec(list(parts), names, [[part] for part in parts.values()])
    one = np.zeros(len(values), np.int64)
    model = MixedLM(values, design.fixed, groups=one, exog_vc=effects, use_sqrt=True)
    ratios = np.clip(np.nan_to_num(np.array(start)), SMALLEST_START, LARGEST_START)
    none = {"fe_params": np.zeros(2), "cov_re": np.zeros((0, 0))}
    first = MixedLMParams.from_components(**none, vcomp=ratios)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a variance may be 0, which it may
        fitted = model.fit(start_params=first, reml=True, method=["lbfgs", "nm"])
    if not fitted.converged:
        return None
    player, terrain = map(float, fitted.vcomp)
    return _refined(values, design, Variances(player, terrain, float(fitted.scale)))


def _refined(values: Floats, design: _Design, found: Variances) -> Variances:
    """Return the variances at the top of the same likelihood, searched on from what statsmodels found, to six digits.

    Its search by gradients leaves the last digits open and stops early where a variance is near 0, so that two machines could
    print different figures. This one takes none; the likelihood comes from the mixed model equations (Searle et al. 1992,
    chapter 6), whose size does not grow with the number of episodes.
    """
    whole = np.column_stack([design.fixed, design.players, design.terrains])
    products, sums, squares = whole.T @ whole, whole.T @ values, float(values @ values)
    counts, freedom = design.known.shape, len(values) - 2

    def solved(roots: Floats) -> tuple[float, float]:
        """Return -2 log likelihood and the variance of the rest, for the square roots of the variances over it."""
        scales = np.concatenate([np.ones(2), np.repeat(np.abs(roots), counts)])
        prior = np.diag([0.0, 0.0 if design.trial_sd > 0 else 1.0, *np.ones(sum(counts))])
        lower = np.linalg.cholesky(products * np.outer(scales, scales) + prior)
        explained = scipy.linalg.solve_triangular(lower, scales * sums, lower=True)
        rest = (squares - float(explained @ explained)) / freedom
        return 2 * float(np.log(np.diag(lower)).sum()) + freedom * float(np.log(rest)), rest

    roots = np.sqrt(np.maximum(np.array([found.player, found.terrain]) / found.rest, NO_VARIANCE))
    options = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000}
    search = partial(scipy.optimize.minimize, method="Nelder-Mead", options=options)
    best = search(lambda roots: solved(roots)[0], roots).x
    rest = solved(best)[1]
    player, terrain = (
        float(f"{root**2 * rest:.6g}") if root**2 > NO_VARIANCE else 0.0
        for root in map(float, best)
    )
    return Variances(player, terrain, float(f"{rest:.6g}"))


def _solve(values: Floats, design: _Design, variances: Variances) -> tuple[Floats, Floats]:
    """Return the fixed and the random effects float64[2 + players + terrains], and the covariance of their errors.

    Henderson's mixed model equations (1975, Biometrics 31(2)), scaled so that a variance may be 0. The errors of the random
    effects hold those of the fixed ones.
    """
    scales = np.repeat([variances.player, variances.terrain], design.known.shape) ** 0.5
    random = np.column_stack([design.players, design.terrains]) * scales
    whole = np.column_stack([design.fixed, random])
    prior = np.diag(np.concatenate([np.zeros(2), np.full(len(scales), variances.rest)]))
    if not design.trial_sd > 0:
        prior[1, 1] = 1.0  # the trial never changes: its slope is 0
    inverse = np.linalg.inv(whole.T @ whole + prior)
    back = np.concatenate([np.ones(2), scales])
    effects: Floats = back * (inverse @ (whole.T @ values))
    return effects, variances.rest * inverse * np.outer(back, back)


def _in_units(
    metric: str,
    solved: tuple[Floats, Floats],
    variances: Variances,
    scale: Interval,
    design: _Design,
    columns: Indices,
) -> MixedModel:
    """Return the results in the metric's unit; scale: that unit in the fit's, and the mean of all values."""
    (unit, middle), (effects, covariance) = scale, solved
    players, terrains = design.known.shape
    count = int(design.known.sum())
    errors = unit * np.sqrt(np.maximum(np.diag(covariance), 0))
    each = variances.rest / count
    of_players = np.asarray(variances.player / players + each)
    of_terrains = np.asarray(variances.terrain / terrains + each)
    freedom = satterthwaite(of_players, of_terrains, np.asarray(each), design.known)
    mean, half = middle + unit * float(effects[0]), t_quantile(float(freedom)) * float(errors[0])
    slope, slope_half = None, 0.0
    if design.trial_sd > 0:
        slope = unit * float(effects[1]) / design.trial_sd
        slope_half = t_quantile(count - players - terrains) * float(errors[1]) / design.trial_sd
    values = (unit * effects[2 + players :]).tolist()
    halves = (scipy.special.ndtri(1 - TAIL) * errors[2 + players :]).tolist()
    return MixedModel(
        metric=metric,
        note="Fitted by restricted maximum likelihood; it converged.",
        converged=True,
        mean=mean,
        interval=(mean - half, mean + half),
        slope=slope,
        slope_interval=None if slope is None else (slope - slope_half, slope + slope_half),
        player_sd=unit * variances.player**0.5,
        terrain_sd=unit * variances.terrain**0.5,
        rest_sd=unit * variances.rest**0.5,
        terrains=tuple(
            TerrainDifficulty(terrain, value, (value - half, value + half))
            for terrain, value, half in zip(columns.tolist(), values, halves, strict=True)
        ),
    )
