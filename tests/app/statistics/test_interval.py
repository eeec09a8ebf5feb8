"""The one interval of a mean over participants and terrains, and its p."""

import math

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from humanplay.report.statistics.intervals import (
    differs_from_zero,
    estimate,
    interval,
    p_value,
)
from marsexplorer.intervals import FEWEST

NAN = float("nan")
LOW, HIGH = 0.0, 400.0


@st.composite
def tables(draw, gaps=True):
    """Draw a table of steps, with kinds of participants and failures.

    More steps are worse.
    """
    participants, terrains = draw(st.integers(FEWEST, 12)), draw(st.integers(FEWEST, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spreads = [draw(st.sampled_from([0.0, 0.5, 20.0])) for _ in range(3)]
    shapes = (participants, 1), (1, terrains), (participants, terrains)
    parts = zip(spreads, shapes, strict=True)
    table = 90 + sum(spread * rng.standard_exponential(shape) for spread, shape in parts)
    failed = rng.random(table.shape) < draw(st.sampled_from([0.0, 0.003, 0.1]))
    table = np.clip(np.where(failed, HIGH, table), LOW, HIGH)
    if gaps and draw(st.booleans()):
        is_gap = rng.random(table.shape) < 0.3
        is_gap[np.arange(participants), rng.integers(0, terrains, participants)] = False
        table = np.where(is_gap, NAN, table)
    return table


def with_a_worse_episode(table, place, share):
    """The table with one episode moved towards the worst value by a share of the way."""
    cells = np.argwhere(~np.isnan(table))
    row, column = cells[place % len(cells)]
    worse = table.copy()
    worse[row, column] += share * (HIGH - table[row, column])
    return worse, row


@settings(max_examples=300, deadline=None)
@given(tables(), st.integers(0, 10**6), st.floats(0.001, 1), st.booleans(), st.booleans())
def test_a_worse_episode_moves_no_end_towards_better(table, place, share, is_declared, drawn):
    worse, _ = with_a_worse_episode(table, place, share)
    worst = HIGH if is_declared else None
    before, after = interval(table, worst, drawn), interval(worse, worst, drawn)
    assert after[0] >= before[0] - 1e-7
    assert after[1] >= before[1] - 1e-7


@settings(max_examples=300, deadline=None)
@given(tables(gaps=False), st.integers(0, 10**6), st.floats(0.001, 1), st.booleans())
def test_one_episode_moves_an_end_by_no_more_than_its_participants_mean(table, place, share, drawn):
    worse, row = with_a_worse_episode(table, place, share)
    moved = worse[row].mean() - table[row].mean()
    before, after = interval(table, HIGH, drawn), interval(worse, HIGH, drawn)
    assert after[0] - before[0] <= moved + 1e-7
    assert after[1] - before[1] <= moved + 1e-7


@settings(max_examples=100, deadline=None)
@given(tables(), st.integers(0, 10**6), st.floats(0.001, 1), st.floats(20, 300))
def test_a_worse_episode_speaks_for_the_policy(table, place, share, policy):
    """Of policy minus people, p falls where the policy is ahead and rises elsewhere."""
    worse, _ = with_a_worse_episode(table, place, share)
    before, after = (p_value(policy - scores, policy - HIGH) for scores in (table, worse))
    if policy < np.nanmean(table, 1).mean():
        assert after <= before + 1e-6
    elif policy > np.nanmean(worse, 1).mean():
        assert after >= before - 1e-6


@settings(max_examples=50, deadline=None)
@given(tables(), st.integers(0, 2**32 - 1))
def test_the_order_of_participants_and_terrains_changes_nothing(table, seed):
    rng = np.random.default_rng(seed)
    other = rng.permutation(rng.permutation(table, 0), 1)
    assert np.array(interval(other, HIGH)) == pytest.approx(
        np.array(interval(table, HIGH)), abs=1e-6
    )
    assert p_value(other - 95, HIGH - 95) == pytest.approx(p_value(table - 95, HIGH - 95), abs=1e-6)


@pytest.mark.parametrize("terrains_drawn", [True, False])
@pytest.mark.parametrize("participants", [5, 8, 20])
def test_p_is_below_5_percent_exactly_where_the_interval_leaves_0_out(terrains_drawn, participants):
    rng = np.random.default_rng(6)
    shapes = (400, participants, 1), (400, 1, 9), (400, participants, 9)
    drawn = 0.6 + sum(rng.normal(0, 1, shape) for shape in shapes)
    low, high = interval(drawn, -3.0, terrains_drawn)
    outside = (low > 0) | (high < 0)
    assert 0.01 < outside.mean() < 0.95
    assert ((p_value(drawn, -3.0, terrains_drawn) < 0.05) == outside).all()
    assert (differs_from_zero(drawn, -3.0, terrains_drawn) == outside).all()


def test_studies_are_worked_on_together_as_one_by_one_whoever_is_missing():
    rng = np.random.default_rng(3)
    studies = rng.normal(0.5, 1, (12, 9, 7))
    studies[rng.random(studies.shape) < 0.2] = NAN
    for study in range(12):
        studies[study, rng.permutation(9)[: study % 6]] = NAN
    worst = rng.normal(-5, 1, (12, 7))
    low, high = interval(studies, worst)
    p = p_value(studies, worst)
    for study, table in enumerate(studies):
        table = table[~np.isnan(table).all(1)]
        if len(table) < FEWEST:
            assert np.isnan([low[study], high[study], p[study]]).all()
            continue
        assert interval(table, worst[study]) == pytest.approx((low[study], high[study]))
        assert p_value(table, worst[study]) == pytest.approx(p[study])


def lowest_of(values, radius):
    """The lowest mean within a radius, by bisection of the gap below the least value."""
    near, far = -40.0, 40.0
    if radius == math.inf:
        return float(values.min())
    for _ in range(200):
        middle = (near + far) / 2
        weights = 1 / (values - values.min() + math.exp(middle))
        weights /= weights.sum()
        if -np.log(len(values) * weights).sum() > radius:
            near = middle
        else:
            far = middle
    return float(weights @ values)


def radius_of(count, reach):
    """Return the radius whose lowest mean of normal scores is -reach."""
    scores = scipy.stats.norm.ppf((np.arange(1, count + 1) - 3 / 8) / (count + 1 / 4))
    if reach >= -scores[0]:
        return math.inf
    return scipy.optimize.brentq(lambda radius: lowest_of(scores, radius) + reach, 1e-9, 300)


def level_of(table):
    """Return the level at which the low end of a table is 0."""
    return scipy.optimize.brentq(lambda level: low_of(table, level), 0.004, 0.4)


def low_of(table, level):
    """Return the low end of a table without gaps from its definition."""
    ends = []
    for stretch in (1, math.sqrt(2)):
        for values in (table.mean(1), table.mean(0)):
            count = len(values)
            reach = stretch * scipy.stats.t.isf(level, count - 1) / math.sqrt(count)
            ends.append(lowest_of(values, radius_of(count, reach)))
    return min(ends[0], ends[1], (ends[2] + ends[3]) / 2)


def test_an_independent_computation_finds_the_same_interval_and_p():
    rng = np.random.default_rng(8)
    table = 120 + 25 * rng.exponential(1, (9, 1)) + 40 * rng.standard_normal((9, 14))
    table += 15 * rng.standard_normal(14)
    table[2, 3] = HIGH
    seen = table + 0.25 / 9 * (HIGH - table)
    wanted = low_of(table, 0.025), -low_of(-seen, 0.025)
    assert interval(table, HIGH) == pytest.approx(wanted, abs=1e-6)
    for policy in (120.0, 190.0):
        ahead = table - policy if policy == 120 else policy - seen
        p = float(p_value(policy - table, policy - HIGH))
        assert p == pytest.approx(2 * level_of(ahead), rel=0.01)


def test_on_normal_scores_the_interval_is_students():
    scores = scipy.stats.norm.ppf((np.arange(1, 13) - 3 / 8) / 12.25)
    half = scipy.stats.t.isf(0.025, 11) / math.sqrt(12)
    ends = interval(scores[:, None], None, terrains_drawn=False)
    assert ends == pytest.approx((-half, half))


def test_one_failure_moves_the_ends_by_no_more_than_it_moves_the_mean_and_leaves_p():
    rng = np.random.default_rng(1)
    table = 90 + 5 * rng.standard_normal((10, 1)) + 10 * rng.standard_normal((10, 30))
    failed = table.copy()
    failed[4, 7] = HIGH
    moved = (HIGH - table[4, 7]) / 30
    before, after = interval(table, HIGH), interval(failed, HIGH)
    assert (after[1] - after[0]) - (before[1] - before[0]) < moved
    assert p_value(60 - failed, 60 - HIGH) <= p_value(60 - table, 60 - HIGH) < 0.002


@pytest.mark.parametrize("participants", [5, 7, 10, 12])
def test_p_is_no_lower_than_the_chance_that_all_are_on_one_side(participants):
    assert p_value(np.full((participants, 6), 0.2), -1.0) == 2.0**-participants
    assert p_value(np.zeros((participants, 6)), None) == 1


def test_fewer_than_five_participants_give_neither_interval_nor_p():
    table = np.random.default_rng(1).random((4, 6))
    assert np.isnan(interval(table, 0.0)).all()
    assert np.isnan(p_value(table, 0.0))
    assert estimate(table, (0.0, 1.0), 0.0).interval is None


def test_an_estimate_is_cut_off_at_the_bounds():
    table = np.array([[0.9, 1.0], [1.0, 1.0], [0.8, 0.9], [1.0, 1.0], [1.0, 0.9]])
    estimated = estimate(table, (0.0, 1.0), 0.0, terrains_drawn=False)
    assert estimated.mean == pytest.approx(table.mean())
    assert estimated.interval[1] <= 1.0
