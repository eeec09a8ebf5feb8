"""How many players: the formula against simulation, and what it refuses."""

import numpy as np
import pytest
import scipy

from app.report.statistics.planning import plan_sample_size, spread_of
from tests.support.made_studies import played, study


def test_the_fewest_players_reach_the_half_width_and_one_less_does_not():
    plan = plan_sample_size(0.05, 0.1, 0.03)
    assert plan.mean_sd == pytest.approx((0.05**2 + 0.1**2 / 30) ** 0.5)
    widths = {width.players: width for width in plan.table}
    assert widths[plan.players].expected <= 0.03
    assert plan_sample_size(0.05, 0.1, widths[plan.players].expected * 0.999).players > plan.players
    assert plan.assured > plan.players
    assert widths[plan.assured].assured <= 0.03


def test_the_expected_and_the_assured_width_are_what_simulation_finds():
    plan = plan_sample_size(1.0, 0.0, 0.5, ranked=1, assurance=0.8)
    width = next(width for width in plan.table if width.players == 10)
    sds = np.random.default_rng(1).standard_normal((40_000, 10)).std(1, ddof=1)
    halves = scipy.stats.t.ppf(0.975, 9) * sds / np.sqrt(10)
    assert halves.mean() == pytest.approx(width.expected, rel=0.005)
    assert np.mean(halves <= width.assured) == pytest.approx(0.8, abs=0.01)


def test_episodes_do_not_make_up_for_players():
    many, few = (
        plan_sample_size(0.05, 0.1, 0.01, ranked=1000),
        plan_sample_size(0.05, 0.1, 0.01, ranked=30),
    )
    floor = plan_sample_size(0.05, 0.0, 0.01).players
    assert floor <= many.players <= floor + 1
    assert many.players < few.players < 1.2 * floor


def test_a_width_out_of_reach_has_no_number():
    assert plan_sample_size(1.0, 1.0, 0.001).players is None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ((-1, 1, 1), "at least 0"),
        ((0, 0, 1), "one above 0"),
        ((1, 1, 0), "half-width must be above 0"),
        ((1, 1, float("nan")), "above 0"),
    ],
)
def test_what_cannot_be_is_refused(given, said):
    with pytest.raises(ValueError, match=said):
        plan_sample_size(*given)
    with pytest.raises(ValueError, match="assurance"):
        plan_sample_size(1, 1, 1, assurance=1.0)


def test_a_studys_own_spread_is_a_plan_for_the_next():
    rng = np.random.default_rng(2)
    scores = np.clip(
        0.8 + 0.05 * rng.standard_normal((30, 1)) + 0.08 * rng.standard_normal((30, 6)), 0, 1
    )
    between, within = spread_of(study(*played(scores)))
    assert between == pytest.approx(0.05, rel=0.4)
    assert within == pytest.approx(0.08, rel=0.15)
    with pytest.raises(ValueError, match="too few players"):
        spread_of(study(*played(scores[:1])))
