"""The spread of a table: variance components and the middle half, against textbooks and literal twins."""

import numpy as np
import pytest
from scipy import stats

from app.statistics.spread import iqm, iqm_interval, variance_components

SHROUT_FLEISS = np.array([[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float)
"""Shrout and Fleiss 1979, table 2: between mean square 11.24, within 6.26, ICC(1,1) = 0.17."""
NAN = float("nan")


def uneven(seed=1, players=7, terrains=9):
    rng = np.random.default_rng(seed)
    table = rng.normal(0.8, 0.1, (players, 1)) + rng.normal(0, 0.1, (players, terrains))
    table[rng.random(table.shape) < 0.25] = NAN
    return table


def test_the_icc_of_shrout_and_fleiss():
    found = variance_components(SHROUT_FLEISS)
    assert found.icc == pytest.approx(0.1657, abs=5e-5)
    assert found.within_sd**2 == pytest.approx(6.2639, abs=5e-5)
    assert found.between_sd**2 == pytest.approx((11.2417 - 6.2639) / 4, abs=5e-5)
    assert (found.n0, found.players, found.episodes) == (4, 6, 24)
    assert found.design_effect == pytest.approx(1 + 3 * found.icc)
    # the interval that McGraw and Wong 1996 and the R package psych give for these data
    assert found.icc_interval == pytest.approx((-0.1329, 0.7226), abs=5e-4)


def test_uneven_numbers_of_episodes_take_n0():
    groups = [[1.0, 2.0, 3.0], [4.0, 6.0], [2.0, 2.5, 3.5, 4.0, 1.0]]
    table = np.array([row + [NAN] * (5 - len(row)) for row in groups])
    sizes = [len(row) for row in groups]
    total = sum(sizes)
    grand = sum(map(sum, groups)) / total
    between = sum(len(row) * (np.mean(row) - grand) ** 2 for row in groups) / 2
    within = sum((x - np.mean(row)) ** 2 for row in groups for x in row) / (total - 3)
    n0 = (total - sum(size**2 for size in sizes) / total) / 2
    found = variance_components(table)
    assert found.n0 == pytest.approx(n0)
    assert found.icc == pytest.approx((between - within) / (between + (n0 - 1) * within))
    assert stats.f_oneway(*groups).statistic == pytest.approx(between / within)


def test_players_more_alike_than_chance_have_a_negative_icc_and_no_spread_between():
    found = variance_components(np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]]))
    assert found.icc < 0
    assert (found.between_sd, found.design_effect) == (0, 1)


@pytest.mark.parametrize("table", [np.ones((1, 5)), np.array([[1.0, NAN], [NAN, 2.0]]), np.ones((4, 3))])
def test_no_components_without_two_players_two_episodes_or_a_spread(table):
    assert variance_components(table) is None


def test_the_iqm_drops_a_quarter_on_each_side():
    assert iqm(np.array([[0.0, 1, 2, 3], [4, 5, 6, 100]])) == pytest.approx(3.5)


def test_the_iqms_interval_is_its_literal_twin():
    table = uneven(3)
    picks = np.random.default_rng(len(table)).integers(0, len(table), (300, len(table)))
    literal = [stats.trim_mean([x for x in table[pick].ravel() if not np.isnan(x)], 0.25) for pick in picks]
    assert iqm_interval(table, 300) == pytest.approx(tuple(np.quantile(literal, [0.025, 0.975])))
