"""The spread of a table, against textbooks and literal twins."""

import numpy as np
import pytest
import scipy

from humanplay.report.statistics.intervals import interval
from humanplay.report.statistics.spread import iqm, iqm_interval, iqm_shares, variance_components

SHROUT_FLEISS = np.array(
    [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float
)
"""Shrout and Fleiss 1979, table 2: between mean square 11.24, within 6.26, ICC(1,1) = 0.17."""
NAN = float("nan")


def uneven(seed=1, players=7, terrains=9):
    rng = np.random.default_rng(seed)
    table = rng.normal(0.8, 0.1, (players, 1)) + rng.normal(0, 0.1, (players, terrains))
    table[rng.random(table.shape) < 0.25] = NAN
    return table


def test_the_icc_of_shrout_and_fleiss():
    components = variance_components(SHROUT_FLEISS)
    assert components.icc == pytest.approx(0.2898, abs=5e-5)
    assert components.rest_sd**2 == pytest.approx(1.0194, abs=5e-5)
    assert components.between_sd**2 == pytest.approx((11.2417 - 1.0194) / 4, abs=5e-5)
    assert components.terrain_sd**2 == pytest.approx((32.4861 - 1.0194) / 6, abs=5e-5)
    assert (components.n0, components.players, components.episodes) == (4, 6, 24)
    # the interval that McGraw and Wong 1996 and the R package psych give for these data
    assert components.icc_interval == pytest.approx((0.0188, 0.7611), abs=5e-4)


def test_the_design_effect_is_what_pooling_leaves_out_of_the_variance():
    components = variance_components(SHROUT_FLEISS)
    total = components.between_sd**2 + components.terrain_sd**2 + components.rest_sd**2
    truth = components.between_sd**2 / 6 + components.rest_sd**2 / 24
    assert components.design_effect == pytest.approx(truth / (total / 24))


def test_the_components_have_the_intervals_of_williams_and_chi_squared():
    n, p = 4, 6  # terrains, players
    means = SHROUT_FLEISS.mean()
    of_players = n * ((SHROUT_FLEISS.mean(1) - means) ** 2).sum() / (p - 1)
    of_terrains = p * ((SHROUT_FLEISS.mean(0) - means) ** 2).sum() / (n - 1)
    left = SHROUT_FLEISS - SHROUT_FLEISS.mean(1, keepdims=True) - SHROUT_FLEISS.mean(0) + means
    freedom = (p - 1) * (n - 1)
    rest = (left**2).sum() / freedom
    components = variance_components(SHROUT_FLEISS)
    chi2, f = scipy.stats.chi2.ppf, scipy.stats.f.ppf
    for ends, square, divisor, degrees in (
        (components.between_interval, of_players, n, p - 1),
        (components.terrain_interval, of_terrains, p, n - 1),
    ):
        wanted = [
            max(
                0, (square - rest * f(q, degrees, freedom)) * degrees / (divisor * chi2(q, degrees))
            )
            ** 0.5
            for q in (0.975, 0.025)
        ]
        assert ends == pytest.approx(wanted)
    assert components.rest_interval == pytest.approx(
        [(rest * freedom / chi2(q, freedom)) ** 0.5 for q in (0.975, 0.025)]
    )


def test_the_intervals_of_the_components_cover_what_was_drawn():
    rng = np.random.default_rng(6)
    sds, shape = (0.6, 1.0, 1.4), (1000, 10, 20)
    tables = sum(
        sd * rng.standard_normal(size)
        for sd, size in zip(sds, ((1000, 10, 1), (1000, 1, 20), shape), strict=True)
    )
    player, terrain, rest = np.square(sds)
    truth = (*sds, (20 * player + rest) / (player + terrain + rest))
    held = np.zeros(4)
    for table in tables:
        components = variance_components(table)
        ends = (components.between_interval, components.terrain_interval, components.rest_interval)
        for at, (low, high) in enumerate((*ends, components.design_effect_interval)):
            held[at] += low <= truth[at] <= high
    assert (held / 1000 > 0.93).all(), held
    assert (held / 1000 < 0.99).all(), held


def one_way_icc(table):
    """The ICC of the one-way analysis of variance, where terrains are only noise."""
    of_players = table.shape[1] * table.mean(1).var(ddof=1)
    within = table.var(axis=1, ddof=1).mean()
    return (of_players - within) / (of_players + (table.shape[1] - 1) * within)


def test_the_icc_is_unbiased_where_players_share_their_terrains():
    rng = np.random.default_rng(3)
    shares = np.sqrt([0.05, 0.4, 0.55])
    shape = (1200, 10, 30)
    parts = (
        rng.standard_normal((1200, 10, 1)),
        rng.standard_normal((1200, 1, 30)),
        rng.standard_normal(shape),
    )
    tables = sum(share * part for share, part in zip(shares, parts, strict=True))
    studies = [variance_components(table) for table in tables]
    assert np.mean([components.icc for components in studies]) == pytest.approx(0.05, abs=0.003)
    assert np.mean([one_way_icc(table) for table in tables]) < 0.04, "biased low, as it was before"
    covered = np.mean(
        [components.icc_interval[0] <= 0.05 <= components.icc_interval[1] for components in studies]
    )
    assert covered == pytest.approx(0.95, abs=0.02)


def test_gaps_leave_the_icc_near_the_truth():
    rng = np.random.default_rng(4)
    studies = []
    for _ in range(400):
        table = rng.normal(0, 1, (10, 1)) + rng.normal(0, 1, (1, 12)) + rng.normal(0, 1.4, (10, 12))
        table[rng.random(table.shape) < 0.2] = NAN
        studies.append(variance_components(table))
    assert np.mean([components.icc for components in studies]) == pytest.approx(1 / 3.96, abs=0.02)
    assert (
        np.mean(
            [
                components.icc_interval[0] <= 1 / 3.96 <= components.icc_interval[1]
                for components in studies
            ]
        )
        > 0.92
    )
    sizes = (~np.isnan(table)).sum(1)
    assert studies[-1].n0 == pytest.approx((sizes.sum() - (sizes**2).sum() / sizes.sum()) / 9)


def test_players_more_alike_than_chance_have_a_negative_icc_and_no_spread_between():
    components = variance_components(np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]]))
    assert components.icc < 0
    assert (components.between_sd, components.design_effect) == (0, 1)


@pytest.mark.parametrize(
    "table", [np.ones((1, 5)), np.array([[1.0, NAN], [NAN, 2.0]]), np.ones((4, 3))]
)
def test_no_components_without_two_players_two_episodes_or_a_spread(table):
    assert variance_components(table) is None


def test_the_iqm_drops_a_quarter_on_each_side():
    assert iqm(np.array([[0.0, 1, 2, 3], [4, 5, 6, 100]])) == pytest.approx(3.5)


def test_the_iqms_interval_is_that_of_the_players_shares_in_it():
    table = uneven(3)
    values = np.sort(table[~np.isnan(table)])
    cut = len(values) // 4
    low, high = values[cut], values[-cut - 1]
    winsorised = np.clip(values, low, high).mean()
    shares = [
        iqm(table)
        + 2
        * len(table)
        * sum(np.clip(value, low, high) - winsorised for value in row if not np.isnan(value))
        / len(values)
        for row in table
    ]
    assert iqm_shares(table) == pytest.approx(shares)
    assert np.mean(shares) == pytest.approx(iqm(table))
    ends = interval(np.array(shares)[:, None], None, terrains_drawn=False)
    assert iqm_interval(table) == pytest.approx(tuple(map(float, ends)))
    assert iqm_shares(np.stack([table, table + 1]))[1] == pytest.approx(np.array(shares) + 1)
