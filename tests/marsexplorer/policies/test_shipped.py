"""The shipped policies do as their cards say, and the network is worth it."""

import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate
from marsexplorer.policies.files.card import read_card, shipped
from marsexplorer.training.envs import EVALUATION_SEEDS

NAMES = ["ppo", "frontier-cost", "frontier-utility"]


@pytest.mark.parametrize("name", sorted(shipped()))
def test_a_card_says_what_a_policy_is_and_where_it_comes_from(name):
    card = read_card(shipped()[name])
    assert all(
        card[key] for key in ("summary", "command", "commit", "hardware", "limits", "training")
    )


def test_the_shipped_network_explores_everything_without_a_collision_and_in_fewer_steps_than_any_rule():
    ppo, *rules = evaluate(NAMES, EnvConfig(), 100, EVALUATION_SEEDS.start).rows
    assert (ppo.completion, ppo.collisions) == (1.0, 0)
    assert ppo.steps_mean < 0.9 * min(rule.steps_mean for rule in rules)


def test_at_42x42_the_shipped_network_needs_a_tenth_less_than_either_frontier_rule():
    rows = evaluate(NAMES, EnvConfig.of("random", 42), 4, EVALUATION_SEEDS.start).rows
    ppo, *rules = (row.steps_mean for row in rows)
    assert ppo < 0.9 * min(rules)
