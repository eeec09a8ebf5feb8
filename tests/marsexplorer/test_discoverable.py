"""Episodes in which only the discoverable counts, and the levels that need them."""

import hashlib

import numpy as np
import pytest

from marsexplorer import policies
from marsexplorer.config import MAX_SEED, EnvConfig, fewest_cells
from marsexplorer.episode import Episode, replay
from marsexplorer.evaluation import evaluate
from marsexplorer.evaluation.episodes import play_out
from marsexplorer.evaluation.plots import coverage_curves
from marsexplorer.rules import CELLS, ENOUGH
from marsexplorer.terrain import generate, next_seed
from marsexplorer.world import Worlds, cells_that_count
from tests.support import reference


def discoverable(terrain, start, radius):
    """The cells that are seen from the cells that moves lead to, by their definition."""
    reached = reference.reached_from(terrain, start)
    seen = (reference.visible(terrain, *cell, radius) for cell in reached)
    return set().union(*(zip(*np.nonzero(cells), strict=True) for cells in seen))


@pytest.mark.parametrize("radius", [1, 2, 5])
def test_what_can_be_discovered_is_counted_as_the_definition_says(radius):
    rng, counts = np.random.default_rng(radius), set()
    for _ in range(25):
        shape = (int(rng.integers(5, 10)), int(rng.integers(5, 14)))
        terrain = rng.random(shape) < rng.choice([0.1, 0.3, 0.5])
        start = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))
        terrain[start] = False
        config = EnvConfig.of("random", shape, sensor_radius=radius, discoverable_only=True)
        expected = len(discoverable(terrain, start, radius))
        assert cells_that_count(config, terrain, start) == expected
        counts.add(expected < terrain.size)
    assert counts == {True, False}


def walled_in():
    """A room of 3 x 5 free cells whose walls are two cells thick, on a grid of 7 x 12."""
    terrain = np.ones((7, 12), bool)
    terrain[2:5, 2:7] = False
    return terrain


def test_an_episode_ends_when_beta_of_what_can_be_discovered_is():
    config = EnvConfig.of("map", (7, 12), sensor_radius=2, beta=1.0)
    episode = Episode.begin(config, terrain=walled_in(), start=(3, 2))
    assert episode.cells == 5 * 7
    assert episode.coverage == episode.discovered / 35
    for action in (0, 1, 1, 1, 1, 2, 2, 3, 3, 3, 3):  # round the room, along its walls
        assert not episode.ended
        episode.step(action)
    assert (episode.outcome, episode.discovered, episode.coverage) == ("explored", 35, 1.0)
    assert episode.total == 35 - episode.discoveries[0] - 0.5 * episode.steps + config.n
    assert episode.score == (episode.total + config.n) / (2 * config.n + 35)
    record = episode.record()
    assert record.cells == 35
    assert replay(record).record() == record


def test_all_cells_count_unless_it_is_asked_for():
    episode = Episode.begin(
        EnvConfig.of("random", (7, 12), sensor_radius=2), terrain=walled_in(), start=(3, 2)
    )
    assert episode.cells == episode.record().cells == 84


def test_a_level_keeps_its_terrains_when_only_what_can_be_discovered_counts():
    usual = EnvConfig.of("2-2-1", (21, 30))
    config = EnvConfig.of("2-2-1", (21, 30), discoverable_only=True)
    assert usual.hash != config.hash
    assert EnvConfig(**config.to_dict()) == config
    for seed in range(3):
        assert (generate(config, seed) == generate(usual, seed)).all()
        episode = Episode.begin(config, seed=seed)
        assert episode.cells == len(discoverable(episode.terrain, (0, 0), 6)) <= usual.n
        assert Worlds(config).scalars.shape == Worlds(usual).scalars.shape


@pytest.mark.parametrize("level", ["building", "cave"])
def test_a_stack_of_other_levels_is_a_list_of_singles(level):
    config = EnvConfig.of(level, (9, 14), max_steps=30)
    stack, rng = Worlds(config, 3), np.random.default_rng(0)
    stack.start([4, 5, 6])
    singles = [Episode.begin(config, seed=seed) for seed in (4, 5, 6)]
    ends = 0
    for _ in range(90):
        actions = rng.integers(0, 4, 3)
        rewards = stack.step_autoreset(actions)
        for i, single in enumerate(singles):
            assert single.step(int(actions[i])) == rewards[i]
            if single.ended:
                ends += 1
                assert (stack.last_codes[i] == single.codes).all()
                assert stack.last_scalars[i, CELLS] == single.cells
                single = singles[i] = Episode.begin(config, seed=next_seed(single.seed))
            assert (stack.codes[i] == single.codes).all()
            assert stack.scalars[i, CELLS] == single.cells
            assert stack.scalars[i, ENOUGH] == fewest_cells(single.cells, config.beta)
    assert ends > 10


@pytest.mark.parametrize("level", ["building", "cave"])
@pytest.mark.parametrize("size", [(5, 7), (21, 21), (13, 70), (42, 30)])
def test_a_drawn_building_or_cave_is_what_its_documentation_says(level, size):
    for seed in (0, 7, MAX_SEED):
        expected = reference.terrain_of(level, *size, seed, beta=0 if level == "building" else 0.5)
        assert (generate(EnvConfig.of(level, size), seed) == expected).all()


def test_buildings_and_caves_stay_the_same_for_ever():
    digest = hashlib.sha256()
    for level in ("building", "cave"):
        for size in ((21, 21), (13, 70), (84, 30)):
            for seed in (0, 7, MAX_SEED):
                digest.update(np.packbits(generate(EnvConfig.of(level, size), seed)).tobytes())
    assert digest.hexdigest() == "756d94de8f1987a98a43e481d757e5e9a9ffb81f4cd636a8adbc6e1b70af1bb0"


def test_a_given_map_has_no_seed_and_other_levels_no_other_target():
    with pytest.raises(ValueError, match='level "map" has no terrains of its own: give one'):
        Episode.begin(EnvConfig.of("map", (7, 12)), seed=1)
    with pytest.raises(ValueError, match="discoverable_only cannot be False for level 'cave'"):
        EnvConfig.of("cave", discoverable_only=False)
    with pytest.raises(TypeError, match="discoverable_only must be True, False or None, got 1"):
        EnvConfig.of("random", discoverable_only=1)


@pytest.mark.parametrize("name", ["frontier-cost", "frontier-utility", "frontier-priced"])
def test_rules_see_all_that_can_be_seen_on_given_maps(name):
    """Also what borders on free cells out of reach, which are seen past corners.

    No free cell within reach touches that.
    """
    rng, policy = np.random.default_rng(5), policies.load(name, 5)
    config = EnvConfig.of("map", (9, 13), sensor_radius=5, beta=1.0, max_steps=1000)
    for _ in range(30):
        terrain = rng.random((9, 13)) < rng.choice([0.2, 0.35, 0.5])
        start = (int(rng.integers(9)), int(rng.integers(13)))
        terrain[start] = False
        if len(reference.reached_from(terrain, start)) == 1:
            continue
        episode = Episode.begin(config, terrain=terrain, start=start)
        assert play_out(policy, episode, 0).outcome == "explored"


@pytest.mark.parametrize("level", ["building", "cave"])
def test_figures_are_shares_of_what_can_be_discovered(level):
    config = EnvConfig.of(level, (15, 22))
    table = evaluate(["frontier-utility", "frontier-cost"], config, 2, 5, traces=True)
    for result in table.results:
        episode = Episode.begin(config, seed=result.seed)
        expected = len(discoverable(episode.terrain, (0, 0), 6))
        assert result.cells == expected <= config.n - 9 * (level == "cave")
        discovered, end = result.trace.discovered, fewest_cells(expected, 0.99)
        assert discovered[-2] < end <= discovered[-1]
        assert result.outcome == "explored"
        assert result.coverage == discovered[-1] / expected
        padded = [*discovered, *[discovered[-1]] * config.n][1 : config.n // 4 + 1]
        assert result.auc == pytest.approx(np.mean(padded) / expected)
        curve = coverage_curves([result], 500)[0]
        assert curve[-1] == result.coverage
        assert curve[0] == discovered[0] / expected
