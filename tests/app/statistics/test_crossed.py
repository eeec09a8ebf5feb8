"""The mean over players and terrains: textbook mean squares, gaps, and how often the test rejects what is true."""

import numpy as np
import pytest

from app.report.statistics.crossed import (
    can_be_crossed,
    crossed_components,
    crossed_interval,
    crossed_mean,
    crossed_p,
)
from tests.app.statistics.test_spread import SHROUT_FLEISS

NAN = float("nan")


def mean_squares(table):
    """Return MS_P, MS_T and MS_E of a table without gaps, from their definitions."""
    players, terrains = table.shape
    grand, rows, columns = table.mean(), table.mean(1), table.mean(0)
    rest = sum(
        (table[p, t] - rows[p] - columns[t] + grand) ** 2
        for p in range(players)
        for t in range(terrains)
    )
    return (
        terrains * sum((rows - grand) ** 2) / (players - 1),
        players * sum((columns - grand) ** 2) / (terrains - 1),
        rest / ((players - 1) * (terrains - 1)),
    )


def test_without_gaps_the_components_are_the_textbooks_mean_squares():
    # Shrout and Fleiss 1979, table 3: between targets 11.24, between judges 32.49, residual 1.02
    of_players, of_terrains, rest = mean_squares(SHROUT_FLEISS)
    assert (of_players, of_terrains, rest) == pytest.approx((11.24, 32.49, 1.02), abs=5e-3)
    found = crossed_components(SHROUT_FLEISS)
    assert found.player == pytest.approx((of_players - rest) / 4)
    assert found.terrain == pytest.approx((of_terrains - rest) / 6)
    assert found.rest == pytest.approx(rest)
    mean = crossed_mean(SHROUT_FLEISS)
    variance = (of_players + of_terrains - rest) / 24
    assert mean.error == pytest.approx(np.sqrt(variance))
    doubt = of_players**2 / 5 + of_terrains**2 / 3 + rest**2 / 15
    assert mean.freedom == pytest.approx((of_players + of_terrains - rest) ** 2 / doubt)


def test_the_variance_never_falls_below_that_of_players_or_terrains_alone():
    for seed in range(40):
        table = np.random.default_rng(seed).normal(0, 1, (4, 5))
        of_players, of_terrains, _ = mean_squares(table)
        assert crossed_mean(table).error ** 2 >= max(of_players, of_terrains) / 20 - 1e-12


def test_studies_are_worked_on_together_as_one_by_one():
    rng = np.random.default_rng(3)
    tables = rng.normal(0, 1, (7, 5, 6)) + rng.normal(0, 1, (7, 5, 1))
    tables[rng.random(tables.shape) < 0.2] = NAN
    tables = np.array([table for table in tables if can_be_crossed(table)])
    assert len(tables) > 3
    assert crossed_p(tables) == pytest.approx(np.array([crossed_p(table) for table in tables]))
    low, high = crossed_interval(tables)
    assert [crossed_interval(table)[0] for table in tables] == pytest.approx(low)
    assert [crossed_interval(table)[1] for table in tables] == pytest.approx(high)


def test_gaps_leave_the_components_unbiased():
    rng = np.random.default_rng(4)
    tables = (
        rng.normal(0, 1, (3000, 8, 1))
        + rng.normal(0, 0.7, (3000, 1, 10))
        + rng.normal(0, 1.5, (3000, 8, 10))
    )
    tables[:, rng.random((8, 10)) < 0.3] = NAN
    found = crossed_components(tables)
    assert found.player.mean() == pytest.approx(1, abs=0.05)
    assert found.terrain.mean() == pytest.approx(0.49, abs=0.04)
    assert found.rest.mean() == pytest.approx(2.25, abs=0.05)
    spread = np.nanmean(tables, 2).mean(1).var()
    assert (crossed_mean(tables).error ** 2).mean() == pytest.approx(spread, rel=0.08)


@pytest.mark.parametrize("confidence", [0.8, 0.95, 0.99])
def test_the_p_is_below_5_percent_exactly_where_the_interval_leaves_0_out(confidence):
    rng = np.random.default_rng(6)
    tables = (
        0.25 + rng.normal(0, 0.3, (400, 6, 1)) - 0.3 * rng.standard_exponential((400, 6, 9)) + 0.3
    )
    low, high = crossed_interval(tables, confidence)
    outside = (low > 0) | (high < 0)
    assert 0.05 < outside.mean() < 0.95
    assert ((crossed_p(tables) < 1 - confidence) == outside).all()


def test_cells_that_are_all_alike_have_no_doubt():
    assert crossed_p(np.full((5, 6), 0.2)) == 0
    assert crossed_p(np.zeros((5, 6))) == 1


@pytest.mark.parametrize(
    "table",
    [
        np.ones((1, 5)),
        np.ones((5, 1)),
        np.array([[1.0, NAN], [NAN, 2.0]]),
        np.array([[1.0, 2.0], [NAN, NAN]]),
    ],
)
def test_too_few_values_are_not_crossed(table):
    assert not can_be_crossed(table)


@pytest.mark.parametrize("player_sd", [0.0, 0.5, 1.0])
def test_a_policy_as_good_as_people_is_called_different_in_one_study_of_twenty(player_sd):
    rng = np.random.default_rng(7)
    differences = (
        player_sd * rng.standard_normal((1000, 10, 1))
        + rng.standard_normal((1000, 1, 30))
        + rng.standard_normal((1000, 10, 30))
    )
    assert 20 < (crossed_p(differences) < 0.05).sum() < 75
