"""Recorded episodes: a change of terrains, rules or frontier rules shows here, and CORE_VERSION rises with it."""

import hashlib
import json
import random
from pathlib import Path

import pytest

from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies import load

ROWS = json.loads((Path(__file__).parents[1] / "fixtures/episodes/golden.json").read_text())


def name_of(row):
    return f"{row['level']} {row['rows']}x{row['cols']} seed {row['seed']}"


def is_quick(row):
    """Whether a row belongs to `make test`: the small grids, and one terrain of a level at 21x21."""
    return row["rows"] < 21 or (row["rows"] == 21 and row["seed"] == 0)


PARAMETERS = [
    pytest.param(row, id=name_of(row), marks=() if is_quick(row) else pytest.mark.long)
    for row in ROWS
]


def walk(config, seed):
    """At most 300 moves drawn by random.Random(seed), those made that the terrain lets pass, then north to the end."""
    draw, episode = random.Random(seed), Episode.begin(config, seed=seed)
    for action in [draw.randrange(4) for _ in range(300)]:
        row, col = episode.position
        r, c = row + (action == 2) - (action == 0), col + (action == 1) - (action == 3)
        is_inside = 0 <= r < config.rows and 0 <= c < config.cols
        if not episode.ended and is_inside and not episode.terrain[r, c]:
            episode.step(action)
    while not episode.ended:
        episode.step(0)
    return episode


def facts(episode):
    names = ("outcome", "steps", "discovered", "total", "trajectory_hash", "score")
    return {name: getattr(episode.record(), name) for name in names}


def test_every_terrain_and_configuration_is_the_one_it_was():
    assert CORE_VERSION == "1"
    for row in ROWS:
        config = EnvConfig.of(row["level"], (row["rows"], row["cols"]))
        assert config.hash == row["config_hash"], name_of(row)
        terrain = Episode.begin(config, seed=row["seed"]).record().terrain
        assert hashlib.sha256(terrain).hexdigest() == row["terrain"], name_of(row)


@pytest.mark.parametrize("row", PARAMETERS)
def test_every_episode_is_the_one_it_was(row):
    config = EnvConfig.of(row["level"], (row["rows"], row["cols"]))
    for name, expected in row["episodes"].items():
        seed = row["seed"]
        episode = walk(config, seed) if name == "fixed" else play_episode(load(name), config, seed)
        assert facts(episode) == expected, name
