"""Boards decided together make the moves they make alone; each fails alone."""

import time
from dataclasses import replace
from statistics import median

import numpy as np
import pytest
import torch

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies.network.batch import act_many, batch_network
from marsexplorer.policies.network.policy import NetworkPolicy
from marsexplorer.training.network import Net, save_network
from tests.support.policy_files import write_network

CONFIGS = (EnvConfig.of("random", 21), EnvConfig.of("3-2-1", (9, 14)), EnvConfig.of("1-1-1", 21))


@pytest.fixture
def file(tmp_path):
    return write_network(tmp_path / "net.onnx")


def together(names, boards, moves):
    """Play all boards at once, one network call a round; boards drop out as they end."""
    episodes = [Episode.begin(config, seed=seed) for config, seed in boards]
    drivers = [policies.load(names[at % len(names)]) for at in range(len(boards))]
    for driver, (_, seed) in zip(drivers, boards, strict=True):
        driver.reset(seed)
    while running := [at for at, one in enumerate(episodes) if not one.ended and one.steps < moves]:
        answers = act_many([drivers[at] for at in running], [episodes[at].codes for at in running])
        for at, action in zip(running, answers, strict=True):
            episodes[at].step(action)
    return [bytes(episode.actions) for episode in episodes]


@pytest.mark.parametrize("name", ["ppo", "file"])
def test_the_moves_are_those_of_single_decisions(name, file):
    name = str(file) if name == "file" else name
    names = [name, "frontier-utility"]
    boards = [(replace(CONFIGS[seed % 3], max_steps=150), 10**9 + seed) for seed in range(9)]
    moves = together(names, boards, 150)
    for at, (config, seed) in enumerate(boards):
        assert moves[at] == play_episode(policies.load(names[at % 2]), config, seed).actions


def test_boards_of_one_file_share_a_network_until_the_file_changes(file):
    first, second = policies.load(file), policies.load(file)
    assert batch_network(first) is batch_network(second) is not None
    assert batch_network(policies.load("frontier-cost")) is None
    torch.manual_seed(4)
    save_network(Net(), file, {"summary": "Another, with a longer card."})
    assert batch_network(policies.load(file)) is not batch_network(first)


class Counting:
    """A network of the test's own: logits given, calls counted."""

    def rules_that_count(self, rows, cols):
        del rows, cols

    def __init__(self, scores):
        self.scores, self.calls = scores, []

    def infer(self, planes, moves):
        self.calls.append(len(planes))
        logits = [self.scores[len(self.calls) - 1]] * len(planes)
        return np.array(logits, np.float32), np.zeros(len(planes), np.float32)


def test_a_close_call_is_made_alone():
    config = EnvConfig.of("random", 9)
    for scores, calls, action in (
        ([[0, 1, 0.9, 0]], [2], 1),
        ([[0, 1, 1.0005, 0], [0, 1.0005, 1, 0], [0, 1.0005, 1, 0]], [2, 1, 1], 1),
    ):
        net = Counting(scores)
        boards = [NetworkPolicy("a", net, 6), NetworkPolicy("b", net, 6)]
        codes = Episode.begin(config, seed=3).codes
        assert act_many(boards, [codes, codes]) == [action, action]
        assert net.calls == calls


def test_a_batch_takes_less_time_a_move_than_single_decisions_and_both_under_two_milliseconds():
    boards = [(EnvConfig(), 10**9 + seed) for seed in range(16)]
    took = {}
    for how in ("alone", "together"):
        episodes = [Episode.begin(config, seed=seed) for config, seed in boards]
        drivers = [policies.load("ppo") for _ in boards]
        spent = []
        for _ in range(40):
            grids = [episode.codes for episode in episodes]
            began = time.thread_time()
            if how == "alone":
                actions = [driver.act(grid) for driver, grid in zip(drivers, grids, strict=True)]
            else:
                actions = act_many(drivers, grids)
            spent.append(time.thread_time() - began)
            for episode, action in zip(episodes, actions, strict=True):
                episode.step(action)
        took[how] = median(spent[10:]) / len(boards) * 1000
    print(f"\nms a move: {took['alone']:.3f} alone, {took['together']:.3f} with 16 boards together")
    assert took["alone"] < 2
    assert took["together"] < took["alone"]
