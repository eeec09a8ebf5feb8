"""The rays of the authors' lidar, point by point, as docs/paper.md has them."""

import math
from pathlib import Path

import numpy as np
import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.terrain import generate
from research.paper.episodes.lidar_rays import compare_scans, exact_cells, ray_cells
from tests.support.reference import visible

ROOT = Path(__file__).parents[3]


def literal_ray_cells(terrain, row, col, radius, cuts):
    """One ray and one point after the other, from the description in the module."""
    rows, cols = terrain.shape

    def cells(angle, length):
        for point in range(200):
            share = length * point / 199
            r, c = round(row + share * math.cos(angle)), round(col + share * math.sin(angle))
            yield min(max(r, 0), rows - 1), min(max(c, 0), cols - 1)

    seen = set()
    for ray in range(32):
        angle = 2 * math.pi * ray / 32
        hits = [math.dist((row, col), cell) for cell in cells(angle, radius) if terrain[cell]]
        reach = min(hits, default=radius)
        seen |= set(cells(angle, min((math.floor(reach) if cuts else reach) + 0.5, radius)))
    return seen


@pytest.mark.parametrize("cuts", [True, False])
def test_rays_equal_a_literal_version(cuts):
    terrain = generate(EnvConfig.of("random", (9, 14)), 3)
    for row, col in np.argwhere(~terrain)[::11].tolist():
        seen = np.argwhere(ray_cells(terrain, row, col, 6, cuts)).tolist()
        assert {*map(tuple, seen)} == literal_ray_cells(terrain, row, col, 6, cuts)


def test_exact_cells_are_what_the_lidar_of_the_environment_sees():
    config = EnvConfig.of("random", (9, 14))
    terrain = generate(config, 3)
    views = exact_cells(config, terrain)
    for row, col in np.argwhere(~terrain)[::17].tolist():
        assert (views[row * 14 + col] == visible(terrain, row, col, 6)).all()


def test_rays_see_the_share_more_that_the_document_says():
    """On 3 of the 50 terrains; the document has the numbers of all."""
    for cuts, more, added in ((True, 0.126, 9.2), (False, 0.148, 10.8)):
        scans = compare_scans(EnvConfig(), range(3), cuts)
        assert scans.rays / scans.exact - 1 == pytest.approx(more, abs=0.015)
        assert scans.added == pytest.approx(added, abs=0.8)
        assert scans.added - scans.missed == pytest.approx(scans.rays - scans.exact)
    text = " ".join((ROOT / "docs" / "paper.md").read_text().split())
    assert (
        "13 % more cells than exact sight: 9.2 a scan that exact sight does not show, "
        "7.3 of them beyond the radius"
    ) in text
