"""The same terrains for all, one table for any number of processes, t intervals."""

import csv
import io
import json
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from humanplay.jobs import Jobs
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.evaluation import evaluate, horizon
from marsexplorer.evaluation.episodes import area_under_coverage
from marsexplorer.evaluation.table import compare, ratio_interval
from marsexplorer.intervals import t_interval
from marsexplorer.policies import PolicyNotFoundError
from marsexplorer.terrain import generate

CONFIG = EnvConfig("random", 7, 11, sensor_radius=3)


def test_every_policy_plays_the_same_terrains_and_progress_reaches_the_end():
    calls, names = [], ["frontier-cost", "random"]
    table = evaluate(names, CONFIG, 12, 40, progress=lambda *done: calls.append(done))
    assert [row.policy for row in table.rows] == names
    played = [(result.policy, result.seed) for result in table.results]
    assert played == [(name, seed) for name in names for seed in range(40, 52)]
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


def test_other_processes_give_the_same():
    alone = evaluate(["random", "frontier-utility"], CONFIG, 11, 3)
    with Jobs(2) as jobs:
        assert evaluate(["random", "frontier-utility"], CONFIG, 11, 3, executor=jobs) == alone
    assert evaluate(["frontier-utility"], CONFIG, 11, 3).rows[0] == alone.rows[1]


def test_configurations_of_one_level_and_size_are_compared_each_with_its_own_rule():
    configs = [replace(CONFIG, sensor_radius=radius) for radius in (2, 3)]
    names = ["random", "frontier-cost"]
    both = evaluate(names, configs, 5, 0)
    for number, config in enumerate(configs):
        alone = evaluate(names, config, 5, 0)
        assert [both.compared(row) for row in both.rows[2 * number :][:2]] == [
            *alone.comparisons,
            None,
        ]


def test_unfinished_episodes_count_the_limit():
    config = EnvConfig("random", 7, 11, sensor_radius=3, max_steps=4)
    row = evaluate(["random"], config, 5, 0).rows[0]
    assert (row.completion, row.steps_mean, row.steps_low, row.steps_high) == (0.0, 4.0, 4.0, 4.0)


def test_json_holds_config_seeds_version_and_every_episode():
    table = evaluate(["random"], CONFIG, 3, 9)
    document = json.loads(table.to_json())
    assert document["core_version"] == CORE_VERSION
    (config,) = document["configs"]
    assert (config.pop("hash"), config.pop("horizon")) == (CONFIG.hash, horizon(CONFIG))
    assert EnvConfig(**config) == CONFIG
    assert document["seeds"] == [9, 10, 11]
    assert len(document["results"]) == 3
    assert document["rows"][0]["policy"] == "random"
    wanted = {"policy", "seed", "outcome", "score", "steps", "steps_to_99", "coverage"}
    assert wanted <= set(document["results"][0])


def test_bad_requests_are_refused_before_anything_is_played():
    with pytest.raises(PolicyNotFoundError):
        evaluate(["random", "nobody"], CONFIG, 3, 0)
    with pytest.raises(ValueError, match="at least one policy"):
        evaluate([], CONFIG, 3, 0)
    with pytest.raises(ValueError, match="episodes must be at least 2"):
        evaluate(["random"], CONFIG, 1, 0)
    with pytest.raises(ValueError, match="seed must be at most"):
        evaluate(["random"], CONFIG, 3, 2**53 - 2)


def test_explicit_seeds_are_played_as_given_and_traces_hold_the_path():
    table = evaluate(["frontier-cost"], CONFIG, seeds=[17, 4, 9], traces=True)
    assert [result.seed for result in table.results] == [17, 4, 9] == list(table.seeds)
    alone = [
        evaluate(["frontier-cost"], CONFIG, seeds=[seed, 99]).results[0] for seed in (17, 4, 9)
    ]
    assert [replace(result, trace=None) for result in table.results] == alone
    for result in table.results:
        trace, terrain = result.trace, generate(CONFIG, result.seed)
        assert len(trace.discovered) == len(trace.path) == result.steps + 1
        assert trace.discovered[-1] == round(result.coverage * CONFIG.n)
        assert trace.path[0] == 0
        assert all(not terrain.flat[cell] for cell in trace.path)
        assert trace.obstacles
        assert all(terrain.flat[cell] for cell in trace.obstacles)
    for wrong, part in (([3], "at least 2"), ([3, 3], "must differ")):
        with pytest.raises(ValueError, match=part):
            evaluate(["random"], CONFIG, seeds=wrong)
    with pytest.raises(ValueError, match="either episodes"):
        evaluate(["random"], CONFIG, 3, seeds=[1, 2])


def test_the_area_under_the_curve_is_the_mean_coverage_over_the_horizon():
    config = EnvConfig("random", 5, 8)
    assert horizon(config) == 10
    assert area_under_coverage(config, [4, 8, 20], 40) == pytest.approx((8 + 9 * 20) / 10 / 40)
    whole = area_under_coverage(config, [4, *range(5, 40)], 40)
    assert whole == pytest.approx(sum(range(5, 15)) / 10 / 40)
    assert area_under_coverage(config, [4], 40) == pytest.approx(0.1)


def test_levels_and_sizes_multiply_and_a_configuration_alone_gives_the_same():
    configs = [CONFIG, EnvConfig("2-1-1", 9, 7, sensor_radius=3)]
    table = evaluate(["frontier-cost", "random"], configs, 4, 5)
    assert [(row.level, row.policy) for row in table.rows] == [
        (level, policy) for level in ("random", "2-1-1") for policy in ("frontier-cost", "random")
    ]
    alone = evaluate(["frontier-cost", "random"], configs[1], 4, 5)
    assert table.rows[2:] == alone.rows
    assert table.results[8:] == alone.results
    rows = list(csv.DictReader(io.StringIO(table.to_csv())))
    assert [float(row["steps_mean"]) for row in rows] == [row.steps_mean for row in table.rows]
    assert float(rows[1]["rule_ratio_mean"]) == table.compared(table.rows[1]).ratio_mean
    assert rows[0]["rule_reference"] == ""


def test_comparisons_are_paired_with_the_better_rule():
    def results(policy, steps):
        base = zip(evaluate(["random"], CONFIG, len(steps), 0).results, steps, strict=True)
        return [replace(one, policy=policy, steps_to_99=step) for one, step in base]

    by_policy = {
        "mine": results("mine", [8, 12, 16, 40]),
        "frontier-cost": results("frontier-cost", [10, 15, 20, 50]),
        "frontier-utility": results("frontier-utility", [11, 15, 20, 60]),
    }
    mine, other = compare(by_policy)
    assert (mine.policy, other.policy) == ("mine", "frontier-utility")
    assert mine.reference == "frontier-cost"
    # The same share of every terrain: nothing is uncertain about the ratio.
    bounds = (mine.ratio_low, mine.ratio_mean, mine.ratio_high)
    assert bounds == pytest.approx((0.8, 0.8, 0.8))
    differences = np.array([-2.0, -3, -4, -10])
    assert mine.difference_mean == differences.mean()
    assert (mine.difference_low, mine.difference_high) == pytest.approx(t_interval(differences))


def test_the_ratio_s_interval_covers_the_truth_as_often_as_it_says():
    rng, hits = np.random.default_rng(0), 0
    for _ in range(1000):
        references = rng.gamma(40, 2, 60)
        values = 0.9 * references + rng.normal(0, 5, 60)
        _, low, high = ratio_interval(values, references)
        hits += low <= 0.9 <= high
    assert 930 <= hits <= 970
