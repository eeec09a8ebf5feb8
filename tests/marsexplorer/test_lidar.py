"""The compiled lidar sees what the definition says, cell for cell."""

from itertools import product

import numpy as np
import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.lidar import hides
from marsexplorer.world import Worlds
from tests.support import reference


def seen_from(terrain, row, col, radius):
    rows, cols = terrain.shape
    worlds = Worlds(EnvConfig(rows=rows, cols=cols, sensor_radius=radius))
    worlds.start_on(0, terrain, (row, col))
    return worlds.codes[0] != 0


def differing_cells(terrain, radius):
    """How many (free, other) cell pairs the compiled and literal lidar see unlike."""
    rows, cols = terrain.shape
    literal = reference.visible_from_everywhere(terrain, radius)
    worlds = Worlds(EnvConfig(rows=rows, cols=cols, sensor_radius=radius))
    wrong = 0
    for row, col in zip(*np.nonzero(~terrain), strict=True):
        worlds.start_on(0, terrain, (row, col))
        wrong += int(((worlds.codes[0] != 0) != literal[row, col]).sum())
    return wrong


@pytest.mark.parametrize("terrains", [5, pytest.param(260, marks=pytest.mark.long)])
@pytest.mark.parametrize("radius", range(1, 9))
def test_every_cell_is_seen_as_defined_from_every_free_cell(radius, terrains):
    rng = np.random.default_rng(radius)
    for _ in range(terrains):
        rows, cols = rng.integers(5, 41), rng.integers(5, 41)
        terrain = rng.random((rows, cols)) < rng.uniform(0, 0.5)
        assert differing_cells(terrain, radius) == 0, terrain.astype(int)


def test_the_two_literal_lidars_agree():
    terrain = np.random.default_rng(0).random((9, 12)) < 0.3
    everywhere = reference.visible_from_everywhere(terrain, 4)
    for row, col in np.ndindex(terrain.shape):
        assert (reference.visible(terrain, row, col, 4) == everywhere[row, col]).all()


@pytest.mark.parametrize("radius", [1, 4, 6, 8, 13, 20, 31])
def test_an_open_field_is_a_disc_at_every_radius(radius):
    terrain = np.zeros((70, 75), bool)
    row, col = np.indices(terrain.shape)
    disc = (row - 33) ** 2 + (col - 36) ** 2 <= radius**2
    assert (seen_from(terrain, 33, 36, radius) == disc).all()


def test_hides_agrees_with_fractions():
    cells = list(product(range(-6, 7), repeat=2))
    for q, b in product(cells, cells):
        literal = b not in ((0, 0), q) and reference.crosses_interior(q, b)
        assert hides(*b, *q) == literal, (b, q)
