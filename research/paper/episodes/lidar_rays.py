"""The lidar of the authors' repository, compared with the paper's line of sight.

It is not offered for play. `python -m research.paper.episodes.lidar_rays` prints the numbers about
it in docs/paper.md.

`Sensors/lidarSensor.py` of dimikout3/MarsExplorer sends 32 rays from the rover at equal angles. A
ray is sampled at 200 points up to the radius; a point stands for the cell that its coordinates
round to, drawn back onto the grid where it lies outside. The ray ends half a cell beyond the
nearest obstacle cell on it, and at most at the radius. Every cell on it is seen. The distance to
the obstacle is kept in an array of the radius' type: with the whole number 6 of `settings.py` it is
cut to whole cells.

So rays show cells round the corner of an obstacle that no line of centres reaches, they miss some
cells between each other, and rounding shows cells whose centres lie farther away than the radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.terrain import generate
from research.informed.informed import KnownTerrain

RAYS = 32
"""Rays of a scan: `lidar_channels` of the repository's `settings.py`."""

POINTS = 200
"""Points of a ray: the default `resolution` of its lidar."""

TERRAINS = 50
"""Of the level `random` at 21 x 21, seeds 0, 1, 2, ..."""

Cells = NDArray[np.bool_]


@dataclass(frozen=True)
class Scans:
    """Scans by rays compared with exact ones; means, cells a scan.

    The scans are from every free cell of some terrains.

    exact    seen exactly (eq. 4)
    rays     seen by rays
    added    seen only by rays
    beyond   of these, farther away than the radius
    missed   seen exactly and by no ray
    scans    how many scans were compared
    """

    exact: float
    rays: float
    added: float
    beyond: float
    missed: float
    scans: int

    def __str__(self) -> str:
        more = 100 * (self.rays / self.exact - 1)
        return (
            f"{more:.1f} % more cells than exact sight ({self.rays:.1f} a scan, not {self.exact:.1f}): {self.added:.1f} "
            f"others, {self.beyond:.1f} of them beyond the radius; {self.missed:.1f} missed; {self.scans:,} scans"
        )


def ray_cells(
    terrain: Cells, row: int, col: int, radius: int, cuts_distances: bool = True
) -> Cells:
    """The cells that the rays see from a free cell: bool[rows, cols].

    Args:
        terrain: bool[rows, cols], True where blocked.
        row: Of the free cell.
        col: Of the free cell.
        radius: Of the lidar, cells.
        cuts_distances: Whether the distance to an obstacle is cut to whole cells, as it is with a
            radius that is a whole number.
    """
    rows, cols = ray_points(terrain.shape, row, col, np.full(RAYS, float(radius)))
    distances = np.where(terrain[rows, cols], np.hypot(rows - row, cols - col), np.inf).min(axis=0)
    ranges = np.minimum(np.floor(distances) if cuts_distances else distances, radius)
    seen = np.zeros_like(terrain)
    seen[ray_points(terrain.shape, row, col, np.minimum(ranges + 0.5, radius))] = True
    return seen


def ray_points(
    shape: tuple[int, ...], row: int, col: int, lengths: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows and columns, int64[POINTS, RAYS] each, of the cells on rays.

    lengths  float64[RAYS], cells
    """
    angles = np.linspace(0, 2 * np.pi, RAYS, endpoint=False)
    rows = np.round(np.linspace(row, row + lengths * np.cos(angles), POINTS)).astype(np.int64)
    cols = np.round(np.linspace(col, col + lengths * np.sin(angles), POINTS)).astype(np.int64)
    return np.clip(rows, 0, shape[0] - 1), np.clip(cols, 0, shape[1] - 1)


def exact_cells(config: EnvConfig, terrain: Cells) -> Cells:
    """The cells that the lidar shows from each cell, none from an obstacle.

    bool[n, rows, cols]
    """
    views = KnownTerrain(config, terrain).views.astype("<u8").view(np.uint8)
    bits = np.unpackbits(views, axis=1, bitorder="little")[:, : config.n]
    return bits.reshape(config.n, config.rows, config.cols).astype(np.bool_)


def compare_scans(config: EnvConfig, seeds: Sequence[int], cuts_distances: bool = True) -> Scans:
    """How rays differ from exact sight, over every free cell of some terrains."""
    row_of, col_of = np.indices((config.rows, config.cols))
    counts = []
    for seed in seeds:
        terrain = generate(config, seed)
        views = exact_cells(config, terrain)
        for row, col in np.argwhere(~terrain).tolist():
            exact = views[row * config.cols + col]
            rays = ray_cells(terrain, row, col, config.sensor_radius, cuts_distances)
            beyond = (row_of - row) ** 2 + (col_of - col) ** 2 > config.sensor_radius**2
            added = rays & ~exact
            parts = (exact, rays, added, added & beyond, exact & ~rays)
            counts.append([part.sum() for part in parts])
    exact_mean, rays_mean, added_mean, beyond_mean, missed_mean = np.mean(counts, axis=0).tolist()
    return Scans(exact_mean, rays_mean, added_mean, beyond_mean, missed_mean, len(counts))


if __name__ == "__main__":
    words = {True: "cut to whole cells, as in the repository", False: "not cut"}
    for cuts, how in words.items():
        scans = compare_scans(EnvConfig(), range(TERRAINS), cuts)
        print(f"{RAYS} rays, distances {how}: {scans}")
