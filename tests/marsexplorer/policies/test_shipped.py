"""The shipped policy is what its card says."""

from functools import cache

import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate
from marsexplorer.policies.files.card import read_card, shipped
from marsexplorer.training.envs import EVALUATION_SEEDS


@pytest.fixture(scope="module")
def hundred_terrains():
    """`hundred_terrains(name)` is a policy's row over 100 held-out terrains, evaluated once."""
    return cache(lambda name: evaluate([name], EnvConfig(), 100, EVALUATION_SEEDS.start).rows[0])


@pytest.mark.parametrize("name", sorted(shipped()))
def test_a_shipped_policy_does_what_its_card_says_on_a_hundred_terrains(name, hundred_terrains):
    card = read_card(shipped()[name])
    assert all(
        card[key] for key in ("summary", "command", "commit", "hardware", "limits", "training")
    )
    results = card["results"]["random 21x21"]
    row = hundred_terrains(name)
    assert row.steps_low <= results["steps"] <= row.steps_high


def test_the_shipped_network_explores_everything_without_a_collision_and_in_fewer_steps_than_any_rule(
    hundred_terrains,
):
    ppo, *rules = (hundred_terrains(name) for name in ("ppo", "frontier-cost", "frontier-utility"))
    assert (ppo.completion, ppo.collisions) == (1.0, 0)
    assert ppo.steps_mean < 0.9 * min(rule.steps_mean for rule in rules)


def test_at_42x42_the_shipped_network_needs_a_tenth_less_than_either_frontier_rule():
    names = ["ppo", "frontier-cost", "frontier-utility"]
    board, first = EnvConfig.of("random", 42), EVALUATION_SEEDS.start
    rows = evaluate(names, board, 4, first).rows
    ppo, *rules = (row.steps_mean for row in rows)

    assert ppo < 0.9 * min(rules)
