"""Draw a terrain as the authors' generator does, with other random numbers."""

from __future__ import annotations

from math import ceil, floor

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from marsexplorer.compat.config import CodeConfig, Conf

Corners = tuple[NDArray[np.int64], NDArray[np.int64]]
"""x and y of the obstacles' corners."""


def draw_terrain(config: CodeConfig, seed: int) -> NDArray[np.bool_]:
    """The terrain of a seed, bool[rows, cols], True where blocked, solvable or not."""
    random, conf = np.random.default_rng(seed), config.conf
    corners = _lattice_corners(conf, random) if config.is_lattice else _corners(conf, random)
    sides = conf["obstacle_size"]
    # on a lattice one bound along each axis, itself exclusive
    bounds = [(1, side - 1) for side in sides] if config.is_lattice else [tuple(sides)] * 2
    heights, widths = (
        random.integers(least, most, len(corners[0]), endpoint=True) for least, most in bounds
    )
    terrain = np.zeros((config.rows, config.cols), np.bool_)
    for x, y, height, width in zip(*corners, heights, widths, strict=True):
        terrain[x : x + height, y : y + width] = True
        terrain[x, y] = True
    return terrain


def _corners(conf: Conf, random: Generator) -> Corners:
    """Return corners anywhere within the margins."""
    (rows, cols), (across, down) = conf["size"], conf["margins"]
    y = random.integers(across, cols - 1 - across, conf["obstacles"])
    x = random.integers(down, rows - 1 - down, conf["obstacles"])
    return x, y


def _lattice_corners(conf: Conf, random: Generator) -> Corners:
    """Return a lattice's crossings, each moved by chance."""
    (rows, cols), (down, across) = conf["size"], conf["margins"]
    along_x = np.linspace(down, rows - 1 - down, conf["number_rows"]).astype(np.int64)
    along_y = np.linspace(across, cols - 1 - across, conf["number_columns"]).astype(np.int64)
    x, y = (axis.ravel() for axis in np.meshgrid(along_x, along_y))
    moved = []
    for places, noise, side in zip((x, y), conf["noise"], (rows, cols), strict=True):
        least = -floor(noise)
        most = max(least, ceil(noise) - 1)
        shifts = random.integers(least, most, len(places), endpoint=True)
        moved.append(np.clip(places + shifts, 0, side - 1))
    return moved[0], moved[1]
