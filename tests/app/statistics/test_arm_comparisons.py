"""Arms compared: people nested in arms, terrains crossed with them."""

import numpy as np
import pytest

from humanplay.report.statistics.arm_comparisons import arm_p, compare_arms, difference_of
from humanplay.report.statistics.comparisons import holm
from humanplay.report.statistics.planning import StudyDesign, simulate_arm_power

NAN = float("nan")


def arms(studies, people, terrain_sd, apart=0.0, seed=0):
    """Two arms of simulated studies on 12 terrains, the first one ahead by `apart`."""
    rng = np.random.default_rng(seed)
    hard = 3 * rng.standard_normal((studies, 1, 12))
    tables = [
        hard + rng.standard_normal((studies, count, 1)) + rng.standard_normal((studies, count, 12))
        for count in people
    ]
    return tables[0] + apart + terrain_sd * rng.standard_normal((studies, 1, 12)), tables[1]


@pytest.mark.parametrize("people", [(5, 5), (6, 14)])
@pytest.mark.parametrize("terrain_sd", [0.0, 2.0])
def test_the_interval_holds_the_truth_in_about_95_of_100_studies(people, terrain_sd):
    low, high = difference_of(*arms(2000, people, terrain_sd, apart=1.0)).interval
    assert 0.925 < ((low <= 1) & (high >= 1)).mean() < 0.985


def test_an_interval_for_these_terrains_alone_misses_that_of_others():
    low, high = difference_of(*arms(2000, (10, 10), 2.0), terrains_drawn=False).interval
    assert ((low <= 0) & (high >= 0)).mean() < 0.85


def test_p_is_below_5_percent_exactly_if_the_interval_leaves_0_out():
    difference = difference_of(*arms(500, (6, 8), 0.5, apart=1.0))
    low, high = difference.interval
    assert ((difference.p_value < 0.05) == ((low > 0) | (high < 0))).all()
    assert 0.1 < (difference.p_value < 0.05).mean() < 0.9


def test_how_hard_a_terrain_is_leaves_the_difference_and_gaps_may_be():
    one, other = (table[0] for table in arms(1, (6, 7), 0.5))
    plain = difference_of(one, other)
    harder = difference_of(one + 50.0 * np.arange(12), other + 50.0 * np.arange(12))
    assert harder.mean == pytest.approx(plain.mean)
    assert harder.variance == pytest.approx(plain.variance)
    one[0, 3] = NAN
    with_gap = difference_of(one, other)
    assert with_gap.variance == pytest.approx(plain.variance, rel=0.1)
    assert with_gap.variance != plain.variance
    alone = difference_of(one, other, terrains_drawn=False)
    assert alone.mean == with_gap.mean
    assert alone.variance < with_gap.variance


def test_both_estimates_must_show_a_difference_and_pairs_are_adjusted_together():
    one, other = (table[0] for table in arms(1, (8, 8), 0.0, apart=3.0))
    ahead, behind = arm_p((one, other), None), arm_p((one, other), (other, one))
    assert ahead < 0.01
    assert behind == 1.0
    tables = {"a": one, "b": other, "c": other + 0.1}
    rows = compare_arms("score", tables, tables, is_tested=True)
    assert [(row.arm, row.other) for row in rows] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert rows[0].p_value == pytest.approx(ahead)
    adjusted = holm(np.array([row.p_value for row in rows]))
    assert [row.p_adjusted for row in rows] == pytest.approx(adjusted)
    assert all(row.p_value is None for row in compare_arms("score", tables, tables, False))


def test_few_people_have_a_difference_without_an_interval_and_nobody_has_none():
    one, other = (table[0] for table in arms(1, (4, 8), 0.0))
    (row,) = compare_arms("score", {"a": one, "b": other}, None, is_tested=True)
    assert row.difference == pytest.approx(one.mean() - other.mean())
    assert (row.interval, row.p_value, row.everybody) == (None, None, None)
    (row,) = compare_arms("score", {"a": one[:0], "b": other}, None, is_tested=True)
    assert (row.difference, row.interval) == (None, None)


def test_power_is_that_of_the_report_and_grows_with_people_and_difference():
    design = StudyDesign(
        participants=20, terrains=12, mean=100, player_sd=20, terrain_sd=0, episode_sd=30,
        failed_share=0.0, leaver_share=0.0, bounds=(1, 400), worst=400, policies=0,
    )  # fmt: skip
    few, many = (simulate_arm_power(design, 2, apart, 1000) for apart in (5, 30))
    assert few < 0.3 < 0.7 < many
    assert simulate_arm_power(design, 2, 1e-9, 1000) < 0.08
    assert simulate_arm_power(design, 3, 30, 1000) < many
    assert simulate_arm_power(design, 5, 30, 1000) == 0.0, "four people in an arm are too few"


def test_few_terrains_have_no_interval_for_others():
    one, other = (table[0, :, :4] for table in arms(1, (8, 8), 0.0))
    for terrains_drawn in (True, False):
        (row,) = compare_arms("score", {"a": one, "b": other}, None, True, terrains_drawn)
        assert (row.interval is None, row.p_value is None) == (terrains_drawn, terrains_drawn)
