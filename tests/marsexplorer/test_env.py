"""The Gymnasium adapters keep Gymnasium's contract and add nothing to the rules."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import marsexplorer  # noqa: F401  # registers the environment
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.terrain import generate, next_seed


@pytest.mark.parametrize(
    "options",
    [{}, {"size": (5, 7), "render_mode": "ansi"}, {"level": "2-2-2", "render_mode": "rgb_array"}],
)
def test_gymnasiums_checker_passes_without_a_warning(options):
    check_env(gymnasium.make("MarsExplorer-v0", **options).unwrapped)


def test_reset_with_a_seed_gives_the_terrain_of_that_seed_and_continues_from_it():
    env = gymnasium.make("MarsExplorer-v0", size=(9, 12))
    _, info = env.reset(seed=5)
    assert info["terrain_seed"] == 5
    assert (env.unwrapped.terrain == generate(EnvConfig.of("random", (9, 12)), 5)).all()
    for seed in (2**60, -1, 1.5):
        with pytest.raises((ValueError, TypeError), match="seed must be"):
            env.reset(seed=seed)
    _, info = env.reset()
    assert info["terrain_seed"] == next_seed(5)
    assert env.reset(seed=np.int64(7))[1]["terrain_seed"] == 7


def test_steps_and_infos_are_those_of_the_rules():
    env, episode = gymnasium.make("MarsExplorer-v0"), Episode.begin(EnvConfig(), seed=11)
    observation, info = env.reset(seed=11)
    rng = np.random.default_rng(0)
    while True:
        assert (observation == episode.observation()).all()
        assert info["position"] == episode.position
        assert info["discovered"] == episode.discovered
        assert info["coverage"] == episode.coverage
        assert info["score"] == episode.score
        assert info["outcome"] == (episode.outcome if episode.ended else None)
        if episode.ended:
            break
        action = int(rng.choice(np.flatnonzero(env.unwrapped.action_masks())))
        observation, reward, terminated, truncated, info = env.step(action)
        assert reward == episode.step(action)
        assert truncated == (episode.outcome == "timed_out")
        assert terminated == (episode.outcome in ("explored", "collided", "out_of_bounds"))


def test_a_given_terrain_is_played():
    terrain = np.zeros((5, 7), bool)
    terrain[0, 1] = True
    env = gymnasium.make("MarsExplorer-v0", size=(5, 7))
    _, info = env.reset(options={"terrain": terrain, "start": (2, 3)})
    assert (info["position"], info["terrain_seed"]) == ((2, 3), None)
    assert (env.unwrapped.terrain == terrain).all()
    with pytest.raises(ValueError, match="start needs a terrain"):
        env.reset(options={"start": (0, 0)})
    with pytest.raises(ValueError, match="options may hold"):
        env.reset(options={"seed": 3})


def test_pictures_show_what_the_rover_knows():
    env = gymnasium.make("MarsExplorer-v0", size=(5, 7), sensor_radius=1, render_mode="ansi")
    env.reset(options={"terrain": np.eye(5, 7, 1, dtype=bool)})
    assert env.render().splitlines() == ["@#?????", ".??????", "???????", "???????", "???????"]
    env = gymnasium.make("MarsExplorer-v0", size=(5, 7), render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().shape == (60, 84, 3)


def test_bad_arguments_say_what_was_expected():
    for options, says in (
        ({"level": "4-1-1"}, "no level '4-1-1'; choose one of: random"),
        ({"observation": "rgb"}, "observation must be"),
    ):
        with pytest.raises(ValueError, match=says):
            gymnasium.make("MarsExplorer-v0", **options)


@pytest.mark.parametrize("observation", ["float32", "uint8"])
def test_the_vector_environment_equals_single_ones(observation):
    options = {"size": (6, 9), "observation": observation}
    vector = gymnasium.make_vec("MarsExplorer-v0", 3, autoreset_mode="SameStep", **options)
    singles = [gymnasium.make("MarsExplorer-v0", **options) for _ in range(3)]
    observations, info = vector.reset(seed=20)
    for i, env in enumerate(singles):
        single, single_info = env.reset(seed=20 + i)
        assert (observations[i] == single).all()
        assert info["terrain_seed"][i] == single_info["terrain_seed"]
    rng = np.random.default_rng(1)
    ends = 0
    for _ in range(200):
        actions = rng.integers(0, 4, 3)
        observations, rewards, terminated, truncated, info = vector.step(actions)
        for i, env in enumerate(singles):
            single, reward, over, cut, single_info = env.step(int(actions[i]))
            assert (reward, over, cut) == (rewards[i], terminated[i], truncated[i])
            if over or cut:
                ends += 1
                assert (info["final_obs"][i] == single).all()
                assert info["final_info"]["outcome"][i] == single_info["outcome"]
                assert info["final_info"]["score"][i] == single_info["score"]
                single, single_info = env.reset()
            assert (observations[i] == single).all()
            assert info["terrain_seed"][i] == single_info["terrain_seed"]
            assert tuple(info["position"][i]) == single_info["position"]
            assert info["coverage"][i] == single_info["coverage"]
    assert ends > 20


IMPORT = """
import sys
import gymnasium
before = set(sys.modules)
import marsexplorer
loaded = {name for name in set(sys.modules) - before if name.startswith("marsexplorer")}
assert loaded == {"marsexplorer"}, loaded
assert not {"numba", "torch"} & set(sys.modules)
"""


def test_an_import_only_registers_the_environment():
    subprocess.run([sys.executable, "-W", "error", "-c", IMPORT], check=True)
