"""The shipped policy is what its card says."""

import time
from functools import cache
from statistics import median

import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation import evaluate
from marsexplorer.policies import load, names
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


def test_the_shipped_network_is_offered_first():
    assert names()[0] == "ppo"


def test_a_move_of_the_network_takes_under_two_milliseconds():
    policy, episode = load("ppo"), Episode.begin(EnvConfig(), seed=EVALUATION_SEEDS.start)
    policy.reset(0)
    for _ in range(10):
        episode.step(policy.act(episode.codes))
    spent = []
    while not episode.ended:
        began = time.thread_time()
        episode.step(policy.act(episode.codes))
        spent.append(time.thread_time() - began)
    assert median(spent) < 0.002
