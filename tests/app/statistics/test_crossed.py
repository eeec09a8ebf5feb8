"""Variance components of participants and terrains, by textbooks and with gaps."""

import numpy as np
import pytest

from humanplay.report.statistics.crossed import can_be_crossed, crossed_components
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
    components = crossed_components(SHROUT_FLEISS)
    assert components.player == pytest.approx((of_players - rest) / 4)
    assert components.terrain == pytest.approx((of_terrains - rest) / 6)
    assert components.rest == pytest.approx(rest)


def test_gaps_leave_the_components_unbiased():
    rng = np.random.default_rng(4)
    tables = (
        rng.normal(0, 1, (3000, 8, 1))
        + rng.normal(0, 0.7, (3000, 1, 10))
        + rng.normal(0, 1.5, (3000, 8, 10))
    )
    tables[:, rng.random((8, 10)) < 0.3] = NAN
    components = crossed_components(tables)
    assert components.player.mean() == pytest.approx(1, abs=0.05)
    assert components.terrain.mean() == pytest.approx(0.49, abs=0.04)
    assert components.rest.mean() == pytest.approx(2.25, abs=0.05)


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
