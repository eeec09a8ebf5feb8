"""What users of Gymnasium do with an environment: copies, modes, wrappers, keys."""

import copy
import pickle
import time
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.play import PlayableGame
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeAwareObservation, TimeLimit
from gymnasium.wrappers import vector as wrappers
from hypothesis import given, settings
from hypothesis import strategies as st

ID = "marsexplorer:MarsExplorer-v0"
COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda env: pickle.loads(pickle.dumps(env))}
MODES = list(AutoresetMode)


def assert_same(one, other):
    """Assert that two results of reset or step are equal, whatever they are made of."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            assert_same(one[name], other[name])
    elif isinstance(one, tuple):
        assert len(one) == len(other)
        for left, right in zip(one, other, strict=True):
            assert_same(left, right)
    elif isinstance(one, np.ndarray) and one.dtype == object:
        assert_same(tuple(one), tuple(other))
    else:
        assert np.array_equal(one, other), (one, other)


def assert_equal(one, other):
    """Assert that two results of a stack are equal, infos where their masks say so."""
    assert_same(tuple(one[:-1]), tuple(other[:-1]))
    assert_info(one[-1], other[-1])


def assert_info(info, other):
    assert info.keys() == other.keys()
    for name, column in info.items():
        if name == "final_info":
            assert_info(column, other[name])
        else:
            which = info.get(f"_{name}", np.ones(len(column), bool))
            for left, right in zip(column[which], other[name][which], strict=True):
                assert np.array_equal(left, right), name


@pytest.mark.parametrize("way", COPIES)
@settings(max_examples=60, deadline=None)
@given(
    level=st.sampled_from(["random", "cave", "2-2-2"]),
    observation=st.sampled_from(["float32", "uint8"]),
    is_wrapped=st.booleans(),
    seed=st.integers(0, 2**53 - 1),
    before=st.lists(st.integers(0, 3), max_size=15),
    after=st.lists(st.integers(0, 3), min_size=1, max_size=25),
)
def test_a_copy_plays_on_as_the_original_does_and_leaves_it_alone(
    way, level, observation, is_wrapped, seed, before, after
):
    env = gymnasium.make(ID, level=level, size=(9, 11), observation=observation)
    env = env if is_wrapped else env.unwrapped
    env.reset(seed=seed)
    env.action_space.seed(7)
    env.observation_space.seed(8)
    for action in before:
        if any(env.step(action)[2:4]):
            env.reset()
    twin, third = COPIES[way](env), COPIES[way](env)
    samples = [copied.action_space.sample() for copied in (twin, third) for _ in range(2)]

    def play(player):
        for action in after:
            step = player.step(action)
            yield step
            if step[2] or step[3]:
                yield player.reset()
        yield player.unwrapped.np_random.integers(2**60), player.observation_space.sample()
        yield player.unwrapped.action_masks(), player.unwrapped.terrain

    courses = [list(play(player)) for player in (twin, env, third)]
    for course in courses[1:]:
        assert_same(tuple(course), tuple(courses[0]))
    assert samples == [env.action_space.sample() for _ in range(2)] * 2


@pytest.mark.parametrize("way", COPIES)
def test_an_environment_is_copied_before_its_first_reset_too(way):
    env = COPIES[way](gymnasium.make(ID))
    assert env.reset(seed=3)[1]["terrain_seed"] == 3


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("bits", [np.random.PCG64, np.random.MT19937])
def test_a_copy_has_random_numbers_of_its_own(way, bits):
    env = gymnasium.make(ID).unwrapped
    env.np_random = np.random.Generator(bits(3))
    twin = COPIES[way](env)
    assert [twin.np_random.random() for _ in range(3)] == [env.np_random.random() for _ in range(3)]
    theirs, ours = twin.np_random.spawn(2), env.np_random.spawn(2)
    children = [generator.random() for generator in theirs]
    assert children == [generator.random() for generator in ours]
    assert len(set(children)) == 2


@pytest.mark.alone
@pytest.mark.parametrize("way", COPIES)
def test_a_copy_takes_less_time_than_one_of_cart_pole(way):
    """Copied in turn: microseconds alone would measure the machine."""
    envs = [gymnasium.make(ID), gymnasium.make("CartPole-v1")]
    for env in envs:
        env.reset(seed=1)
    for most, (ours, theirs) in ((1.5, envs), (1, [env.unwrapped for env in envs])):
        seconds = {ours: [], theirs: []}
        for _ in range(20):
            for env, times in seconds.items():
                for _ in range(100):
                    began = time.perf_counter()
                    COPIES[way](env)
                    times.append(time.perf_counter() - began)
        least = {env: np.quantile(times, 0.1) * 1e6 for env, times in seconds.items()}
        print(way, {str(env): f"{microseconds:.0f} us" for env, microseconds in least.items()})
        assert least[ours] < most * least[theirs]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("way", COPIES)
def test_a_copied_stack_plays_on_by_itself(mode, way):
    envs = gymnasium.make_vec(ID, 3, size=(6, 9), observation="uint8", autoreset_mode=mode)
    rng = np.random.default_rng(2)
    envs.reset(seed=1)
    for _ in range(30):
        ended = np.logical_or(*envs.step(rng.integers(0, 4, 3))[2:4])
        if mode is AutoresetMode.DISABLED and ended.any():
            envs.reset(options={"reset_mask": ended})
    twin = COPIES[way](envs)
    for _ in range(30):
        actions = rng.integers(0, 4, 3)
        one, other = twin.step(actions), envs.step(actions)
        assert_equal(one, other)
        assert not np.shares_memory(one[0], other[0])
        if mode is AutoresetMode.DISABLED and (one[2] | one[3]).any():
            for stack in (twin, envs):
                stack.reset(options={"reset_mask": one[2] | one[3]})


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("options", [{}, {"level": "cave"}, {"observation": "uint8"}])
def test_a_stack_answers_as_gymnasiums_own_does_in_every_autoreset_mode(mode, options):
    options = {"size": (8, 9), "max_steps": 25, **options}
    ours = gymnasium.make_vec(ID, 4, autoreset_mode=mode.value, **options)
    theirs = SyncVectorEnv([lambda: gymnasium.make(ID, **options)] * 4, autoreset_mode=mode)
    assert ours.metadata["autoreset_mode"] is mode
    rng, ends = np.random.default_rng(0), 0

    assert_equal(ours.reset(seed=4), theirs.reset(seed=4))
    for _ in range(200):
        actions = rng.integers(0, 4, 4)
        step = ours.step(actions)
        assert_equal(step, theirs.step(actions))
        ended = step[2] | step[3]
        ends += ended.sum()
        if mode is AutoresetMode.DISABLED and ended.any():
            mask = {"reset_mask": ended}
            assert_equal(ours.reset(options=dict(mask)), theirs.reset(options=dict(mask)))
    assert ends > 50


def test_a_stack_without_arguments_begins_anew_in_the_next_step():
    assert gymnasium.make_vec(ID, 2).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    with pytest.raises(ValueError, match="is not a valid AutoresetMode"):
        gymnasium.make_vec(ID, 2, autoreset_mode="sometimes")


def test_an_ended_environment_of_a_disabled_stack_is_named_and_masks_are_checked():
    envs = gymnasium.make_vec(ID, 2, size=(6, 9), autoreset_mode="Disabled")
    with pytest.raises(RuntimeError, match="without a reset_mask first"):
        envs.reset(options={"reset_mask": np.ones(2, bool)})
    envs.reset(seed=0)
    envs.step(np.array([0, 1]))
    with pytest.raises(RuntimeError, match=r"the environments \[0\] have ended: call reset"):
        envs.step(np.array([0, 1]))
    for mask in ([True, False], np.ones(3, bool), np.ones(2), np.zeros(2, bool)):
        with pytest.raises(ValueError, match=r"reset_mask must be bool\[2\]"):
            envs.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="no options but reset_mask"):
        envs.reset(options={"terrain": None})


WRAPPERS = {
    "ClipReward": lambda envs: wrappers.ClipReward(envs, -1, 1),
    "DictInfoToList": wrappers.DictInfoToList,
    "DtypeObservation": lambda envs: wrappers.DtypeObservation(envs, np.float32),
    "FlattenObservation": wrappers.FlattenObservation,
    "NormalizeObservation": wrappers.NormalizeObservation,
    "NormalizeReward": wrappers.NormalizeReward,
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
    "RescaleObservation": lambda envs: wrappers.RescaleObservation(envs, -1, 1),
    "ReshapeObservation": lambda envs: wrappers.ReshapeObservation(envs, (54,)),
    "TransformAction": lambda envs: wrappers.TransformAction(envs, lambda actions: actions),
    "TransformObservation": lambda envs: wrappers.TransformObservation(envs, lambda board: board),
    "TransformReward": lambda envs: wrappers.TransformReward(envs, lambda reward: 2 * reward),
    "VectorizeTransformAction": lambda envs: wrappers.VectorizeTransformAction(
        envs, gymnasium.wrappers.TransformAction, func=lambda action: action, action_space=None
    ),
    "VectorizeTransformObservation": lambda envs: wrappers.VectorizeTransformObservation(
        envs, gymnasium.wrappers.FlattenObservation
    ),
    "VectorizeTransformReward": lambda envs: wrappers.VectorizeTransformReward(
        envs, gymnasium.wrappers.TransformReward, func=lambda reward: reward
    ),
}
OF_OTHER_SPACES = {
    "ClipAction", "FilterObservation", "GrayscaleObservation", "RescaleAction", "ResizeObservation", "HumanRendering",
    "RecordVideo", "ArrayConversion", "JaxToNumpy", "JaxToTorch", "NumpyToTorch",
}  # fmt: skip
"""For continuous actions, dictionaries or pictures; or they need a screen, an encoder, or arrays
of other libraries.
"""


def test_the_table_of_wrappers_is_gymnasiums():
    assert {*WRAPPERS} | OF_OTHER_SPACES == {*wrappers.__all__}


@pytest.mark.parametrize("name", WRAPPERS)
def test_gymnasiums_vector_wrappers_pass(name):
    envs = WRAPPERS[name](gymnasium.make_vec(ID, 3, size=(6, 9)))
    gymnasiums = WRAPPERS[name](SyncVectorEnv([lambda: gymnasium.make(ID, size=(6, 9))] * 3))
    rng = np.random.default_rng(1)
    assert_same(envs.reset(seed=0)[0], gymnasiums.reset(seed=0)[0])
    for _ in range(60):
        actions = rng.integers(0, 4, 3)
        one, other = envs.step(actions), gymnasiums.step(actions)
        assert np.allclose(one[0], other[0])
        assert np.allclose(one[1], other[1])
        assert_same(one[2:4], other[2:4])


def test_a_stack_is_drawn_and_asked_as_gymnasiums_own_is():
    options = {"size": (6, 9), "render_mode": "rgb_array"}
    envs = gymnasium.make_vec(ID, 2, **options)
    gymnasiums = SyncVectorEnv([lambda: gymnasium.make(ID, **options)] * 2)
    for stack in (envs, gymnasiums):
        stack.reset(seed=5)
    assert_same(envs.render(), gymnasiums.render())
    for name in ("render_mode", "config", "terrain"):
        assert_same(envs.get_attr(name), gymnasiums.get_attr(name))
    for name in ("action_masks", "render", "config"):
        assert_same(envs.call(name), gymnasiums.call(name))
    envs.set_attr("note", ["a", "a"])
    assert envs.get_attr("note") == ("a", "a")
    with pytest.raises(ValueError, match="one value for the whole stack"):
        envs.set_attr("note", ["a", "b"])
    assert gymnasium.make_vec(ID, 2).render() is None


@pytest.mark.parametrize(("size", "limit"), [(21, 441), (84, 7056), ((6, 9), 54)])
def test_the_spec_names_the_limit_of_an_episode_without_a_wrapper_in_the_step(size, limit):
    env = gymnasium.make(ID, size=size)
    assert env.spec.max_episode_steps == limit
    assert gymnasium.make_vec(ID, 2, size=size).spec.max_episode_steps == limit
    wrapped = env
    while wrapped is not env.unwrapped:
        assert not isinstance(wrapped, TimeLimit)
        wrapped = wrapped.env
    TimeAwareObservation(env)


def test_an_environment_made_from_the_spec_of_another_has_the_same_episodes():
    options = {"size": (6, 9), "max_steps": 12}
    env = gymnasium.make(ID, **options)
    again, stack = gymnasium.make(env.spec), gymnasium.make_vec(env.spec, 1)
    assert again.spec.max_episode_steps == stack.spec.max_episode_steps == 12
    courses = []
    for player in (env, again):
        course = [player.reset(seed=9)]
        for step in range(12):
            course.append(player.step((1, 3)[step % 2]))
        courses.append(tuple(course))
    assert courses[0][-1][3]
    assert_same(*courses)
    stack.reset(seed=9)
    ends = [stack.step(np.array([(1, 3)[step % 2]]))[3][0] for step in range(12)]
    assert ends == 11 * [False] + [True]


def test_the_keys_of_gymnasiums_play_are_letters_and_arrows():
    pygame = pytest.importorskip("pygame")
    env = gymnasium.make(ID, render_mode="rgb_array")
    env.reset(seed=0)
    game = PlayableGame(env)
    arrows = (pygame.K_UP, pygame.K_RIGHT, pygame.K_DOWN, pygame.K_LEFT)
    keys = game.env.unwrapped.get_keys_to_action()
    assert (
        [keys[(arrow,)] for arrow in arrows]
        == [keys[(ord(letter),)] for letter in "wdsa"]
        == [0, 1, 2, 3]
    )
    assert {ord(letter) for letter in "wasd"} <= set(game.relevant_keys)


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int16, np.uint32, np.int64, np.uint64])
def test_seeds_are_numpys_whole_numbers_of_any_kind(kind):
    env, envs = gymnasium.make(ID), gymnasium.make_vec(ID, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert env.reset(seed=kind(7))[1]["terrain_seed"] == 7
        assert envs.reset(seed=kind(7))[1]["terrain_seed"].tolist() == [7, 8]
        assert envs.reset(seed=[kind(3), None])[1]["terrain_seed"][0] == 3
