"""Training: small, deterministic, and better than chance."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy import stats

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load
from marsexplorer.training.ppo import (
    EVALUATION_SEEDS,
    FLIPS,
    Boards,
    Progress,
    Recipe,
    Rollout,
    advantages,
    checkpoint_to,
    train,
    turned,
)

SMALL = EnvConfig(rows=9, cols=12)
QUICK = replace(Recipe(), labels=2560, clone_passes=12, boards=32, horizon=32, minibatch=256, value_updates=1)


def score_of(policy, seed):
    episode = Episode.begin(SMALL, seed=seed)
    policy.reset(seed)
    while not episode.ended:
        episode.step(policy.act(episode.observation()))
    return episode.score


def test_a_tiny_policy_beats_random_on_fifty_terrains(tmp_path):
    path = tmp_path / "tiny.safetensors"
    train(SMALL, 3072, 0, QUICK, lambda _: None, checkpoint_to(path, {"summary": "a tiny one"}))
    tiny, chance = load(path), load("random")
    seeds = EVALUATION_SEEDS[:50]
    gap = np.array([score_of(tiny, seed) - score_of(chance, seed) for seed in seeds])
    low, _ = stats.t.interval(0.95, len(gap) - 1, gap.mean(), stats.sem(gap))
    assert low > 0


def test_the_same_seed_gives_the_same_weights():
    brief = replace(QUICK, labels=128, clone_passes=8)
    one, two = (train(SMALL, 1024, 3, brief, lambda _: None, lambda *_: None).state_dict() for _ in range(2))
    assert all(torch.equal(one[name], two[name]) for name in one)


def test_advantages_are_the_slow_sum_of_discounted_surprises():
    recipe = replace(QUICK, horizon=7, boards=3)
    rollout, after = Rollout.room(recipe), torch.rand(3)
    torch.manual_seed(0)
    rollout.rewards, rollout.values = torch.rand(7, 3), torch.rand(7, 3)
    rollout.ended = (torch.rand(7, 3) < 0.3).float()
    found = advantages(rollout, after, recipe)
    for board in range(3):
        for t in range(7):
            total, weight = 0.0, 1.0
            for k in range(t, 7):
                goes_on = 1 - float(rollout.ended[k, board])
                following = float(after[board] if k == 6 else rollout.values[k + 1, board])
                total += weight * (
                    float(rollout.rewards[k, board]) + recipe.gamma * following * goes_on - float(rollout.values[k, board])
                )
                weight *= recipe.gamma * recipe.lam * goes_on
            assert float(found[t, board]) == pytest.approx(total, abs=1e-5)


@pytest.mark.parametrize("which", range(len(FLIPS)))
def test_a_turned_board_is_seen_as_the_turned_terrain_is(which):
    """Perception of a turned terrain equals the turned perception of the terrain, rules for ties apart."""
    transpose, down, right = FLIPS[which]
    terrain = np.random.default_rng(4).random((9, 9)) < 0.2
    terrain[4, 4] = False

    def flipped(cells):
        cells = cells.T if transpose else cells
        cells = cells[::-1] if down else cells
        return np.ascontiguousarray(cells[:, ::-1] if right else cells)

    def seen(cells):
        from marsexplorer.policies.perception import Perception

        episode = Episode.begin(EnvConfig(rows=9, cols=9), terrain=cells, start=(4, 4))
        visited = np.zeros((1, 81), np.uint8)
        visited[0, 40] = 1
        planes, moves = Perception(1, 9, 9, 6)(episode.codes[None], np.array([40]), visited, np.array([1]))
        return torch.from_numpy(planes.copy()), torch.from_numpy(moves[:, :, :7].copy())

    planes, moves = seen(terrain)
    as_turned = turned(planes, moves, torch.tensor([0]), which)
    expected = seen(flipped(terrain))
    assert torch.equal(as_turned[0], expected[0])
    assert torch.allclose(as_turned[1], expected[1])


def test_running_out_of_time_shows_the_last_observation_to_bootstrap_from():
    boards = Boards(EnvConfig(rows=9, cols=12, max_steps=2), 8, 0)
    boards.step(np.full(8, 1), Progress())
    step = boards.step(np.full(8, 1), Progress())
    assert step.truncated.any()
    assert step.final is not None
    assert len(step.final[0]) == step.truncated.sum()
    assert boards.steps[step.truncated].tolist() == [0] * int(step.truncated.sum())


def test_evaluation_seeds_are_refused():
    with pytest.raises(ValueError, match="kept for evaluation"):
        Boards(SMALL, 2, EVALUATION_SEEDS.start)
