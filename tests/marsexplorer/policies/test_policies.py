"""Policies by name, what they take in, and what they refuse."""

import numpy as np
import pytest

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.observation import decode
from marsexplorer.policies.base import Memory, RandomPolicy

BUILT_IN = [
    "frontier-priced",
    "frontier-utility",
    "frontier-cost",
    "lookahead",
    "random",
]
CONFIG = EnvConfig("random", 9, 14, sensor_radius=4)


def test_names_come_best_default_first_and_all_load():
    assert policies.names()[-5:] == BUILT_IN
    for name in policies.names():
        policy = policies.load(name)
        assert policy.name == name
        assert isinstance(policy, policies.Policy)
        assert policies.describe(name).endswith(".")
    if len(policies.names()) > 5:
        assert policies.names()[0] == "ppo"


@pytest.mark.parametrize("name", [*BUILT_IN, "ppo"])
def test_floats_and_codes_give_the_same_moves_and_a_reset_gives_them_again(name):
    policy, other = policies.load(name, 4), policies.load(name, 4)
    first = play_episode(policy, CONFIG, 5)
    assert first.outcome in ("explored", "timed_out")
    assert play_episode(policy, CONFIG, 5).actions == first.actions
    again = Episode.begin(CONFIG, seed=5)
    other.reset(np.int64(5))
    while not again.ended:
        again.step(other.act(again.observation()))
    assert again.actions == first.actions


@pytest.mark.parametrize("name", BUILT_IN)
def test_one_policy_serves_boards_of_any_size(name):
    policy = policies.load(name)
    for size in ((5, 6), (21, 21), (7, 80), (84, 84)):
        episode = Episode.begin(EnvConfig("random", *size), seed=1)
        policy.reset(1)
        for _ in range(3):
            if not episode.ended:
                episode.step(policy.act(episode.codes))
        assert episode.outcome in ("running", "explored")


def test_observations_of_another_kind_are_refused_in_words():
    with pytest.raises(ValueError, match="2 dimensions"):
        decode(np.zeros((1, 5, 7), np.float32))
    with pytest.raises(TypeError, match="float32"):
        decode(np.zeros((5, 7), np.int64))
    with pytest.raises(ValueError, match="exactly one rover"):
        policies.load("random").act(np.zeros((5, 7), np.uint8))


def test_random_is_uniform_over_valid_moves():
    codes = np.array([[1, 1, 1], [3, 2, 1], [1, 1, 1]], np.uint8)
    policy = RandomPolicy()
    policy.reset(11)
    counts = np.bincount([policy.act(codes) for _ in range(3000)], minlength=4)
    assert counts[3] == 0
    assert np.all(np.abs(counts[:3] - 1000) < 130)


def test_random_without_a_valid_move_goes_north():
    assert RandomPolicy().act(np.array([[3, 3, 3], [3, 2, 3], [3, 3, 3]], np.uint8)) == 0


def test_memory_knows_the_heading_from_positions_alone():
    memory = Memory()
    codes = np.ones((5, 7), np.uint8)
    for cell, heading in (((2, 2), 1), ((1, 2), 0), ((1, 1), 3), ((1, 1), 3), ((2, 1), 2)):
        board = codes.copy()
        board[cell] = 2
        memory.observe(board)
        assert (memory.position, memory.heading) == (cell, heading)
    assert memory.visited.sum() == 4


def test_an_unknown_policy_is_named_with_what_to_choose_instead(tmp_path):
    sentence = r'no policy "ppo2" in data/policies; choose one of: .*sac-works, or give'
    with pytest.raises(policies.PolicyNotFoundError, match=sentence):
        policies.load("ppo2")
    with pytest.raises(policies.PolicyNotFoundError, match="no policy file at"):
        policies.load(tmp_path / "none.onnx")
    with pytest.raises(policies.PolicyNotFoundError):
        policies.describe("ppo2")
    with pytest.raises(ValueError, match=r"sensor_radius must be in 1\.\.31, got 0"):
        policies.load("random", 0)


def test_a_folder_is_no_policy(tmp_path):
    with pytest.raises((policies.PolicyFileError, policies.PolicyNotFoundError)):
        policies.load(tmp_path)
