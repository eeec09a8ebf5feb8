"""Intervals against textbooks and literal twins, and what the rule promises."""

import math

import numpy as np
import pytest
import scipy

from app.report.statistics.intervals import (
    estimate_of_means,
    guaranteed_covers,
    guaranteed_interval,
    hall_interval,
    printed_interval,
    skewness,
)
from marsexplorer.intervals import t_interval

RNG = np.random.default_rng(7)
SAMPLES = [
    RNG.standard_normal(5),
    1 - RNG.standard_exponential(10),
    RNG.standard_exponential(30),
    RNG.lognormal(0, 1, 8),
]


@pytest.mark.parametrize("values", SAMPLES)
def test_the_t_interval_and_the_skewness_are_scipys(values):
    assert t_interval(values) == pytest.approx(
        scipy.stats.t.interval(0.95, len(values) - 1, values.mean(), scipy.stats.sem(values))
    )
    assert float(skewness(values)) == pytest.approx(float(scipy.stats.skew(values, bias=False)))


@pytest.mark.parametrize("values", SAMPLES)
def test_halls_ends_solve_his_cubic(values):
    n, lean = len(values), scipy.stats.skew(values, bias=False) / math.sqrt(len(values))
    found = []
    for quantile in (scipy.stats.t.ppf(0.975, n - 1), scipy.stats.t.ppf(0.025, n - 1)):

        def cubic(x, quantile=quantile):
            return x + lean * x**2 / 3 + lean**2 * x**3 / 27 + lean / 6 - quantile

        found.append(
            values.mean() - scipy.optimize.brentq(cubic, -1e4, 1e4) * scipy.stats.sem(values)
        )
    assert hall_interval(values) == pytest.approx(tuple(found), rel=1e-9)


def test_the_rule_moves_the_end_on_the_side_of_the_longer_tail_and_no_other():
    values = 1 - RNG.standard_exponential((200, 8))
    t, printed, lean = t_interval(values), printed_interval(values), skewness(values)
    assert (printed[0] <= t[0]).all()
    assert (printed[1] >= t[1]).all()
    left = lean < 0
    assert (printed[1] == t[1])[left].all()
    assert (printed[0] == t[0])[~left].all()
    assert (printed[0] < t[0])[left].mean() > 0.9


def test_turning_the_sample_over_turns_the_interval_over():
    values = RNG.lognormal(0, 1, (50, 12))
    low, high = printed_interval(values)
    turned = printed_interval(-values)
    assert turned[0] == pytest.approx(-high)
    assert turned[1] == pytest.approx(-low)


def test_the_guaranteed_interval_is_its_literal_twin():
    values = [0.9, 0.5, 0.7, 0.95, 0.8]
    stakes = [math.sin(math.pi * (k + 0.5) / 400) ** 2 for k in range(200)]

    def wealth(mean, shares):
        return sum(math.prod(1 + stake * (x / mean - 1) for x in shares) for stake in stakes) / len(
            stakes
        )

    low = scipy.optimize.brentq(lambda mean: wealth(mean, values) - 40, 1e-6, np.mean(values))
    high = 1 - scipy.optimize.brentq(
        lambda mean: wealth(mean, [1 - x for x in values]) - 40, 1e-6, 1 - np.mean(values)
    )
    assert guaranteed_interval(np.array(values), (0, 1)) == pytest.approx((low, high), abs=1e-6)
    ends = np.array([low - 0.01, low + 0.01, high - 0.01, high + 0.01])
    covers = guaranteed_covers(np.tile(values, (4, 1)), (0, 1), ends)
    assert covers.tolist() == [False, True, True, False]


@pytest.mark.parametrize("share", [0.02, 0.1, 0.5])
def test_the_guarantee_holds_for_what_breaks_every_other_interval(share):
    # nearly all players at the ceiling, a few at the floor: at five players most samples have no spread at all
    values = (np.random.default_rng(3).random((4000, 5)) >= share).astype(float)
    covered = guaranteed_covers(values, (0, 1), np.full(4000, 1 - share))
    assert covered.mean() >= 0.95
    t = t_interval(values)
    if share == 0.02:
        assert ((t[0] <= 1 - share) & (t[1] >= 1 - share)).mean() < 0.2


def test_scaling_the_bounds_scales_the_guaranteed_interval():
    values = np.array([0.2, 0.4, 0.9])
    low, high = guaranteed_interval(values, (0, 1))
    assert guaranteed_interval(10 * values - 3, (-3, 7)) == pytest.approx(
        (10 * low - 3, 10 * high - 3)
    )


def test_a_score_without_a_bound_has_no_guaranteed_end_on_the_other_side():
    values = np.array([1.0, 2.0, 30.0])
    low, high = guaranteed_interval(values, (0, 40))
    assert guaranteed_interval(values, (0, np.inf)) == (pytest.approx(low), np.inf)
    assert guaranteed_interval(values, (-np.inf, 40)) == (-np.inf, pytest.approx(high))
    assert estimate_of_means(values, (-np.inf, np.inf), True).interval == (-np.inf, np.inf)


def test_a_value_outside_the_bounds_is_refused():
    with pytest.raises(ValueError, match=r"values must lie in 0\.\.1"):
        guaranteed_interval(np.array([0.5, 1.2]), (0, 1))


def test_an_estimate_says_which_end_it_widened():
    values = np.array([0.95, 0.94, 0.95, 0.96, 0.3])
    found, t = estimate_of_means(values, (0, 1)), t_interval(values)
    assert found.widened == "low"
    assert found.interval[0] < t[0]
    assert found.interval[1] == min(t[1], 1)  # cut off at the bound
    assert estimate_of_means(np.array([0.4, 0.5, 0.6]), (0, 1)).widened is None


def test_players_who_are_all_alike_have_no_skewness():
    found = estimate_of_means(np.full(6, 0.3), (0, 1))
    assert found.interval == pytest.approx((0.3, 0.3))
    assert (found.skewness, found.sd) == (None, 0.0)
