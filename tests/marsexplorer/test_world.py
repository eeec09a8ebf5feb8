"""The compiled rules are the literal ones, alone and stacked, and keep the laws."""

import gc
from dataclasses import replace
from types import FunctionType, ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marsexplorer.config import LEVELS, OUTCOMES, EnvConfig
from marsexplorer.episode import Episode, replay
from marsexplorer.rules import DISCOVERED, SEED, STEPS
from marsexplorer.terrain import next_seed
from marsexplorer.world import Worlds, positions, totals
from tests.support import reference, strategies


def literal_twin(config, terrain):
    pays = LEVELS[config.level].has_bonus
    return reference.World(terrain, config.sensor_radius, config.beta, config.limit, pays)


@settings(max_examples=100, deadline=None)
@given(
    strategies.terrains(),
    strategies.moves,
    st.integers(1, 8),
    st.sampled_from([0.3, 0.6, 0.99, 1.0]),
    st.sampled_from(["random", "1-1-2"]),
    st.sampled_from([None, 7, 40]),
)
def test_the_compiled_rules_are_the_literal_ones(terrain, actions, radius, beta, level, max_steps):
    rows, cols = terrain.shape
    config = EnvConfig(level, rows, cols, radius, beta, max_steps)
    episode, literal = Episode.begin(config, terrain=terrain), literal_twin(config, terrain)
    assert (episode.observation() == literal.observation()).all()
    for action in actions:
        assert episode.step(action) == literal.step(action)
        assert (episode.observation() == literal.observation()).all()
        assert episode.position == literal.position
        assert episode.discovered == len(literal.discovered)
        assert episode.steps == literal.steps
        assert episode.total == literal.total
        assert (episode.outcome if episode.ended else None) == literal.outcome
        if episode.ended:
            break


@settings(max_examples=40, deadline=None)
@given(strategies.configs(max_side=24), strategies.seeds, st.integers(0, 2**32 - 1))
def test_a_stack_is_a_list_of_singles(config, seed, choice):
    rng = np.random.default_rng(choice)
    num = 3
    stack = Worlds(config, num)
    seeds = [(seed + i) % 2**53 for i in range(num)]
    try:
        stack.start(seeds)
    except ValueError:
        return
    singles = [Episode.begin(config, seed=one) for one in seeds]
    for _ in range(60):
        actions = rng.integers(0, 4, num)
        try:
            rewards = stack.step_autoreset(actions)
        except ValueError:
            return
        for i, single in enumerate(singles):
            assert single.step(int(actions[i])) == rewards[i]
            assert OUTCOMES[stack.outcomes[i]] == single.outcome
            if single.ended:
                assert (stack.last_codes[i] == single.codes).all()
                assert stack.last_scalars[i, STEPS] == single.steps
                assert totals(config, stack.last_scalars)[i] == single.total
                single = singles[i] = Episode.begin(config, seed=next_seed(single.seed))
            assert (stack.codes[i] == single.codes).all()
            assert tuple(positions(stack.scalars)[i]) == single.position
            assert stack.scalars[i, DISCOVERED] == single.discovered
            assert stack.scalars[i, SEED] == single.seed
            assert totals(config, stack.scalars)[i] == single.total


@settings(max_examples=60, deadline=None)
@given(strategies.terrains(max_density=0.3), strategies.moves, st.integers(1, 8))
def test_coverage_never_falls_and_nothing_beyond_the_radius_is_discovered(terrain, actions, radius):
    rows, cols = terrain.shape
    episode = Episode.begin(EnvConfig(rows=rows, cols=cols, sensor_radius=radius), terrain=terrain)
    row, col = np.indices(terrain.shape)
    within = (row**2 + col**2) <= radius**2
    coverage = episode.coverage
    for action in actions:
        if episode.ended:
            break
        episode.step(action)
        r, c = episode.position
        within |= (row - r) ** 2 + (col - c) ** 2 <= radius**2
        assert episode.coverage >= coverage
        assert not (episode.codes != 0)[~within].any()
        coverage = episode.coverage


@settings(max_examples=40, deadline=None)
@given(strategies.terrains(max_density=0.3), strategies.moves)
def test_a_mirrored_terrain_gives_a_mirrored_result(terrain, actions):
    rows, cols = terrain.shape
    plain = Episode.begin(EnvConfig(rows=rows, cols=cols), terrain=terrain)
    turned = Episode.begin(EnvConfig(rows=cols, cols=rows), terrain=np.ascontiguousarray(terrain.T))
    for action in actions:
        assert plain.step(action) == turned.step(3 - action)
        assert (plain.codes == turned.codes.T).all()
        assert (plain.outcome, plain.total) == (turned.outcome, turned.total)
        if plain.ended:
            break


@settings(max_examples=60, deadline=None)
@given(strategies.configs(max_side=24), strategies.seeds, strategies.moves, st.booleans())
def test_a_replayed_record_is_the_record(config, seed, actions, gives_up):
    try:
        episode = Episode.begin(config, seed=seed)
    except ValueError:
        return
    for action in actions:
        if episode.ended:
            break
        episode.step(action)
    if gives_up and not episode.ended:
        episode.abandon()
    again = replay(episode.record())
    assert again.record() == episode.record()
    assert again.path == episode.path
    assert again.discoveries == episode.discoveries
    assert again.rewards == episode.rewards


def test_the_garbage_collector_has_no_more_to_look_at_however_many_moves_an_episode_has():
    """A server keeps all episodes; what is in lists is looked at again and again."""

    def looked_at(episode):
        reached, waiting = {}, [vars(episode)]
        while waiting:
            thing = waiting.pop()
            if id(thing) not in reached and not isinstance(thing, type | ModuleType | FunctionType):
                reached[id(thing)] = thing
                waiting += gc.get_referents(thing)
        return len(reached)

    episode = Episode.begin(EnvConfig.of("random", 21), seed=7)
    sizes = []
    for moves in (2, 100):
        while episode.steps < moves and not episode.ended:
            episode.step((1, 3)[episode.steps % 2])
        sizes.append(looked_at(episode))
    assert not episode.ended
    assert sizes[1] <= sizes[0] + 4  # numbers that are objects of their own


def test_abandoning_costs_what_a_collision_costs():
    episode = Episode.begin(EnvConfig(), seed=1)
    first = episode.step(1)
    episode.abandon()
    assert (episode.total, episode.outcome) == (first - 441, "abandoned")
    with pytest.raises(RuntimeError, match="ended"):
        episode.step(1)


def test_the_step_limit_truncates_but_a_completion_on_the_last_step_explores():
    field = np.zeros((5, 30), bool)
    timed = Episode.begin(EnvConfig(rows=5, cols=30, max_steps=3), terrain=field)
    for _ in range(3):
        timed.step(1)
    assert (timed.outcome, timed.reward) == ("timed_out", 4.5)
    last = Episode.begin(EnvConfig(rows=5, cols=30, beta=0.3, max_steps=4), terrain=field)
    while not last.ended:
        last.step(1)
    assert last.outcome == "explored"


@pytest.mark.parametrize(
    ("terrain", "start", "error", "says"),
    [
        (np.zeros((5, 7), int), (0, 0), TypeError, "array of bool"),
        (np.zeros((7, 5), bool), (0, 0), ValueError, r"shape \(5, 7\)"),
        (np.ones((5, 7), bool), (0, 0), ValueError, "free cell"),
        (np.zeros((5, 7), bool), (5, 0), ValueError, "on the 5x7 grid"),
    ],
)
def test_a_given_terrain_is_checked(terrain, start, error, says):
    with pytest.raises(error, match=says):
        Episode.begin(EnvConfig(rows=5, cols=7), terrain=terrain, start=start)


@pytest.mark.parametrize("action", [4, -1, 1.5, "north", None])
def test_an_unknown_action_is_refused_and_changes_nothing(action):
    episode = Episode.begin(EnvConfig(rows=5, cols=7), seed=3)
    with pytest.raises(ValueError, match="action must be 0"):
        episode.step(action)
    assert episode.steps == 0


def test_a_record_that_goes_on_after_its_end_is_refused():
    episode = Episode.begin(EnvConfig(rows=5, cols=7), seed=3)
    episode.step(0)
    with pytest.raises(ValueError, match="after its end"):
        replay(replace(episode.record(), actions=b"\x00\x01"))
    with pytest.raises(ValueError, match="core version"):
        replay(replace(episode.record(), core_version="0"))
