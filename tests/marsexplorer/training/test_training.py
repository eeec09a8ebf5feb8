"""Training: small, deterministic, interruptible, and better than chance."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy import stats

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load
from marsexplorer.training import ppo
from marsexplorer.training.config import RECIPES, stacks
from marsexplorer.training.envs import EVALUATION_SEEDS, Boards, in_moves, matrix
from marsexplorer.training.ppo import Rollout, Run, advantages
from marsexplorer.training.run_folder import Logbook

SMALL = EnvConfig(rows=9, cols=12)
QUICK = replace(RECIPES["best"], boards=32, horizon=32, minibatch=256, value_updates=1)
PAPER = replace(RECIPES["paper"], boards=8, horizon=16, minibatch=64, epochs=2)


def silent(*_):
    pass


def trained(steps, seed=0, recipe=QUICK, configs=(SMALL,), tell=silent):
    run = Run.begin(recipe, list(configs), steps, seed)
    ppo.train(run, tell)
    return run


def score_of(policy, seed):
    episode = Episode.begin(SMALL, seed=seed)
    policy.reset(seed)
    while not episode.ended:
        episode.step(policy.act(episode.observation()))
    return episode.score


def same_weights(one, two):
    return all(torch.equal(a, b) for a, b in zip(one.state_dict().values(), two.state_dict().values(), strict=True))


def test_a_tiny_policy_beats_random_on_fifty_terrains(tmp_path):
    run = Run.begin(QUICK, [SMALL], 40 * 1024, 0)
    book = Logbook(tmp_path / "tiny", run, {"summary": "a tiny one"}, silent)
    ppo.train(run, book.heard)
    book.keep()
    tiny, chance = load(book.policy), load("random")
    gap = np.array([score_of(tiny, seed) - score_of(chance, seed) for seed in EVALUATION_SEEDS[:50]])
    low, _ = stats.t.interval(0.95, len(gap) - 1, gap.mean(), stats.sem(gap))
    assert low > 0
    found = {path.name.split(".")[0] for path in book.folder.iterdir()}
    assert found == {"tiny", "checkpoint", "log", "curve", "events"}
    lines = [json.loads(line) for line in (book.folder / "log.jsonl").read_text().splitlines()]
    assert [line["moves"] for line in lines] == [1024 * (k + 1) for k in range(40)]
    assert lines[-1]["greedy"] < lines[1]["greedy"]


@pytest.mark.parametrize("recipe", [QUICK, PAPER], ids=["best", "paper"])
def test_the_same_seed_gives_the_same_weights_and_another_seed_others(recipe):
    steps = 3 * recipe.boards * recipe.horizon
    assert same_weights(trained(steps, 3, recipe).net, trained(steps, 3, recipe).net)
    assert not same_weights(trained(steps, 3, recipe).net, trained(steps, 4, recipe).net)


@pytest.mark.parametrize("recipe", [QUICK, PAPER], ids=["best", "paper"])
def test_a_run_that_was_stopped_goes_on_to_the_same_weights(tmp_path, recipe):
    configs, steps = [EnvConfig(rows=9, cols=12, max_steps=20)], 6 * recipe.boards * recipe.horizon
    whole = trained(steps, 5, recipe, configs)

    def stop(report, _):
        if report.moves >= steps // 2:
            raise KeyboardInterrupt

    first = Run.begin(recipe, configs, steps, 5)
    book = Logbook(tmp_path, first, {"summary": "stopped"}, stop)
    with pytest.raises(KeyboardInterrupt):
        ppo.train(first, book.heard)
    book.keep()
    torch.rand(7)
    second = Run.begin(recipe, configs, steps, 5)
    book = Logbook(tmp_path, second, {"summary": "resumed", "size": [9, 12]}, silent)
    book.resume()
    assert second.done == 3
    ppo.train(second, book.heard)
    book.keep()
    assert same_weights(second.net, whole.net)
    assert len((tmp_path / "log.jsonl").read_text().splitlines()) == 6
    episode = Episode.begin(configs[0], seed=1)
    policy = load(book.policy)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    assert set(policy.thought()[0]) != {0.25}


def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    run = Run.begin(QUICK, [SMALL], 1024, 0)
    book = Logbook(tmp_path, run, {"summary": "one"}, silent)
    with pytest.raises(ValueError, match="no checkpoint"):
        book.resume()
    book.keep()
    for seed, steps, word in ((1, 1024, "seed"), (0, 4096, "updates")):
        other = Logbook(tmp_path, Run.begin(QUICK, [SMALL], steps, seed), {}, silent)
        with pytest.raises(ValueError, match=f"another run .*{word}"):
            other.resume()


def test_advantages_are_the_slow_sum_of_discounted_surprises():
    torch.manual_seed(0)
    recipe, gamma, lam = replace(QUICK, horizon=7, boards=3), 0.97, 0.9
    rollout, after = Rollout.room(recipe, (torch.zeros(3, 1),)), torch.rand(3)
    rollout.rewards, rollout.values = torch.rand(7, 3), torch.rand(7, 3)
    rollout.ended = (torch.rand(7, 3) < 0.3).float()
    found = advantages(rollout, after, gamma, lam)
    for board in range(3):
        for t in range(7):
            total, weight = 0.0, 1.0
            for k in range(t, 7):
                goes_on = 1 - float(rollout.ended[k, board])
                following = float(after[board] if k == 6 else rollout.values[k + 1, board])
                total += weight * (
                    float(rollout.rewards[k, board]) + gamma * following * goes_on - float(rollout.values[k, board])
                )
                weight *= gamma * lam * goes_on
            assert float(found[t, board]) == pytest.approx(total, abs=1e-5)


def test_rewards_told_in_moves_are_a_cost_of_one_and_a_share_for_each_new_cell():
    boards = Boards(SMALL, 16, 3)
    rng, explored = np.random.default_rng(0), 0
    policies = [load("frontier-cost") for _ in range(16)]
    for policy in policies:
        policy.reset(0)
    for _ in range(60):
        known = (boards.codes != 0).sum((1, 2))
        actions = np.array([policy.act(codes.copy()) for policy, codes in zip(policies, boards.codes, strict=True)])
        step = boards.step(actions)
        told = in_moves(SMALL, step, 0.5)
        new = (boards.codes != 0).sum((1, 2)) - known
        assert told[~step.ended] == pytest.approx(0.5 * new[~step.ended] - 1)
        assert (told[step.explored] > -1).all()
        assert (told[step.explored] < 0.5 * SMALL.n - 1).all()
        explored += int(step.explored.sum())
        for i in np.flatnonzero(step.ended):
            policies[i].reset(int(rng.integers(9)))
    assert explored > 0


def test_running_out_of_time_shows_the_last_observation_to_bootstrap_from():
    boards = Boards(EnvConfig(rows=9, cols=12, max_steps=2), 8, 0, matrix)
    boards.step(np.full(8, 1))
    step = boards.step(np.full(8, 1))
    assert step.late is not None
    which, (codes,) = step.late
    assert len(which) == len(codes) > 0
    assert step.ended[which].all()
    assert boards.steps[which].tolist() == [0] * len(which)
    assert ((codes.numpy() == 2).sum((1, 2)) == 1).all()
    assert (codes.numpy()[:, 0, 0] == 1).all()  # the rover has left the corner, where the next episode stands again


def test_all_levels_and_sizes_have_boards_and_the_first_level_half_of_them():
    configs = [EnvConfig.of(level, size) for size in (21, 42) for level in ("random", "1-1-1", "2-2-1")]
    parts = stacks(RECIPES["best"], configs, 0).parts
    assert [part.config for part in parts] == configs
    assert sum(part.num for part in parts) == 256
    assert 120 <= sum(part.num for part in parts if part.config.level == "random") <= 136
    assert all(part.num >= 1 for part in parts)
    with pytest.raises(ValueError, match="one size"):
        RECIPES["paper"].network(configs)


def test_evaluation_seeds_are_refused():
    with pytest.raises(ValueError, match="kept for evaluation"):
        Boards(SMALL, 2, EVALUATION_SEEDS.start)
