"""Policies against people: one test, its intervals, and Holm's adjustment."""

import numpy as np
import pytest
import scipy

from humanplay.report.statistics.comparisons import (
    compare_policy,
    holm,
    policy_differs,
    policy_p,
    quotient_interval,
)
from humanplay.report.statistics.intervals import interval, p_value
from tests.app.statistics.test_spread import uneven

NAN = float("nan")


def test_holms_adjustment():
    studies = np.array([[0.01, 0.04, 0.03, 0.005], [0.005, 0.9, 0.8, 0.7]])
    assert holm(studies[0]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm(studies) == pytest.approx(np.array([holm(study) for study in studies]))
    assert holm(np.array([0.9, 0.8])).tolist() == [1.0, 1.0]


def test_a_comparison_is_paired_by_terrain_and_its_intervals_follow_the_peoples():
    table = np.random.default_rng(4).normal(0.8, 0.1, (6, 8))
    values = table.mean(0) + np.array([0.1] * 7 + [-0.2])
    random = np.full(8, 0.3)
    comparison = compare_policy("ppo", "score", values, table, random)
    people = table.mean()
    assert comparison.difference == pytest.approx(values.mean() - people)
    ends = interval(values - table, None)
    assert np.array(comparison.interval) == pytest.approx(np.array(ends))
    alone = compare_policy("ppo", "score", values, table, random, terrains_drawn=False).interval
    assert comparison.interval[0] <= alone[0] <= alone[1] <= comparison.interval[1]
    assert (policy_p(table, None, values) < 0.05) == (
        comparison.interval[0] > 0 or comparison.interval[1] < 0
    )
    assert comparison.ratio == pytest.approx(values.mean() / people)
    assert comparison.ratio_interval[0] < comparison.ratio < comparison.ratio_interval[1]
    assert comparison.normalized == pytest.approx((values.mean() - 0.3) / (people - 0.3))
    assert compare_policy("random", "score", random, table, random).normalized is None


def drawn(seed, players=8, terrains=12, shift=0.04):
    """A table of people on terrains, both of which differ, and a policy's values."""
    rng = np.random.default_rng(seed)
    terrain = rng.normal(0, 0.05, terrains)
    table = (
        0.8 + rng.normal(0, 0.05, (players, 1)) + terrain + rng.normal(0, 0.05, (players, terrains))
    )
    return table, 0.8 + shift + terrain + rng.normal(0, 0.03, terrains)


def compared(table, values, seed=0):
    random = 0.2 + np.random.default_rng(seed).normal(0, 0.02, len(values))
    return compare_policy("ppo", "score", values, table, random)


def test_a_p_below_5_percent_and_every_interval_that_leaves_no_difference_out_are_one_statement():
    seen = set()
    for seed in range(60):
        table, values = drawn(seed)
        comparison = compared(table, values)
        says = bool(policy_p(table, None, values) < 0.05)
        seen.add(says)
        assert (comparison.interval[0] > 0 or comparison.interval[1] < 0) == says
        assert (comparison.ratio_interval[0] > 1 or comparison.ratio_interval[1] < 1) == says
        assert (
            comparison.normalized_interval[0] > 1 or comparison.normalized_interval[1] < 1
        ) == says
    assert seen == {True, False}


def test_the_test_knows_which_players_were_drawn():
    # what sign flips over terrains cannot see: the policy is ahead by what a player differs from another, on every terrain
    rng = np.random.default_rng(9)
    player = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    table = 0.7 + player[:, None] + rng.normal(0, 0.01, (5, 20))
    comparison = compare_policy("ppo", "score", np.full(20, 0.78), table)
    flipped = scipy.stats.permutation_test(
        (0.78 - table.mean(0),),
        np.mean,
        permutation_type="samples",
        n_resamples=999,
        rng=np.random.default_rng(1),
    )
    assert flipped.pvalue < 0.01
    assert policy_p(table, None, np.full(20, 0.78)) > 0.3
    assert comparison.interval[0] < 0 < comparison.interval[1]


def test_fewer_than_five_players_have_neither_intervals_nor_p():
    four, five = drawn(1, players=4), drawn(1, players=5)
    assert np.isnan(policy_p(four[0], None, four[1]))
    assert not policy_differs(four[0], None, four[1])
    assert (compared(*four).interval, compared(*four).ratio_interval) == (None, None)
    assert 0 < policy_p(five[0], None, five[1]) < 1


def test_a_difference_is_claimed_only_where_finishers_and_everybody_who_began_both_claim_it():
    table, values = drawn(1, shift=-0.4)
    left = np.vstack([table, np.full((2, 12), -0.1)])
    finished, everybody = (float(policy_p(scores, None, values)) for scores in (table, left))
    assert finished < 0.005 < everybody
    assert policy_p(table, left, values) == everybody
    assert policy_p(left, table, values) == everybody
    assert policy_differs(table, None, values)
    assert not policy_differs(table, left, values)
    assert not policy_differs(left, table, values)


def test_estimates_that_differ_to_opposite_sides_claim_nothing():
    table, values = drawn(1, players=20, shift=-0.2)
    left = np.vstack([table, np.full((60, 12), -0.5)])
    assert policy_p(table, None, values) < 0.05
    assert policy_p(left, None, values) < 0.05
    assert policy_p(table, left, values) == 1.0
    assert policy_differs(table, None, values)
    assert not policy_differs(table, left, values)


def test_studies_are_tested_together_as_they_are_one_by_one():
    tables, values = (np.stack(arrays) for arrays in zip(*map(drawn, range(4)), strict=True))
    for drawn_too in (True, False):
        together = policy_p(tables, tables, values, 0.0, drawn_too)
        differs = policy_differs(tables, tables, values, 0.0, drawn_too)
        assert (differs == (together < 0.05)).all()
        alone = [float(policy_p(tables[i], None, values[i], 0.0, drawn_too)) for i in range(4)]
        assert together == pytest.approx(alone)


def test_a_claim_about_these_terrains_alone_takes_them_as_they_are():
    table = 0.7 + np.random.default_rng(3).normal(0, 0.02, (12, 1)) + np.zeros(12)
    values = 0.7 + np.array([0.05, 0.01] * 6) * np.repeat([1, 0, 2], 4)
    assert policy_p(table, None, values) > policy_p(table, None, values, terrains_drawn=False)


def test_gaps_are_compared_on_the_terrains_that_a_player_finished():
    # the policy is 0.1 ahead on every terrain; the second player met the easy ones only
    easy = np.array([0.9] * 3 + [0.5] * 3)
    table = np.array([easy, [0.9] * 3 + [NAN] * 3, easy, easy, easy])
    comparison = compare_policy("ppo", "score", easy + 0.1, table)
    assert comparison.difference == pytest.approx(0.1)
    assert comparison.interval == pytest.approx((0.1, 0.1))


@pytest.mark.parametrize("worst", [None, -0.5])
def test_the_quotients_interval_holds_what_the_test_keeps(worst):
    table = uneven(3)
    top = np.random.default_rng(1).normal(0.9, 0.05, table.shape[1])
    quotient, (low, high) = quotient_interval(top, table, worst)
    assert low < quotient < high

    def p(q):
        return p_value(top - q * table, None if worst is None else top - q * worst)

    for end, outwards in ((low, -1), (high, 1)):
        assert p(end) == pytest.approx(0.05, abs=1e-6)
        assert p(end + 0.01 * outwards) < 0.05 < p(end - 0.01 * outwards)


def test_the_quotients_ends_are_those_that_scipy_finds():
    generator = np.random.default_rng(12)
    for _ in range(10):
        table = generator.normal(10, 3, (6, 1)) + generator.normal(0, 4, (6, 9))
        top = generator.normal(9, 3, 9)
        quotient, (low, high) = quotient_interval(top, table)

        def end(side, top=top, table=table):
            return lambda q: float(interval(top - q * table, None)[side])

        reach = 2 * (high - low)
        ends = [
            scipy.optimize.brentq(end(1), quotient, quotient + reach, xtol=1e-13, rtol=1e-12),
            scipy.optimize.brentq(end(0), quotient - reach, quotient, xtol=1e-13, rtol=1e-12),
        ]
        assert (low, high) == pytest.approx(sorted(ends), rel=1e-10)


def test_a_policy_that_is_a_share_of_the_people_everywhere_has_that_ratio_whatever_the_terrains():
    # the terrains cancel, the players do not
    terrain = np.random.default_rng(5).normal(1, 0.3, 30).clip(0.2)
    players = np.array([0.9, 1.0, 1.1, 0.95, 1.05])[:, None]
    comparison = compare_policy("twin", "score", 0.9 * terrain, players * terrain)
    assert comparison.ratio == pytest.approx(0.9)
    # of five participants the interval is the range of their means
    assert comparison.ratio_interval == pytest.approx((0.9 / 1.1, 1.0), rel=0.02)


def test_shares_of_people_who_may_be_no_better_than_random_have_no_bounds():
    table = np.array([[0.2, 0.4, 0.3], [0.5, 0.3, 0.4], [0.1, 0.2, 0.2]] * 2)
    comparison = compare_policy("ppo", "score", np.array([0.9, 0.8, 0.9]), table, np.full(3, 0.25))
    assert (comparison.normalized, comparison.normalized_interval) == (None, None)
    assert (
        compare_policy("ppo", "score", np.array([0.9, 0.8, 0.9]), table - 0.3).ratio_interval
        is None
    )


def test_shares_of_people_who_are_surely_worse_than_random_are_not_shown():
    table = 0.2 + np.random.default_rng(2).normal(0, 0.01, (8, 3))
    comparison = compare_policy("ppo", "score", np.full(3, 0.9), table, np.full(3, 0.8))
    assert (comparison.normalized, comparison.normalized_interval) == (None, None)


def test_one_player_gives_no_intervals_and_a_mean_at_zero_no_ratio():
    table = np.array([[0.5, 0.7, 0.6]])
    comparison = compare_policy("ppo", "score", np.array([0.6, 0.6, 0.7]), table)
    assert (comparison.interval, comparison.ratio_interval, comparison.normalized) == (
        None,
        None,
        None,
    )
    assert compare_policy("ppo", "score", np.array([0.6, 0.6, 0.7]), table - 0.6).ratio is None
