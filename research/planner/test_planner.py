"""The planner: deterministic, always finishes, and beats the rules in open sight."""

import numpy as np
import pytest

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from research.planner.planner import Planner, distance_weights


def steps(policy, config, seeds):
    taken = []
    for seed in seeds:
        episode = play_episode(policy, config, seed)
        assert episode.outcome == "explored", seed
        taken.append(episode.steps)
    return np.array(taken)


def test_it_explores_every_terrain_and_beats_the_rules_on_small_obstacles():
    config, seeds = EnvConfig.of("1-1-1", 21), range(6)
    planned = steps(Planner(), config, seeds)
    for rule in ("frontier-cost", "frontier-utility"):
        assert planned.mean() < steps(policies.load(rule), config, seeds).mean()


def test_grids_that_are_not_square_and_other_radii():
    steps(Planner(3), EnvConfig("random", 9, 31, sensor_radius=3), range(4))


def test_another_seed_may_plan_otherwise_and_the_same_never():
    config = EnvConfig("random", 14, 19)
    runs = []
    for seed in (1, 1, 2, 3, 4):
        episode, policy = Episode.begin(config, seed=7), Planner()
        policy.reset(seed)
        while not episode.ended:
            episode.step(policy.act(episode.codes))
        runs.append(bytes(episode.actions))
    assert runs[0] == runs[1]
    assert len(set(runs)) > 1


def test_it_goes_on_when_more_than_99_percent_is_asked_for():
    episode = Episode.begin(EnvConfig("random", 12, 17, beta=1.0), terrain=np.zeros((12, 17), bool))
    policy = Planner()
    policy.reset(0)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    assert episode.outcome == "explored"


def test_weights_are_powers_of_the_distance():
    weights = distance_weights(100)
    for k in range(9):
        assert np.allclose(weights[k][1:], np.arange(1, 101) ** (-k / 4))


def test_at_least_one_tour():
    with pytest.raises(ValueError, match="tours must be at least 1, got 0"):
        Planner(tours=0)
