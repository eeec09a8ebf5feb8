"""The same terrains for all, a table that does not depend on the number of processes, intervals that are t intervals."""

import json
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from scipy import stats

from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.evaluate import evaluate, interval
from marsexplorer.policies import PolicyNotFound

CONFIG = EnvConfig("random", 7, 11, sensor_radius=3)


def test_every_policy_plays_the_same_terrains_and_progress_reaches_the_end():
    calls = []
    table = evaluate(["frontier-cost", "random"], CONFIG, 12, 40, progress=lambda done, total: calls.append((done, total)))
    assert [row.policy for row in table.rows] == ["frontier-cost", "random"]
    for name in ("frontier-cost", "random"):
        assert [result.seed for result in table.results if result.policy == name] == list(range(40, 52))
    assert calls[-1] == (24, 24)
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    rule, chance = table.rows
    assert rule.completion == 1.0
    assert rule.score_low <= rule.score_mean <= rule.score_high
    assert chance.score_mean < rule.score_mean
    assert rule.collisions == chance.collisions == 0
    assert rule.coverage_mean >= 0.99
    with pytest.raises(FrozenInstanceError):
        rule.episodes = 3


def test_the_number_of_processes_changes_nothing():
    alone = evaluate(["random", "frontier-utility"], CONFIG, 11, 3, workers=1)
    assert evaluate(["random", "frontier-utility"], CONFIG, 11, 3, workers=2) == alone
    assert evaluate(["frontier-utility"], CONFIG, 11, 3, workers=1).rows[0] == alone.rows[1]


def test_unfinished_episodes_count_the_limit():
    config = EnvConfig("random", 7, 11, sensor_radius=3, max_steps=4)
    row = evaluate(["random"], config, 5, 0, workers=1).rows[0]
    assert (row.completion, row.steps_mean, row.steps_low, row.steps_high) == (0.0, 4.0, 4.0, 4.0)


def test_json_holds_config_seeds_version_and_every_episode():
    table = evaluate(["random"], CONFIG, 3, 9, workers=1)
    document = json.loads(table.to_json())
    assert document["core_version"] == CORE_VERSION
    assert EnvConfig(**document["config"]) == CONFIG
    assert document["seeds"] == {"first": 9, "last": 11}
    assert len(document["results"]) == 3
    assert document["rows"][0]["policy"] == "random"
    assert {"policy", "seed", "outcome", "score", "steps", "steps_to_99", "coverage"} <= set(document["results"][0])


def test_the_interval_is_students():
    values = np.array([0.2, 0.5, 0.9, 0.4])
    expected = stats.t.interval(0.95, 3, values.mean(), stats.sem(values))
    assert interval(values) == pytest.approx(expected)


def test_bad_requests_are_refused_before_anything_is_played():
    with pytest.raises(PolicyNotFound):
        evaluate(["random", "nobody"], CONFIG, 3, 0)
    with pytest.raises(ValueError, match="at least one policy"):
        evaluate([], CONFIG, 3, 0)
    with pytest.raises(ValueError, match="episodes must be at least 2"):
        evaluate(["random"], CONFIG, 1, 0)
    with pytest.raises(ValueError, match="workers must be at least 1"):
        evaluate(["random"], CONFIG, 3, 0, workers=0)
    with pytest.raises(ValueError, match="seed must be at most"):
        evaluate(["random"], CONFIG, 3, 2**53 - 2)
