"""Golden episodes of every level, whose ends no change of the rules may move.

After a change on purpose, for which CORE_VERSION rises, `python -m tests.support.golden_episodes`
writes them again.
"""

import hashlib
import json
import random
from pathlib import Path

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies import load

PATH = Path(__file__).parents[1] / "fixtures/episodes/golden.json"
ROWS = json.loads(PATH.read_text())
AGAIN = "after a change on purpose `python -m tests.support.golden_episodes` writes it again"


def walk(config, seed):
    """At most 300 moves drawn by random.Random(seed), then north to the end.

    Only those that the terrain lets pass are made.
    """
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
    names = ("outcome", "steps", "discovered", "total", "score", "trajectory_hash")
    return {name: getattr(episode.record(), name) for name in names}


def config_of(row):
    return EnvConfig.of(row["level"], (row["rows"], row["cols"]))


def terrain_of(row):
    """SHA-256 (hex) of a row's terrain."""
    terrain = Episode.begin(config_of(row), seed=row["seed"]).record().terrain
    return hashlib.sha256(terrain).hexdigest()


def end_of(row, name):
    """The end of a row's episode by the fixed walk, or by a policy."""
    config, seed = config_of(row), row["seed"]
    return facts(walk(config, seed) if name == "fixed" else play_episode(load(name), config, seed))


def drawn(row):
    """A row as the rules have it now."""
    episodes = {name: end_of(row, name) for name in row["episodes"]}
    hashes = {"config_hash": config_of(row).hash, "terrain": terrain_of(row)}
    return {**row, **hashes, "episodes": episodes}


if __name__ == "__main__":
    lines = [json.dumps(drawn(row), separators=(",", ":")) for row in ROWS]
    PATH.write_text("[\n" + ",\n".join(lines) + "\n]\n")
