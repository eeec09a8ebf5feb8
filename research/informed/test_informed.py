"""The informed planner explores, by the shortest walk if that can be computed."""

from itertools import product

import numpy as np
import pytest
from click.testing import CliRunner

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation import evaluate
from marsexplorer.terrain import generate
from research.informed.__main__ import main
from research.informed.informed import AnnealingConfig, informed_actions, search
from tests.support.reference import visible


def steps_of(config, terrain, actions):
    """Moves until explored, played by the rules; the walk must end there."""
    episode = Episode.begin(config, terrain=terrain)
    for action in actions:
        episode.step(action)
    assert episode.outcome == "explored"
    return episode.steps


def fewest_moves(config, terrain):
    """The length of the shortest walk, by breadth-first search with literal sight."""
    views = {}
    for row, col in np.argwhere(~terrain).tolist():
        seen = np.flatnonzero(visible(terrain, row, col, config.sensor_radius)).tolist()
        views[row, col] = sum(1 << cell for cell in seen)
    layer, length = {((0, 0), views[0, 0])}, 0
    met = set(layer)
    while not any(seen.bit_count() >= config.target for _, seen in layer):
        near = [
            ((row + dr, col + dc), seen)
            for ((row, col), seen), (dr, dc) in product(layer, ((-1, 0), (0, 1), (1, 0), (0, -1)))
            if (row + dr, col + dc) in views
        ]
        layer = {(cell, seen | views[cell]) for cell, seen in near} - met
        met |= layer
        length += 1
    return length


@pytest.mark.parametrize("level", ["random", "1-1-1", "3-2-1"])
@pytest.mark.parametrize("size", [(21, 21), (9, 30), (30, 9)])
def test_the_rules_say_that_the_walk_explores_the_terrain(level, size):
    config, searched = EnvConfig.of(level, size), AnnealingConfig(20_000, 1)
    for seed in range(3):
        terrain = generate(config, seed)
        walk = informed_actions(config, terrain, seed, searched)
        assert steps_of(config, terrain, walk) < config.n / 2


def test_on_small_terrains_no_walk_is_shorter():
    config = EnvConfig("random", 5, 7, sensor_radius=2)
    for seed in range(6):
        terrain = generate(config, seed)
        walk = informed_actions(config, terrain, 0)
        assert steps_of(config, terrain, walk) == fewest_moves(config, terrain), seed


def test_a_terrain_has_one_answer_and_a_mirrored_one_a_walk_as_long():
    config = EnvConfig("random", 9, 9, sensor_radius=3)
    terrain = generate(config, 5)
    walk = informed_actions(config, terrain, 5)
    assert informed_actions(config, terrain, 5) == walk
    assert len(informed_actions(config, np.ascontiguousarray(terrain.T), 5)) == len(walk)


def test_a_budget_too_small_and_a_grid_too_large_are_refused():
    config = EnvConfig()
    with pytest.raises(ValueError, match="no walk found in 1 x 2 changes"):
        informed_actions(config, generate(config, 0), 0, AnnealingConfig(2, 1))
    with pytest.raises(ValueError, match="up to 16384 cells, got 200x200"):
        informed_actions(EnvConfig.of("random", 200), np.zeros((200, 200), np.bool_), 0)


def test_the_search_begins_where_the_rover_does():
    terrain = np.ones((7, 12), bool)
    terrain[2:5, 2:7] = False  # a room of 3 x 5 free cells
    config = EnvConfig.of("map", (7, 12), sensor_radius=2, beta=1.0)
    episode = Episode.begin(config, terrain=terrain, start=(3, 2))
    for action in informed_actions(config, terrain, 1, AnnealingConfig(5_000, 1), start=(3, 2)):
        episode.step(action)
    assert (episode.outcome, episode.steps) == ("explored", 11)


def test_the_command_compares_policies_with_the_search():
    arguments = ["--policy", "random", "--size", "7x11", "--episodes", "3"]
    done = CliRunner().invoke(main, arguments, env={"COLUMNS": "140"})
    assert done.exit_code == 0, done.output
    table = evaluate(["frontier-cost"], EnvConfig.of("random", (7, 11)), 3, 0)
    steps = [search(EnvConfig.of("random", (7, 11)), seed) for seed in range(3)]
    ratio = table.rows[0].steps_mean / np.mean(steps)
    (line,) = (line for line in done.output.splitlines() if "frontier-cost" in line)
    assert f"{ratio:.3f} ±" in line
    refused = CliRunner().invoke(main, ["--size", "200"])
    assert "up to 16384 cells, got 200x200" in refused.output
