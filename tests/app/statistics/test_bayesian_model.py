"""The Bayesian model: what enters it, when its sampling is called poor, and (long) simulated players and terrains come back."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from app.statistics.bayesian_model import (
    Episodes,
    episodes_of,
    fit_bayesian_model,
    priors_in_words,
    sampling_warnings,
)
from app.statistics.exclusion_sets import members, people_of
from app.study.data import load
from tests.support.stored_studies import freeze, play_study

LIMIT = 400
PLAYER_SD, TERRAIN_SD, REST_SD, SLOPE = 0.12, 0.1, 0.2, -0.1
MEDIAN = 85.0


def simulated(seed, players=10, terrains=30, hazard=0.002):
    """Return episodes of which some end early, at a constant rate a move or at the limit, and the terrains' log factors."""
    rng = np.random.default_rng(seed)
    player, terrain = (part.ravel() for part in np.indices((players, terrains)))
    trial = np.concatenate([rng.permutation(terrains) for _ in range(players)])
    of_player, of_terrain = (
        rng.normal(0, sd, count) for sd, count in ((PLAYER_SD, players), (TERRAIN_SD, terrains))
    )
    middle = SLOPE * (trial - (terrains - 1) / 2) / (terrains - 1)
    log_steps = (
        np.log(MEDIAN)
        + middle
        + of_player[player]
        + of_terrain[terrain]
        + rng.normal(0, REST_SD, len(player))
    )
    ends = np.minimum(rng.exponential(1 / hazard, len(player)), LIMIT)
    moves = np.ceil(np.minimum(np.exp(log_steps), ends))
    return Episodes(
        player, terrain, trial, moves, np.exp(log_steps) <= ends, LIMIT, terrains
    ), of_terrain


def fitted(*seeds):
    """Return the models of simulated studies; in a process of its own, since what samples them must not stay in this one."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return list(pool.map(fit_bayesian_model, [simulated(seed)[0] for seed in seeds]))


def test_every_ranked_episode_enters_and_those_without_99_percent_as_censored(tmp_path):
    play_study(tmp_path / "play.db", freeze(tmp_path / "studies"))
    data = load(tmp_path / "play.db", "dunes")
    cohort = people_of(data)
    ids = members(cohort, {})
    found = episodes_of(cohort, ids, data.protocol.env_config.limit)
    trials = [each for person in ids for each in cohort.ranked[person]]
    assert len(found.moves) == len(trials) > 0
    assert list(found.moves) == [
        each.steps for each in trials
    ]  # what was played, not what the primary figure counts for it
    assert list(found.is_explored) == [each.outcome == "explored" for each in trials]
    assert not found.is_explored.all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"players": 2}, "3 players and 3 terrains"),
        ({"terrains": 2}, "3 players and 3 terrains"),
        ({"hazard": 5.0}, "no episode"),
    ],
)
def test_what_cannot_be_sampled_says_so_in_words(change, said):
    found = fit_bayesian_model(simulated(1, **change)[0])
    assert said in found.note
    assert (found.mean, found.terrains, found.chains) == (None, (), 0)
    assert found.censored <= found.episodes


@pytest.mark.parametrize(
    ("r_hat", "effective", "diverging", "count"),
    [
        (1.004, 900.0, 0, 0),
        (1.02, 900.0, 0, 1),
        (1.004, 399.0, 0, 1),
        (1.004, 900.0, 3, 1),
        (float("nan"), float("nan"), 0, 2),
        (1.5, 12.0, 40, 3),
    ],
)
def test_poor_sampling_is_said(r_hat, effective, diverging, count):
    assert len(sampling_warnings(r_hat, effective, diverging)) == count


def test_the_priors_are_stated_in_steps_and_percent():
    words = " ".join(priors_in_words(LIMIT))
    assert "14 to 710 steps" in words  # 100 e^-1.96 and 100 e^1.96
    assert "up to 166 % more" in words  # e^0.98


@pytest.mark.long
@pytest.mark.timeout(900)
def test_simulated_players_terrains_and_learning_come_back_although_episodes_are_censored():
    (found,) = fitted(3)
    episodes, of_terrain = simulated(3)
    assert found.censored > 30
    assert found.warnings == ()
    assert found.r_hat < 1.01
    assert found.effective > 400
    for name, truth in (
        ("typical", MEDIAN),
        ("mean", MEDIAN * np.exp((PLAYER_SD**2 + TERRAIN_SD**2 + REST_SD**2) / 2)),
        ("change", 100 * np.expm1(SLOPE)),
        ("player_sd", PLAYER_SD),
        ("terrain_sd", TERRAIN_SD),
        ("rest_sd", REST_SD),
    ):
        low, high = getattr(found, name).interval
        assert low < truth < high, name
    factors = [each.factor.mean for each in found.terrains]
    assert np.corrcoef(factors, np.exp(of_terrain))[0, 1] > 0.75
    # without the censored ones, steps are too few: the long episodes are those that end early
    assert episodes.moves[episodes.is_explored].mean() < found.mean.interval[1] - 3


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_the_posterior_intervals_cover_over_40_studies():
    models = fitted(*range(100, 140))
    truths = {
        "typical": MEDIAN,
        "change": 100 * np.expm1(SLOPE),
        "rest_sd": REST_SD,
        "player_sd": PLAYER_SD,
    }
    slack = 2.6 * 100 * np.sqrt(0.95 * 0.05 / len(models))
    for name, truth in truths.items():
        inside = 100 * np.mean(
            [
                low <= truth <= high
                for low, high in (getattr(each, name).interval for each in models)
            ]
        )
        assert inside > 95 - slack, name
    assert np.mean([bool(each.warnings) for each in models]) <= 0.1
