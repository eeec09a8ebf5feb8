"""The boards of the page /about: a real terrain, driven by `ppo`, and a crash.

`python -m tests.support.about_boards` writes static/about/boards.json; a test compares the file
with what is played here.
"""

import json
from pathlib import Path

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode

FILE = Path(__file__).parents[2] / "static" / "about" / "boards.json"
CONFIG = EnvConfig.of("random", 21)
SEED = 7
GLYPHS = "?.@#"


def board_of(episode):
    """A board as the page's painter takes it, with the moves that lead to it."""
    codes = episode.codes
    return {
        "actions": [int(action) for action in episode.actions],
        "outcome": episode.outcome,
        "coverage": round(float(episode.coverage), 4),
        "trail": [[int(row), int(col)] for row, col in episode.path],
        "frame": {
            "rows": CONFIG.rows,
            "cols": CONFIG.cols,
            "grid": ["".join(GLYPHS[code] for code in row) for row in codes],
            "position": [int(part) for part in episode.position],
            "heading": episode.heading,
        },
    }


def boards():
    """Boards by name: at the start, on the way, done, and after hitting a rock."""
    policy = policies.load("ppo")
    policy.reset(SEED)
    episode = Episode.begin(CONFIG, seed=SEED)
    by_name = {"start": board_of(episode)}
    while not episode.ended:
        episode.step(policy.act(episode.codes.copy()))
        if episode.steps == 24:
            by_name["way"] = board_of(episode)
    by_name["done"] = board_of(episode)
    by_name["crash"] = crash(by_name["done"]["actions"])
    return {"seed": SEED, "level": CONFIG.level, "boards": by_name}


def crash(actions):
    """The same terrain, driven as before and then into a rock beside the rover."""
    episode = Episode.begin(CONFIG, seed=SEED)
    for action in actions[:60]:
        episode.step(action)
        row, col = episode.position
        for wrong, (down, right) in enumerate(((-1, 0), (0, 1), (1, 0), (0, -1))):
            neighbour = (row + down, col + right)
            if (
                episode.steps > 8
                and min(neighbour) >= 0
                and max(neighbour) < CONFIG.rows
                and episode.codes[neighbour] == 3
            ):
                episode.step(wrong)
                return board_of(episode)
    raise AssertionError("no rock came beside the rover: choose another SEED")


if __name__ == "__main__":
    FILE.write_text(json.dumps(boards(), separators=(",", ":")) + "\n")
