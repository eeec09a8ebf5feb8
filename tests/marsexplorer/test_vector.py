"""The vector environment: its arrays, threads, and Gymnasium's wrappers."""

from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from marsexplorer.buffers import shared_array
from marsexplorer.config import EnvConfig
from marsexplorer.terrain import attempts, next_seed
from marsexplorer.world import Worlds


def make_vector(num_envs, **options):
    return gymnasium.make_vec(
        "MarsExplorer-v0",
        num_envs,
        "vector_entry_point",
        **({"size": (6, 9), "autoreset_mode": "SameStep"} | options),
    )


def blind(envs, steps=40):
    """Step with random moves, which often end an episode soon; yield the results."""
    rng = np.random.default_rng(3)
    envs.reset(seed=7)
    for _ in range(steps):
        yield envs.step(rng.integers(0, 4, envs.num_envs))


def copied(value):
    if isinstance(value, dict):
        return {name: copied(one) for name, one in value.items()}
    return np.array(value, copy=True)


def assert_same(stepped, expected):
    for name, one in expected.items():
        if isinstance(one, dict):
            assert_same(stepped[name], one)
        elif name != "final_obs":
            assert (stepped[name] == one).all(), name


def test_stacks_in_several_threads_at_once_do_not_meet():
    def played(_):
        return [result[1] for result in blind(make_vector(600, observation="uint8"))]

    with ThreadPoolExecutor(4) as pool:
        first, *others = pool.map(played, range(8))
    for other in others:
        assert (np.array(other) == np.array(first)).all()


def step_for_ever(worlds):
    while True:
        worlds.step_autoreset(np.ones(worlds.num, np.int64))


def test_a_seed_without_a_terrain_is_named():
    config = EnvConfig.of("random", 42, beta=1.0, max_steps=1)  # about one seed in ten has none
    worlds = Worlds(config, 6)
    worlds.start(range(6))
    with pytest.raises(ValueError, match="no solvable terrain"):
        step_for_ever(worlds)


def test_no_step_is_made_on_a_board_that_stands_on_no_terrain():
    config = EnvConfig.of("random", 42, beta=1.0)
    ok, failing = (
        next(s for s in range(99) if bool(attempts(config, s)) is is_solved)
        for is_solved in (True, False)
    )
    envs = gymnasium.make_vec("MarsExplorer-v0", 3, size=42, beta=1.0)
    single = gymnasium.make("MarsExplorer-v0", size=42, beta=1.0).unwrapped
    single.reset(seed=ok)
    for env, action in ((envs, np.ones(3, np.int64)), (single, 1)):
        with pytest.raises(ValueError, match="no solvable terrain"):
            env.reset(seed=[ok, failing, ok] if env is envs else failing)
        for _ in range(2):
            with pytest.raises(RuntimeError, match=r"call reset\(\) first"):
                env.step(action)
        env.reset(seed=[ok] * 3 if env is envs else ok)
        env.step(action)
    with pytest.raises(RuntimeError, match=r"call reset\(\) first"):
        make_vector(2).step(np.ones(2, np.int64))


def test_seeds_are_checked_before_anything_changes_and_what_follows_them_is_known():
    envs = make_vector(1)
    for _ in range(2):
        envs.reset(seed=0)
        assert envs.reset()[1]["terrain_seed"] == [next_seed(0)]
    envs = make_vector(2)
    envs.reset(seed=[np.int64(3), None])
    second = envs.reset(seed=[np.uint64(5), 0])[1]["terrain_seed"].copy()
    for seed in (2**53 - 1, [2**60, 0], [-1, 2], [1.7, 2], [np.int64(-1), 2]):
        with pytest.raises((ValueError, TypeError), match="seed must be"):
            envs.reset(seed=seed)
    assert second.tolist() == [5, 0]
    assert envs.reset()[1]["terrain_seed"].tolist() == [next_seed(5), next_seed(0)]


def test_codes_and_infos_are_views_and_float_ones_last():
    for observation, is_kept in (("uint8", False), ("float32", True)):
        last = None
        for observations, _, terminated, truncated, info in blind(
            make_vector(4, observation=observation)
        ):
            if last is not None:
                assert np.shares_memory(observations, last[0]) is not is_kept
                assert np.shares_memory(info["score"], last[1]["score"]) is not is_kept
                if is_kept:
                    assert_same(last[1], last[2])
            last = observations, info, copied(info)
            for i in np.flatnonzero(terminated | truncated):
                assert info["final_obs"][i].shape == (6, 9)
            for i in np.flatnonzero(~(terminated | truncated)):
                assert "final_obs" not in info or info["final_obs"][i] is None


@pytest.mark.parametrize(
    ("observation", "dtype"), [("uint8", torch.uint8), ("float32", torch.float32)]
)
def test_observations_are_written_into_a_tensor_that_the_caller_gives(observation, dtype):
    tensor = torch.full((4, 6, 9), 9, dtype=dtype)
    plain, with_tensor = (
        make_vector(4, observation=observation),
        make_vector(4, observation=observation, out=tensor),
    )
    for one, other in zip(blind(plain), blind(with_tensor), strict=True):
        assert (tensor.numpy() == one[0]).all()
        assert np.shares_memory(other[0], tensor.numpy())


class OnlyDLPack:
    """What shares memory by DLPack alone."""

    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **given):
        return self.array.__dlpack__(**given)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def test_a_buffer_is_written_to_or_refused_with_what_was_expected():
    array = np.zeros((2, 3), np.uint8)
    assert shared_array(array, (2, 3), np.uint8) is array
    if np.lib.NumpyVersion(np.__version__) >= "2.1.0":
        shared_array(OnlyDLPack(array), (2, 3), np.uint8)[1, 2] = 5
        assert array[1, 2] == 5
    fixed = np.zeros((2, 3), np.uint8)
    fixed.flags.writeable = False
    for out, error, says in (
        (np.zeros((2, 3)), TypeError, r"out must be uint8\[2, 3\] .*; got float64"),
        (np.zeros((3, 2), np.uint8), ValueError, r"got the shape \[3, 2\]"),
        (np.zeros((3, 2), np.uint8).T, ValueError, "not contiguous"),
        (fixed, ValueError, "read-only"),
        (torch.zeros((2, 3), device="meta"), TypeError, "got Tensor, which shares none"),
        ([[0, 0, 0], [0, 0, 0]], TypeError, "got list, which shares none"),
    ):
        with pytest.raises(error, match=says):
            shared_array(out, (2, 3), np.uint8)


def test_gymnasium_records_the_episodes_that_ended():
    lengths, returns, count = np.zeros(4), np.zeros(4), 0
    envs = RecordEpisodeStatistics(make_vector(4, observation="uint8"))
    for _, rewards, terminated, truncated, info in blind(envs):
        lengths, returns = lengths + 1, returns + rewards
        for i in np.flatnonzero(terminated | truncated):
            assert info["episode"]["l"][i] == lengths[i]
            assert info["episode"]["r"][i] == pytest.approx(returns[i])
            lengths[i], returns[i], count = 0, 0, count + 1
    assert count > 20


def test_bad_actions_move_nothing():
    envs = make_vector(3, observation="uint8")
    envs.reset(seed=1)
    before = envs.snapshot()
    for actions in ([0, 1, 4], [0, -1, 1], [0, 1], [[0, 1, 2]], [0, 1.9, 2], ["0", "1", "2"]):
        with pytest.raises(ValueError, match="actions must be 3 numbers in 0"):
            envs.step(np.array(actions))
    for name, array in envs.snapshot().items():
        assert (array == before[name]).all()
