"""Cost of moves and the effort check on players whose truth is known."""

import numpy as np
import pytest

from humanplay.report.measured_coverage import SCORE_POPULATIONS
from humanplay.report.statistics.crossed import crossed_components
from humanplay.task.registration import environment_of
from marsexplorer.config import RUNNING, EnvConfig
from marsexplorer.world import Worlds, positions
from research.methods import arm_coverage
from research.methods.assumed_spread import steps_of_players
from research.methods.cost_validation import SLIP_RATES, SlipPool, measure_slips
from research.methods.effort_rates import effort_rate
from research.methods.simulated_players import RANDOM_MOVES, SIMULATED_POPULATIONS, DecisionKernel


def test_who_slips_more_loses_more_and_who_never_slips_loses_nothing():
    pool = measure_slips(EnvConfig("random", 11, 13), (0.0, 0.5), replicates=2, terrains=4, seed=0)
    assert pool.cost[1].mean(1).min() > 0
    assert not pool.cost[0].any()
    assert pool.rank_correlation() > 0.8  # two players of each rate: the rates are tied


def test_coverage_counts_the_studies_that_hold_the_true_mean():
    cost = np.random.default_rng(0).normal(50, 10, (4, 3, 6)) + 20 * np.arange(4)[:, None, None]
    pool = SlipPool((0.0, 0.1, 0.2, 0.3), cost, np.zeros_like(cost))
    assert 0.9 < pool.coverage(10, 400, np.random.default_rng(1)) < 1


@pytest.mark.long
def test_slip_rates_and_mean_cost_rank_alike_and_the_interval_covers():
    """The figures of docs/evaluation.md."""
    pool = measure_slips(EnvConfig(), SLIP_RATES, replicates=3, terrains=30, seed=0)
    assert pool.rank_correlation() >= 0.9
    for players in (10, 20):
        assert 0.93 <= pool.coverage(players, 2000, np.random.default_rng(players)) <= 0.98


def test_random_movers_are_labelled_and_people_are_not():
    config = EnvConfig("random", 17, 22)
    assert effort_rate(config, RANDOM_MOVES, 100, seed=1) >= 0.95
    assert effort_rate(config, SIMULATED_POPULATIONS["skilled"], 100, seed=1) == 0
    assert effort_rate(config, SIMULATED_POPULATIONS["mixed"], 100, seed=1) <= 0.03


@pytest.mark.long
def test_the_effort_rates_of_the_documents():
    stated = {"random": 0.992, "skilled": 0.0, "mixed": 0.002, "clumsy": 0.021}  # docs/report.md
    for population in (RANDOM_MOVES, *SIMULATED_POPULATIONS.values()):
        rate = effort_rate(EnvConfig(), population, 2000, seed=0)
        assert rate == pytest.approx(stated[population.name], abs=0.001)


@pytest.mark.long
def test_what_a_new_study_assumes_is_what_synthetic_players_show():
    steps = steps_of_players(EnvConfig(), "mixed", 150, 30, seed=0)
    spread = crossed_components(steps)
    sds = [float(part) ** 0.5 for part in (spread.player, spread.terrain, spread.rest)]
    assumed = environment_of("mars").assumed(EnvConfig(), "steps")
    assert [np.nanmean(steps), *sds] == pytest.approx(list(assumed.values()), rel=0.05)


def outcomes_of(slip, crash, boards=40):
    """Play so many boards with one style to the end, and return their outcomes."""
    worlds = Worlds(EnvConfig.of("random", 9), boards)
    worlds.start(np.arange(boards))
    kernel = DecisionKernel((9, 9), 6, boards)
    style = np.full(boards, slip), np.full(boards, crash), np.arange(boards, dtype=np.uint64)
    moves = np.zeros(boards, np.int64)
    while (running := np.equal(worlds.outcomes, RUNNING)).any():
        worlds.step(kernel.decide(worlds.codes, positions(worlds.scalars), running, style, moves))
        moves += running
    return worlds.outcomes


def test_who_never_slips_explores_and_who_always_crashes_collides():
    assert (outcomes_of(0.0, 0.0) == 1).all()
    assert np.isin(outcomes_of(0.0, 1.0), (2, 3)).all()


def test_the_interval_of_two_arms_holds_the_truth_and_not_a_shifted_one(monkeypatch):
    population = SCORE_POPULATIONS[0]
    assert 0.9 < arm_coverage.covered_share(population, 10, 0.02, studies=200, seed=0) <= 1
    first, second = arm_coverage.simulate_arms(population, 10, 0.0, studies=200, seed=0)
    monkeypatch.setattr(arm_coverage, "simulate_arms", lambda *_: (first + 0.5, second))
    assert arm_coverage.covered_share(population, 10, 0.0, studies=200, seed=0) == 0


def test_the_table_of_two_arms_has_a_column_for_each_kind_of_study():
    header, _, *rows = arm_coverage.table(studies=4, seed=0).splitlines()
    assert "| 5 people, SD between terrains 0 |" in header
    assert "| 20 people, SD between terrains 0.02 |" in header
    assert [row.split(" | ")[0] for row in rows] == [
        f"| {population.name}" for population in SCORE_POPULATIONS
    ]
    assert {row.count("|") for row in rows} == {header.count("|")}
