"""What a study can see before it is frozen: computed power against the report's own tests in simulated studies."""

import numpy as np
import pytest
import scipy

from app.report.statistics.intervals import printed_interval
from app.report.statistics.planning import (
    derived_difference,
    difference_power,
    flat_power,
    plan_study,
)
from app.series.protocol import default_protocol
from marsexplorer.config import EnvConfig

CONFIG = EnvConfig.of("random", 21)


def protocol(**rest):
    return default_protocol("plan", CONFIG, **rest)


def test_five_steps_are_seen_by_hardly_any_flat_study_of_ten_players():
    plan = plan_study(protocol(equivalence_margin=5.0))
    assert (plan.player_sd, plan.episode_sd, plan.is_default) == (28.0, 45.0, False)
    (learning, policies) = plan.comparisons
    assert learning.power < 0.001
    assert learning.players > 100
    assert learning in plan.underpowered
    assert policies.power == pytest.approx(0.8, abs=0.05)


def test_the_power_for_a_policy_is_that_of_the_t_test_in_simulation():
    rng, players = np.random.default_rng(3), 8
    means = 1.4 + rng.standard_normal((20_000, players))
    p = scipy.stats.ttest_1samp(means, 0, axis=1).pvalue
    assert difference_power(1.0, players, 1.4, 4) == pytest.approx((p < 0.05 / 4).mean(), abs=0.01)
    low, _ = printed_interval(means[:2000], 1 - 0.05 / 4)
    assert (low > 0).mean() <= difference_power(
        1.0, players, 1.4, 4
    ) + 0.02  # the printed interval is never narrower than t's


def test_more_players_see_smaller_effects_and_one_player_sees_none():
    assert derived_difference(protocol(players=40)) < derived_difference(protocol(players=10))
    assert derived_difference(protocol(players=1)) is None
    assert (flat_power(1.0, 1, 100.0), difference_power(1.0, 1, 100.0, 1)) == (0.0, 0.0)
    plan = plan_study(protocol(players=1))
    assert (plan.half_width, {each.power for each in plan.comparisons}, {each.least for each in plan.comparisons}) == (
        None, {0.0}, {None}
    )  # fmt: skip


def test_effects_are_no_larger_than_an_episode_and_few_episodes_have_no_learning():
    tiny = protocol(players=2, ranked=2)
    assert derived_difference(tiny) == 441.0
    (policies,) = plan_study(tiny).comparisons
    assert policies.field == "policy_difference"
    assert plan_study(protocol(policies=())).comparisons == ()


def test_a_protocol_that_names_no_standard_deviations_is_planned_with_a_new_studys():
    plan = plan_study(protocol(assumed_player_sd=None, assumed_episode_sd=None))
    assert (plan.player_sd, plan.episode_sd, plan.is_default) == (28.0, 45.0, True)


def test_the_half_width_is_that_of_the_power_command():
    from app.report.statistics.planning import plan_sample_size

    plan = plan_study(protocol(players=20))
    width = next(each for each in plan_sample_size(28.0, 45.0, 1.0).table if each.players == 20)
    assert plan.half_width == (pytest.approx(width.expected), pytest.approx(width.assured))
