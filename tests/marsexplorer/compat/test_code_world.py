"""The authors' world agrees with a twin of it, and programs for it run.

The twin is written from the docstring of `marsexplorer.compat`.
"""

import pickle
import random
import re
import subprocess
import sys
from copy import deepcopy
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import marsexplorer  # noqa: F401  # registers the environments
from marsexplorer.compat import DEFAULT_CONFIG, PRESETS, make
from marsexplorer.compat.config import CodeConfig
from marsexplorer.compat.terrain import draw_terrain
from tests.support import code_reference as reference

PROGRAMS = sorted((Path(__file__).parent / "programs").glob("*.py"))
PRINTED = {
    "obstacle_map": r"[1-9]\d{2,} blocked cells, at most \d+ on one cell\n",
    "random_walk": r"return -?\d+\.\d of observations \(30, 30, 1\), pictures \(360, 360, 3\)\n",
    "table_learner": r"inputs \(21, 21, 1\): mean return -?\d+\.\d, [1-9]\d* cells at last\n",
}
CASES = {
    "as it is": {},
    "lower range": {"size": [30, 30], "lidar_range": 4},
    "fractions": {"lidar_range": 4.5, "lidar_channels": 24},
    "wide": {"size": [15, 26]},
    "high, soon over": {"size": [26, 15], "max_steps": 25},
    "trails": {"lidar_channels": 3, "lidar_range": 3},
    "ends": {"bonus_reward": 5, "collision_reward": -2, "out_of_bounds_reward": -1},
}


def action_of(twin, rng):
    """A valid move in most cases, any in the others."""
    actions = rng.permutation(4).tolist()
    if rng.random() < 0.97:
        for action in actions:
            dx, dy = reference.MOVES[action]
            x, y = twin.x + dx, twin.y + dy
            if 0 <= x < twin.rows and 0 <= y < twin.cols and not twin.terrain[x][y]:
                return action
    return actions[0]


@pytest.mark.parametrize("steps", [60, pytest.param(10_000, marks=pytest.mark.long)])
@pytest.mark.parametrize("case", CASES)
def test_every_move_agrees_with_the_twin(case, steps):
    rng, moves = np.random.default_rng(len(case)), 0
    while moves < steps:
        conf = {**deepcopy(DEFAULT_CONFIG), **CASES[case]}
        rows, cols = conf["size"]
        terrain = rng.random((rows, cols)) < rng.choice([0.02, 0.1, 0.2])
        conf["initial"] = [int(rng.integers(rows)), int(rng.integers(cols))]
        preset = str(rng.choice(["exploConf", "explorer"]))
        twin, env = reference.Twin(conf, terrain.tolist(), preset), make(conf, preset=preset)
        observation, _ = env.reset(options={"terrain": terrain})
        np.testing.assert_array_equal(observation, twin.observation().astype(np.float32))
        done = False
        while not done and moves < steps:
            action = action_of(twin, rng)
            wanted, reward, done = twin.step(action)
            observation, earned, terminated, truncated, _ = env.step(action)
            moves += 1
            np.testing.assert_array_equal(observation, wanted.astype(np.float32))
            assert (earned, terminated, truncated) == (pytest.approx(reward), done, False)


@pytest.mark.parametrize("draws", [400, pytest.param(20_000, marks=pytest.mark.long)])
@pytest.mark.parametrize("preset", ["exploConf", "videos", "level-2", "level-10"])
def test_terrains_agree_with_the_twins_in_distribution(preset, draws):
    config = CodeConfig.of(preset)
    random.seed(preset)
    ours, theirs = (np.zeros((draws, config.rows, config.cols), bool) for _ in range(2))
    for seed in range(draws):
        ours[seed] = draw_terrain(config, seed)
        for cell in reference.draw(config.conf):
            theirs[seed][cell] = True
    shares = ours.mean(0), theirs.mean(0)
    error = np.sqrt(sum(share * (1 - share) for share in shares) / draws)
    error = np.maximum(error, 1 / draws)  # of cells that are rarely blocked
    assert (np.abs(shares[0] - shares[1]) <= 4 * error).all()
    counts = [terrains.sum((1, 2)) for terrains in (ours, theirs)]
    spread = np.sqrt(sum(count.var() for count in counts) / draws)
    assert abs(counts[0].mean() - counts[1].mean()) <= 4 * spread


def test_numbers_of_the_authors_terrains():
    """What the page of the paper says: the ring is free, the start need not be."""
    drawn = np.stack([draw_terrain(CodeConfig.of(), seed) for seed in range(300)])
    ring = np.ones((21, 21), bool)
    ring[1:-1, 1:-1] = False
    assert not drawn[:, ring].any()
    lattice = np.stack([draw_terrain(CodeConfig.of("videos"), seed) for seed in range(600)])
    assert (lattice.sum((1, 2)) == 9).all()
    assert 0.2 < lattice[:, 0, 0].mean() < 0.3


@pytest.mark.parametrize("name", ["KoutrasCode-v0", "exploConf-v1"])
def test_gymnasium_makes_and_checks_them(name):
    check_env(gymnasium.make(f"marsexplorer:{name}").unwrapped, skip_render_check=True)


def test_our_actions_are_theirs_in_another_order():
    ours = gymnasium.make("KoutrasCode-v0", preset="videos").unwrapped
    theirs = gymnasium.make("exploConf-v1", preset="videos").unwrapped
    for seed in range(20):
        first, second = ours.reset(seed=seed)[0], theirs.reset(seed=seed)[0]
        for our_action, their_action in (
            (2, 0),
            (1, 2),
            (0, 1),
            (3, 3),
        ):  # south, east, north, west
            np.testing.assert_array_equal(first, second[:, :, 0])
            (first, *ours_rest), (second, *theirs_rest) = (
                ours.step(our_action),
                theirs.step(their_action),
            )
            assert ours_rest == theirs_rest
            if ours_rest[1]:
                break


def test_a_batch_is_equal_to_single_environments():
    batch = gymnasium.make_vec(
        "KoutrasCode-v0", 4, "vector_entry_point", preset="videos", observation="uint8"
    )
    options = {"preset": "videos", "observation": "uint8"}
    singles = [gymnasium.make("KoutrasCode-v0", **options) for _ in range(4)]
    observations, _ = batch.reset(seed=3)
    expected = [env.reset(seed=3 + i)[0] for i, env in enumerate(singles)]
    rng, ended = np.random.default_rng(1), 0
    for _ in range(300):
        np.testing.assert_array_equal(observations, expected)
        actions = rng.choice([1, 2], 4)
        observations, rewards, over, _, info = batch.step(actions)
        for i, env in enumerate(singles):
            expected[i], reward, is_over, _, single_info = env.step(actions[i])
            assert (rewards[i], over[i]) == (reward, is_over)
            if is_over:
                ended += 1
                np.testing.assert_array_equal(info["final_obs"][i], expected[i])
                assert info["final_info"]["outcome"][i] == single_info["outcome"]
                assert info["final_info"]["coverage"][i] == single_info["coverage"]
                expected[i], _ = env.reset()
    assert ended > 20


def test_a_snapshot_of_a_batch_goes_on_as_the_batch_does():
    first, second = (
        gymnasium.make_vec("KoutrasCode-v0", 3, "vector_entry_point", observation="uint8")
        for _ in range(2)
    )
    first.reset(seed=1)
    actions = np.random.default_rng(2).integers(4, size=(60, 3))
    for batch_actions in actions[:30]:
        first.step(batch_actions)
    second.restore(first.snapshot())
    for batch_actions in actions[30:]:
        one, other = first.step(batch_actions), second.step(batch_actions)
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])


def single(name):
    env = gymnasium.make(name, preset="videos")
    env.reset(seed=5)
    return env


def old_api():
    env = make(preset="videos", returns="gym")
    env.seed(5)
    env.reset()
    return env


def batch_of_two():
    envs = gymnasium.make_vec("KoutrasCode-v0", 2, "vector_entry_point", preset="videos")
    envs.reset(seed=5)
    return envs


MOVES = np.random.default_rng(3).integers(4, size=(40, 2))
WORLDS = {
    "KoutrasCode-v0": (lambda: single("KoutrasCode-v0"), (1, 2), MOVES[:, 0]),
    "exploConf-v1": (lambda: single("exploConf-v1"), (0, 2), MOVES[:, 0]),
    "gym": (old_api, (0, 2), MOVES[:, 0]),
    "batch": (batch_of_two, (np.array([1, 1]), np.array([2, 2])), MOVES),
}
"""How it is made; two moves away from the corner; and moves that nothing chooses."""
COPIES = {"deepcopy": deepcopy, "pickle": lambda env: pickle.loads(pickle.dumps(env))}


def course(env, actions):
    """Observations and rewards until the first end."""
    for action in actions:
        observation, reward, done, *_ = env.step(action)
        yield observation.copy(), reward, done
        if np.any(done):
            return


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("kind", WORLDS)
def test_a_copy_plays_on_as_the_original_does(kind, way):
    begin, first, actions = WORLDS[kind]
    env = begin()
    for action in first:
        env.step(action)
    twin = COPIES[way](env)
    one, other = list(course(twin, actions)), list(course(env, actions))
    assert len(one) == len(other) > 0
    for left, right in zip(one, other, strict=True):
        for mine, theirs in zip(left, right, strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_a_batch_that_was_never_reset_is_not_stepped():
    envs = gymnasium.make_vec("KoutrasCode-v0", 2, "vector_entry_point")
    with pytest.raises(RuntimeError, match=r"no episode is running: call reset\(\) first"):
        envs.step(np.array([1, 1]))


@pytest.mark.parametrize("start", [(3, 4), [3, 4], np.array([3, 4])])
def test_a_start_alone_is_on_the_terrain_of_the_seed(start):
    env = gymnasium.make("KoutrasCode-v0").unwrapped
    env.reset(seed=7)
    terrain = env.terrain
    _, info = env.reset(seed=7, options={"start": start})
    assert (info["position"], info["terrain_seed"]) == ((3, 4), 7)
    np.testing.assert_array_equal(env.terrain, terrain)


def test_an_option_that_is_none_is_left_out():
    env = make()
    terrain = np.zeros((21, 21), bool)
    _, info = env.reset(options={"terrain": terrain, "start": None})
    assert info["position"] == (0, 0)
    assert not env.terrain.any()
    _, info = env.reset(seed=7, options={"terrain": None, "start": (3, 4)})
    assert (info["position"], info["terrain_seed"]) == ((3, 4), 7)


def test_the_time_limit_is_the_move_after_it_and_an_end_like_others():
    env = make({"initial": [10, 10], "max_steps": 5})
    env.reset(options={"terrain": np.zeros((21, 21), bool)})
    ends = [env.step(action)[2:4] for action in (0, 1, 0, 1, 0, 1)]
    assert ends == [(False, False)] * 5 + [(True, False)]


@pytest.mark.parametrize(
    ("conf", "message"),
    [
        ({"lidar_rang": 4}, "conf has no lidar_rang; it may name: initial"),
        ({"initial": [-2, 0]}, "'initial'] must be a cell of the grid"),
        ({"number_rows": 3}, "give both, or neither"),
        ({"size": 21}, "a list of two numbers"),
        ({"obstacle_size": [3, 1]}, "a smallest and a largest side"),
        ({"margins": [12, 12]}, "room for obstacles"),
        ({"lidar_channels": 2.5}, "takes whole numbers"),
        ({"size": [1024, 1024]}, "of up to 16 cells each: 2,048 MiB, and 256 MiB are allowed"),
    ],
)
def test_a_wrong_configuration_is_named(conf, message):
    with pytest.raises((TypeError, ValueError)) as error:
        make(conf)
    assert message in str(error.value)


def test_each_preset_makes_an_environment():
    for name, preset in PRESETS.items():
        observation, info = make(preset=name).reset(seed=1)
        assert observation.shape == (*preset.changes.get("size", [21, 21]), 1)
        assert info["coverage"] > 0


def test_making_one_leaves_the_defaults_alone():
    before = deepcopy(DEFAULT_CONFIG)
    make({"size": [30, 30]}, returns="gym").reset()
    assert before == DEFAULT_CONFIG


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_programs_as_they_are_written_for_the_original_run(program, tmp_path):
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, cwd=tmp_path, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(PRINTED[program.stem], done.stdout), done.stdout
