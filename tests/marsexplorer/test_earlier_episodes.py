"""Recorded episodes: a change of terrains or rules shows here.

CORE_VERSION rises with such a change.
"""

import pytest

from marsexplorer.config import CORE_VERSION
from tests.support.golden_episodes import AGAIN, ROWS, config_of, end_of, terrain_of


def name_of(row):
    return f"{row['level']} {row['rows']}x{row['cols']} seed {row['seed']}"


def is_quick(row):
    """Whether a row belongs to `make test`: small grids, one 21x21 terrain a level."""
    return row["rows"] < 21 or (row["rows"] == 21 and row["seed"] == 0)


PARAMETERS = [
    pytest.param(row, id=name_of(row), marks=() if is_quick(row) else pytest.mark.long)
    for row in ROWS
]


def test_every_terrain_and_configuration_is_the_one_it_was():
    assert CORE_VERSION == "1"
    for row in ROWS:
        assert config_of(row).hash == row["config_hash"], f"{name_of(row)}: {AGAIN}"
        assert terrain_of(row) == row["terrain"], f"{name_of(row)}: {AGAIN}"


@pytest.mark.parametrize("row", PARAMETERS)
def test_every_episode_is_the_one_it_was(row):
    for name, expected in row["episodes"].items():
        assert end_of(row, name) == expected, f"{name}: {AGAIN}"
