"""The one interval of a mean over participants and terrains, and its p."""

import numpy as np
import pytest

from app.report.statistics.intervals import estimate, interval, p_value


@pytest.mark.parametrize("terrains_drawn", [True, False])
def test_p_is_below_5_percent_exactly_where_the_interval_leaves_0_out(terrains_drawn):
    rng = np.random.default_rng(6)
    tables = 0.25 + rng.normal(0, 0.4, (300, 8, 1)) + rng.normal(0, 0.6, (300, 8, 9))
    low, high = interval(tables, -3.0, terrains_drawn)
    outside = (low > 0) | (high < 0)
    assert 0.05 < outside.mean() < 0.95
    assert ((p_value(tables, -3.0, terrains_drawn) < 0.05) == outside).all()


def test_an_estimate_is_cut_off_at_the_bounds():
    table = np.array([[0.9, 1.0], [1.0, 1.0], [0.8, 0.9]])
    found = estimate(table, (0.0, 1.0), 0.0, terrains_drawn=False)
    assert found.mean == pytest.approx(table.mean())
    assert found.interval[1] <= 1.0
