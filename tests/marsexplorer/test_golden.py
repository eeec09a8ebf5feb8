"""Recorded episodes, one a level: a change of the rules shows here, and CORE_VERSION rises in the same commit."""

import pytest

from marsexplorer.config import CORE_VERSION, LEVELS, EnvConfig
from marsexplorer.episode import Episode

GOLDEN = {
    "1-1-1": ("1", "running", 150, 501, 392.0, "2e27c5d5fd15f28d"),
    "1-1-2": ("1", "running", 150, 501, 392.0, "99a627a0b4f1ab92"),
    "1-2-1": ("1", "running", 150, 486, 380.0, "4b052a0f2e947919"),
    "1-2-2": ("1", "running", 150, 486, 380.0, "1dd29afde7d97f06"),
    "2-1-1": ("1", "running", 150, 566, 457.0, "168aa1032bfd3b71"),
    "2-1-2": ("1", "running", 150, 566, 457.0, "5b0c8d859dc4719f"),
    "2-2-1": ("1", "running", 150, 537, 429.0, "8c112d16f4da40b0"),
    "2-2-2": ("1", "running", 150, 537, 429.0, "d03b89717fa1c19a"),
    "3-1-1": ("1", "running", 150, 587, 477.0, "7479bfae3ba68035"),
    "3-1-2": ("1", "running", 150, 587, 477.0, "64bfadd2ee4647b9"),
    "3-2-1": ("1", "running", 150, 306, 196.0, "b4a3b1bf2a291459"),
    "3-2-2": ("1", "running", 150, 306, 196.0, "329aa68fec616321"),
    "random": ("1", "running", 150, 392, 282.0, "9f53068d2a6d5061"),
}


def wander(config, seed, limit=150):
    """An episode by a fixed rule: turn right at every known obstacle or edge, and left at every seventh step."""
    episode, heading = Episode.begin(config, seed=seed), 1
    for number in range(limit):
        if episode.ended:
            break
        heading = (heading + 3 * (number % 7 == 6)) % 4
        for _ in range(4):
            row, col = episode.position
            r, c = row + (heading == 2) - (heading == 0), col + (heading == 1) - (heading == 3)
            if 0 <= r < config.rows and 0 <= c < config.cols and episode.codes[r, c] != 3:
                break
            heading = (heading + 1) % 4
        episode.step(heading)
    return episode


@pytest.mark.parametrize("level", sorted(LEVELS))
def test_recorded_episodes_come_out_as_they_were(level):
    record = wander(EnvConfig.of(level, (21, 30)), 12).record()
    found = (record.outcome, record.steps, record.discovered, record.total)
    assert (CORE_VERSION, *found, record.trajectory_hash[:16]) == GOLDEN[level]
