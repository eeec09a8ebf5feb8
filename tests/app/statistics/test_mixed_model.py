"""The mixed model: variances and slope come back, its mean agrees with statsmodels' own, and it says in words when it fails."""

import ast
import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy

from app.report.statistics.crossed import crossed_mean
from app.report.statistics.mixed_model import fit_mixed_model

NAN = float("nan")


def simulated(seed, players=10, terrains=12, sds=(0.02, 0.03, 0.04), slope=0.001):
    """Return a table, the trials, and what each terrain adds."""
    rng = np.random.default_rng(seed)
    shape = (players, terrains)
    trials = rng.permuted(np.tile(np.arange(float(terrains)), (players, 1)), axis=1)
    terrain = sds[1] * rng.standard_normal(terrains)
    table = (
        0.9
        + sds[0] * rng.standard_normal((players, 1))
        + terrain
        + sds[2] * rng.standard_normal(shape)
    )
    return table + slope * (trials - trials.mean()), trials, terrain


def test_without_gaps_the_variances_and_the_mean_are_those_of_the_analysis_of_variance():
    # balanced and without a negative component, REML is ANOVA (Searle et al. 1992); the trial changes it a little
    table, trials, _ = simulated(1, slope=0.0)
    found = fit_mixed_model("score", table, trials)
    plain = crossed_mean(table)
    assert found.converged
    assert found.mean == pytest.approx(float(plain.mean), abs=1e-9)
    half = (found.interval[1] - found.interval[0]) / 2
    assert half == pytest.approx(
        float(scipy.stats.t.ppf(0.975, plain.freedom) * plain.error), rel=0.05
    )


def test_the_figures_are_statsmodels_own():
    from statsmodels.regression.mixed_linear_model import MixedLM, VCSpec

    table, trials, _ = simulated(2)
    table[np.random.default_rng(1).random(table.shape) < 0.2] = NAN
    known = ~np.isnan(table)
    player, terrain = np.nonzero(known)
    fixed = np.column_stack([np.ones(known.sum()), trials[known] - trials[known].mean()])
    designs = [np.eye(10)[player], np.eye(12)[terrain]]
    names = [
        [[f"{kind}{i}" for i in range(part.shape[1])]]
        for kind, part in zip("pt", designs, strict=True)
    ]
    effects = VCSpec(["p", "t"], names, [[part] for part in designs])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = MixedLM(
            100 * table[known], fixed, groups=np.zeros(known.sum()), exog_vc=effects
        ).fit()
    ours = fit_mixed_model("score", table, trials)
    assert (ours.mean, ours.slope) == pytest.approx(theirs.fe_params / 100, rel=1e-4)
    sds = np.sqrt([*theirs.vcomp, theirs.scale]) / 100
    assert (ours.player_sd, ours.terrain_sd, ours.rest_sd) == pytest.approx(sds, rel=1e-3)
    predicted = np.asarray(next(iter(theirs.random_effects.values())))[10:] / 100
    assert [each.effect for each in ours.terrains] == pytest.approx(predicted, abs=1e-5)


def test_simulated_variances_slope_and_difficulties_come_back():
    found = [
        (fit_mixed_model("score", *simulated(seed)[:2]), simulated(seed)[2]) for seed in range(20)
    ]
    means = [
        np.mean([getattr(model, name) for model, _ in found])
        for name in ("player_sd", "terrain_sd", "rest_sd", "slope")
    ]
    assert means == pytest.approx([0.02, 0.03, 0.04, 0.001], rel=0.15)
    guesses = np.array([[each.effect for each in model.terrains] for model, _ in found])
    assert (
        np.corrcoef(guesses.ravel(), np.array([truth for _, truth in found]).ravel())[0, 1] > 0.85
    )
    inside = np.mean(
        [
            low <= truth <= high
            for model, terrain in found
            for (low, high), truth in zip(
                [each.interval for each in model.terrains], terrain, strict=True
            )
        ]
    )
    assert 0.88 < inside < 0.99


def test_a_variance_of_nothing_is_a_fit_and_no_failure():
    table, trials, _ = simulated(3, sds=(0.0, 0.0, 0.04))
    found = fit_mixed_model("steps", table, trials)
    assert found.converged
    assert found.player_sd < 0.02
    assert found.interval[0] < 0.9 < found.interval[1]


def test_a_terrain_that_nobody_finished_has_no_difficulty_and_the_others_keep_their_number():
    table, trials, _ = simulated(4)
    table[:, 3] = NAN
    found = fit_mixed_model("score", table, trials)
    assert [each.terrain for each in found.terrains] == [0, 1, 2, *range(4, 12)]


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (np.full((5, 6), 0.3), "all values are the same"),
        (np.arange(5.0)[:, None] + np.arange(6.0), "nothing is left that varies"),
        (np.random.default_rng(1).random((2, 6)), "3 players and 3 terrains"),
        (np.array([[0.1, NAN, NAN], [NAN, 0.2, NAN], [NAN, NAN, 0.3]]), "most of them played"),
    ],
)
def test_what_cannot_be_fitted_says_so_in_words(table, said):
    found = fit_mixed_model(
        "score", table, np.tile(np.arange(float(table.shape[1])), (len(table), 1))
    )
    assert not found.converged
    assert said in found.note
    assert (found.mean, found.interval, found.slope, found.terrains) == (None, None, None, ())


def test_a_fit_that_does_not_converge_says_so_in_words(monkeypatch):
    import app.report.statistics.mixed_model as module

    monkeypatch.setattr(module, "_fit", lambda *given: None)
    found = fit_mixed_model("score", *simulated(5)[:2])
    assert (found.converged, found.mean) == (False, None)
    assert "did not converge" in found.note


@pytest.mark.parametrize(
    "sds", [(0.02, 0.03, 0.04), (0.0, 0.03, 0.04), (0.02, 0.0, 0.04), (0.0, 0.0, 0.04)]
)
def test_the_fit_does_not_depend_on_where_the_search_begins(sds, monkeypatch):
    import app.report.statistics.mixed_model as module

    first = [fit_mixed_model("score", *simulated(seed, sds=sds)[:2]) for seed in range(2)]
    fit = module._fit
    monkeypatch.setattr(
        module, "_fit", lambda values, design, start: fit(values, design, (0.7, 0.7))
    )
    for seed, one in enumerate(first):
        other = fit_mixed_model("score", *simulated(seed, sds=sds)[:2])
        assert one.converged
        assert other.mean == pytest.approx(one.mean, abs=1e-9)
        assert other.slope == pytest.approx(one.slope, rel=1e-6)
        assert other.interval == pytest.approx(one.interval, abs=1e-6)


def test_statsmodels_is_loaded_where_it_is_used_alone():
    for path in (Path(__file__).parents[3] / "app").rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                assert "statsmodels" not in ast.unparse(node), (
                    f"{path} loads statsmodels for everybody: it takes a second"
                )
