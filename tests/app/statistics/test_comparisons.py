"""Variance components, crossed bootstrap and comparisons, against textbooks and literal twins."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from app.statistics.comparisons import (
    compare_policy,
    crossed_means,
    holm,
    iqm,
    iqm_interval,
    new_terrains_interval,
    permutation_p,
    player_means,
    variance_components,
)
from app.statistics.intervals import printed_interval

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


def test_crossed_means_are_their_literal_twin():
    table = uneven()
    rng = np.random.default_rng([7, 9])
    rows, cols = rng.multinomial(7, np.full(7, 1 / 7), 40), rng.multinomial(9, np.full(9, 1 / 9), 40)
    found = crossed_means(table, 40)
    for at in range(40):
        drawn = []
        for player in np.repeat(np.arange(7), rows[at]):
            own = [
                table[player, terrain] for terrain in np.repeat(np.arange(9), cols[at]) if not np.isnan(table[player, terrain])
            ]
            if own:
                drawn.append(np.mean(own))
        assert found[at] == pytest.approx(np.mean(drawn))


def test_the_crossed_bootstrap_has_owens_variance():
    # Owen 2007, theorem 2, balanced: E[bootstrap variance] is about player/P + terrain/T + 3 residual/(PT)
    rng = np.random.default_rng(2)
    seen = []
    for _ in range(60):
        table = rng.normal(0, 1, (20, 1)) + rng.normal(0, 0.7, (1, 25)) + rng.normal(0, 2, (20, 25))
        seen.append(crossed_means(table, 1500).var(ddof=1))
    expected = (1 / 20) * 19 / 20 + (0.49 / 25) * 24 / 25 + 3 * 4 / 500
    assert np.mean(seen) == pytest.approx(expected, rel=0.08)


def test_the_interval_for_new_terrains_contains_the_one_for_these():
    for seed in range(20):
        table = uneven(seed)
        low, high = new_terrains_interval(table)
        own = printed_interval(player_means(table))
        assert low <= own[0] < own[1] <= high


def test_the_iqm_drops_a_quarter_on_each_side():
    assert iqm(np.array([[0.0, 1, 2, 3], [4, 5, 6, 100]])) == pytest.approx(3.5)


def test_the_iqms_interval_is_its_literal_twin():
    table = uneven(3)
    picks = np.random.default_rng(len(table)).integers(0, len(table), (300, len(table)))
    literal = [stats.trim_mean([x for x in table[pick].ravel() if not np.isnan(x)], 0.25) for pick in picks]
    assert iqm_interval(table, 300) == pytest.approx(tuple(np.quantile(literal, [0.025, 0.975])))


def test_the_permutation_test_is_exact_for_few_terrains():
    differences = np.array([0.3, -0.1, 0.25, 0.4, 0.05, -0.02, 0.31])
    observed = abs(differences.mean())
    signs = itertools.product((-1, 1), repeat=7)
    extreme = np.mean([abs(np.mean(np.array(sign) * differences)) >= observed - 1e-12 for sign in signs])
    assert permutation_p(differences) == pytest.approx(extreme)
    assert permutation_p(np.zeros(5)) == 1
    assert permutation_p(np.array([0.2])) is None


def test_holms_adjustment():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]


def test_a_comparison_is_paired_by_terrain_and_its_intervals_follow_the_peoples():
    table = np.random.default_rng(4).normal(0.8, 0.1, (6, 8))
    values = table.mean(0) + np.array([0.1] * 7 + [-0.2])
    random = np.full(8, 0.3)
    found = compare_policy("ppo", "score", values, table, random)
    low, high = printed_interval(table.mean(1))
    people = table.mean()
    assert found.difference == pytest.approx(values.mean() - people)
    assert found.these == pytest.approx((values.mean() - high, values.mean() - low))
    assert found.new[0] <= found.these[0] <= found.these[1] <= found.new[1]
    assert found.better == 7
    assert found.ratio == pytest.approx(values.mean() / people)
    assert found.ratio_interval[0] < found.ratio < found.ratio_interval[1]
    assert found.normalized == pytest.approx((values.mean() - 0.3) / (people - 0.3))
    assert compare_policy("random", "score", random, table, random).normalized is None
    assert compare_policy("ppo", "steps", values, table, random, up=False).better == 1


def test_the_ratios_interval_covers_players_and_terrains():
    # a policy that is 0.9 of the people on every terrain: the terrains cancel, the players do not
    terrain = np.random.default_rng(5).normal(1, 0.3, 30).clip(0.2)
    players = np.array([0.9, 1.0, 1.1, 0.95, 1.05])[:, None]
    found = compare_policy("twin", "score", 0.9 * terrain, players * terrain)
    assert found.ratio == pytest.approx(0.9)
    half = stats.t.ppf(0.975, 4) * np.std(players, ddof=1) / math.sqrt(5) * math.sqrt(4 / 5)  # as a bootstrap sees it
    low, high = printed_interval((players * terrain).mean(1))
    policy = 0.9 * terrain.mean()
    wanted = min(0.9 * math.exp(-half), policy / high), max(0.9 * math.exp(half), policy / low)
    assert found.ratio_interval == pytest.approx(wanted, rel=0.01)


def test_shares_of_people_who_may_be_no_better_than_random_have_no_bounds():
    table = np.array([[0.2, 0.4, 0.3], [0.5, 0.3, 0.4], [0.1, 0.2, 0.2]])
    found = compare_policy("ppo", "score", np.array([0.9, 0.8, 0.9]), table, np.full(3, 0.25))
    assert found.normalized == pytest.approx((2.6 / 3 - 0.25) / (table.mean() - 0.25))
    assert found.normalized_interval is None
    assert compare_policy("ppo", "score", np.array([0.9, 0.8, 0.9]), table - 0.3).ratio_interval is None


def test_one_player_gives_no_intervals_and_a_mean_at_zero_no_ratio():
    table = np.array([[0.5, 0.7, 0.6]])
    found = compare_policy("ppo", "score", np.array([0.6, 0.6, 0.7]), table)
    assert (found.these, found.new, found.ratio_interval, found.normalized) == (None, None, None, None)
    assert compare_policy("ppo", "score", np.array([0.6, 0.6, 0.7]), table - 0.6).ratio is None
