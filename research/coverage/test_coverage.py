"""The coverage of the printed interval, measured: a few cells here, all in the long run, and the table that is quoted."""

import math
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from app.report.measured_coverage import ONE_SHAPE, SCORE_POPULATIONS, nearest, saved
from app.report.statistics.spread import iqm
from research.coverage.__main__ import headline_table, markdown_table
from research.coverage.measure import (
    coverage_error,
    measure_cell,
    measure_false_alarms,
    measure_iqm,
    measure_ratio,
)
from research.coverage.simulated_studies import SCORE_BOUNDS, mean_score, simulate_studies, steps_of

DOCS = Path(__file__).with_name("README.md")
BY_NAME = {population.name: population for population in SCORE_POPULATIONS}
STUDIES = 400


def within(measured, low, high, studies):
    """Whether a measured coverage agrees with a true one in low..high (percent), chance of a false alarm below 1 in 1,000."""
    slack = 1.7 * coverage_error(95, studies)
    return low - slack <= measured <= high + slack


@pytest.mark.parametrize(
    ("name", "icc", "players"),
    [("symmetric", 0.2, 10), ("skewed", 0.2, 10), ("collisions", 0.0, 20)],
)
def test_the_printed_interval_covers_the_truth_as_often_as_it_says(name, icc, players):
    cell = measure_cell(BY_NAME[name], icc, players, STUDIES, seed=11)
    assert within(cell.printed, 93, 97.5, STUDIES), cell
    assert cell.guaranteed >= 95
    assert within(cell.new_terrains, 93, 100, STUDIES), cell


def test_pooling_episodes_does_not_and_t_alone_falls_short_of_the_rule_under_skewness():
    cell = measure_cell(BY_NAME["very skewed"], 0.5, 10, STUDIES, seed=12)
    assert cell.pooled < 60
    assert cell.printed - cell.t > 2
    assert cell.below > cell.above


def test_no_interval_knows_of_failures_that_happened_to_nobody_but_the_guaranteed_one():
    cell = measure_cell(BY_NAME["rare collisions"], 0.5, 5, STUDIES, seed=13)
    assert cell.printed < 60
    assert cell.guaranteed >= 95


@pytest.mark.parametrize("population", SCORE_POPULATIONS, ids=lambda population: population.name)
@pytest.mark.parametrize("icc", [0.0, 0.2, 0.5])
def test_simulated_scores_have_the_mean_and_the_icc_they_claim(population, icc):
    scores, terrain = simulate_studies(population, icc, 20, 400, np.random.default_rng(14))
    assert scores.mean() == pytest.approx(mean_score(population) + terrain.mean(), abs=0.004)
    assert terrain.mean() == pytest.approx(0, abs=0.002)
    assert SCORE_BOUNDS[0] < scores.mean(2).min()
    assert scores.mean(2).max() < SCORE_BOUNDS[1]
    # between players, from two halves of the terrains: free of the noise within
    first, second = scores[:, :, :15].mean(2), scores[:, :, 15:].mean(2)
    first, second = first - first.mean(1, keepdims=True), second - second.mean(1, keepdims=True)
    between = (first * second).sum() / (400 * 19)
    total = scores.var(axis=(1, 2), ddof=1).mean()
    assert between / total == pytest.approx(icc, abs=0.06)


@pytest.mark.parametrize("population", SCORE_POPULATIONS, ids=lambda population: population.name)
def test_simulated_steps_have_the_mean_they_claim(population):
    scores, terrain = simulate_studies(population, 0.2, 20, 2000, np.random.default_rng(14))
    steps, truth = steps_of(population, scores, terrain)
    error = (steps.mean((1, 2)) - truth).std() / 2000**0.5
    assert steps.mean() == pytest.approx(truth.mean(), abs=4 * error)
    assert np.quantile(steps, 0.5) == pytest.approx(95, abs=5)


def test_the_ratios_interval_covers_the_ratio_over_players_and_terrains():
    assert within(measure_ratio(BY_NAME["symmetric"], 0.2, 10, 300, seed=15), 93, 99, 300)
    assert measure_ratio(BY_NAME["rare collisions"], 0.5, 5, 100, seed=15) < 80


def test_false_alarms_are_as_rare_as_they_should_be_at_every_icc():
    for icc in (0.0, 0.1, 0.3, 0.5):
        assert 2 < measure_false_alarms(BY_NAME["skewed"], icc, 10, 1000, seed=15) < 7.5
    assert measure_false_alarms(BY_NAME["rare collisions"], 0.5, 5, 200, seed=15) > 30


def test_the_interquartile_means_interval_covers_it():
    assert within(measure_iqm(BY_NAME["symmetric"], 0.2, 10, 200, seed=16), 94, 97.5, 200)
    assert within(measure_iqm(BY_NAME["very skewed"], 0.5, 10, 200, seed=16), 93, 97.5, 200)


def test_percentiles_over_resampled_players_did_not():
    population, rng = BY_NAME["symmetric"], np.random.default_rng(17)
    scores, _ = simulate_studies(population, 0.2, 305, 80, rng)
    drawn, covered = rng.integers(0, 5, (100, 5)), 0
    for table, others in zip(scores[:, :5], scores[:, 5:], strict=True):
        low, high = np.quantile([iqm(table[pick]) for pick in drawn], [0.025, 0.975])
        covered += low <= iqm(others) <= high
    assert covered / 80 < 0.9


def test_the_same_seed_gives_the_same_cell():
    first, again = (measure_cell(SCORE_POPULATIONS[0], 0.2, 5, 50, 1) for _ in range(2))
    assert first == again


def test_a_row_of_the_quoted_table_comes_out_again():
    cells = {(cell.population, cell.icc, cell.players): cell for cell in saved()}
    quoted = cells["collisions", 0.5, 5]
    again = measure_cell(BY_NAME["collisions"], 0.5, 5, quoted.studies, seed=0)
    for name in ("printed", "below", "above", "t", "guaranteed", "pooled", "width", "new_terrains", "headline",
                 "headline_steps", "printed_steps", "guaranteed_headline"):  # fmt: skip
        assert getattr(again, name) == pytest.approx(getattr(quoted, name), abs=0.11), name


def test_the_quoted_table_is_whole_and_stands_in_the_documents():
    cells = saved()
    found = {(cell.population, cell.icc, cell.players) for cell in cells}
    assert found == {*product(BY_NAME, (0, 0.2, 0.5), (5, 8, 10, 20, 30))}
    assert all(cell.studies >= 2000 for cell in cells)
    text = DOCS.read_text()
    assert markdown_table(cells) in text
    assert headline_table(cells) in text


def test_what_the_documents_promise_is_what_was_measured():
    cells = saved()
    one_shape = [cell for cell in cells if cell.population in ONE_SHAPE]
    alike = [cell for cell in cells if cell.population != "very skewed" and cell.players >= 10]
    assert all(93 <= cell.printed <= 97.05 for cell in alike if cell in one_shape)
    assert all(cell.guaranteed >= 95 for cell in cells)
    assert all(cell.printed >= cell.t - 0.05 for cell in cells)
    alike = [cell for cell in alike if cell.icc == 0 or cell in one_shape]
    shares = [share for cell in alike for share in (cell.headline, cell.headline_steps)]
    assert all(93 <= share <= 98.05 for share in shares)
    assert all(cell.headline >= cell.printed - 0.05 for cell in cells)
    low = min(cell.printed for cell in one_shape)
    assert re.search(rf"never below {low:.1f} %", DOCS.read_text())


def test_the_nearest_number_of_players_is_quoted():
    assert {cell.players for cell in nearest(2)} == {5}
    assert {cell.players for cell in nearest(12)} == {10}
    assert {cell.players for cell in nearest(15)} == {10}
    assert {cell.players for cell in nearest(500)} == {30}


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_every_cell_measured_again_agrees_with_the_quoted_table():
    studies = 400
    for cell in saved():
        again = measure_cell(BY_NAME[cell.population], cell.icc, cell.players, studies, seed=99)
        for name in ("printed", "t", "guaranteed", "pooled"):
            expected, found = getattr(cell, name), getattr(again, name)
            errors = (coverage_error(expected, count) for count in (studies, cell.studies))
            assert abs(found - expected) <= 2.1 * math.hypot(*errors) + 0.6, (name, cell, again)
