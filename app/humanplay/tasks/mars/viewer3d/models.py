"""The scene's bodies, in metres: rocks, the rover's parts and flat marks."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
import viser
from numpy.typing import NDArray

Corners = NDArray[np.float32]
Faces = NDArray[np.uint32]

PALE, DARK, CELLS = (236, 229, 220), (46, 42, 44), (44, 52, 78)
ROCK_SHAPES = 4
AROUND = ((-1, -1), (1, -1), (1, 1), (-1, 1))
"""Corners (x, y) of a square about the origin."""
DASH = ((-0.3, -0.11), (0.3, -0.11), (0.3, 0.11), (-0.3, 0.11))
"""Corners of a dash of the paired path around the middle of its step: along and across it, in steps."""


def rock(shape: int) -> tuple[Corners, Faces]:
    """Return corners[25, 3] and faces[46, 3] of a worn rock on one square metre.

    It is about a metre high, with a blunt top.

    shape  0 .. ROCK_SHAPES - 1: which corners stand out follows from it
    """
    rng = np.random.default_rng(shape)
    turn = np.linspace(0, 2 * np.pi, 8, endpoint=False) + rng.uniform(0, 0.7)
    rings = []
    for height, radius in ((0.0, 0.56), (0.34, 0.53), (0.74, 0.36)):
        worn = radius * rng.uniform(0.82, 1.1, 8)
        heights = height + rng.uniform(-0.05, 0.08, 8)
        rings.append(np.stack([np.cos(turn) * worn, np.sin(turn) * worn, heights], axis=1))
    rings[0][:, 2] = 0.0
    top = np.array([[rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), 0.97]])
    faces = [[16 + side, 16 + (side + 1) % 8, 24] for side in range(8)]
    for low in (0, 8):
        for side in range(8):
            one, two = low + side, low + (side + 1) % 8
            faces += [[one, two, two + 8], [one, two + 8, one + 8]]
    corners = np.clip(np.vstack([*rings, top]), -0.6, 1.1)
    return corners.astype(np.float32), np.array(faces, np.uint32)


def wall() -> tuple[Corners, Faces]:
    """Return corners[8, 3] and faces[10, 3] of a one-metre cube without underside."""
    low = [(0.5 * x, 0.5 * y, 0.0) for x, y in AROUND]
    faces = [[4, 5, 6], [4, 6, 7]]
    for one, two in ((0, 1), (1, 2), (2, 3), (3, 0)):
        faces += [[one, two, two + 4], [one, two + 4, one + 4]]
    return np.array([*low, *((x, y, 1.0) for x, y, _ in low)], np.float32), np.array(
        faces, np.uint32
    )


ROCKS = (*(rock(shape) for shape in range(ROCK_SHAPES)), wall())
WALL = ROCK_SHAPES
"""The shape of what a building is made of, after those of rocks."""


def linear(colour: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return sRGB 0..255 as linear 0..255, which batched meshes and fog use."""
    share = np.clip(colour, 0, 255) / 255
    low, high = share / 12.92, ((share + 0.055) / 1.055) ** 2.4
    colours = np.rint(255 * np.where(share <= 0.04045, low, high))
    return np.asarray(colours, np.uint8)


def shape_of(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return which shape, 0 .. ROCK_SHAPES - 1, the rock on each of cells[n, 2] has."""
    row, col = cells[:, 0], cells[:, 1]
    return np.asarray((row * 5 + col * 3 + row * col) % ROCK_SHAPES)


def add_rocks(
    scene: viser.SceneApi,
    name: str,
    shape: int,
    cells: NDArray[np.int64],
    colour: tuple[int, int, int],
    has_shadows: bool,
) -> viser.BatchedMeshHandle:
    """Add a rock on each of cells[n, 2], (row, col), and return their node.

    Height, turn and colour follow from the cell.
    """
    row, col = cells[:, 0], cells[:, 1]
    grain = (row * 7919 + col * 104729) % 97 / 96
    turn = (row * 31 + col * 17) % 8 * (np.pi / 8)
    still = np.zeros(len(cells))
    width, height = 0.9 + 0.16 * grain, 0.55 + 0.45 * grain
    if shape == WALL:
        width, height, turn, grain = still + 1, still + 0.8, still, still + 0.5
    turns = np.stack([np.cos(turn), still, still, np.sin(turn)], axis=1).astype(np.float32)
    places = np.stack([col, -row, still], axis=1).astype(np.float32)
    scales = np.stack([width, width, height], axis=1).astype(np.float32)
    colours = linear(np.array(colour) * (0.8 + 0.24 * grain[:, None]))
    return scene.add_batched_meshes_simple(
        name,
        *ROCKS[shape],
        turns,
        places,
        batched_scales=scales,
        batched_colors=colours,
        cast_shadow=has_shadows,
        receive_shadow=has_shadows,
        flat_shading=True,
        lod="off",
    )


def add_rover(
    scene: viser.SceneApi, accent: tuple[int, int, int], has_shadows: bool
) -> viser.FrameHandle:
    """Add the rover, facing east (+x), and return the frame that holds its parts."""
    rover = scene.add_frame("/rover", show_axes=False)
    for name, colour, size, position in (
        ("body", PALE, (0.72, 0.46, 0.2), (0.0, 0.0, 0.36)),
        ("deck", accent, (0.66, 0.5, 0.06), (-0.02, 0.0, 0.49)),
        ("panel", CELLS, (0.34, 0.9, 0.04), (-0.22, 0.0, 0.55)),
        ("power", DARK, (0.2, 0.2, 0.2), (-0.46, 0.0, 0.5)),
        ("mast", PALE, (0.07, 0.07, 0.46), (0.27, 0.0, 0.72)),
        ("head", accent, (0.16, 0.36, 0.15), (0.3, 0.0, 1.0)),
        ("eyes", DARK, (0.03, 0.26, 0.08), (0.39, 0.0, 1.0)),
        ("arm", PALE, (0.3, 0.06, 0.06), (0.48, 0.12, 0.34)),
    ):
        scene.add_box(
            f"/rover/{name}",
            color=colour,
            dimensions=size,
            position=position,
            cast_shadow=has_shadows,
            receive_shadow=False,
        )
    for number, (x, y) in enumerate(product((-0.33, 0.0, 0.33), (-0.36, 0.36))):
        scene.add_cylinder(
            f"/rover/wheel{number}",
            radius=0.16,
            height=0.14,
            color=DARK,
            radial_segments=12,
            position=(x, y, 0.16),
            wxyz=(0.7071, 0.7071, 0.0, 0.0),  # lying
            cast_shadow=has_shadows,
            receive_shadow=False,
        )
    return rover


def circle(radius: float, pieces: int, height: float) -> Corners:
    """Return segments[pieces, 2, 3] of a level circle around the origin, metres."""
    turn = np.linspace(0, 2 * np.pi, pieces + 1)
    level = np.full_like(turn, height)
    points = np.stack([np.cos(turn) * radius, np.sin(turn) * radius, level], axis=1)
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def sector(radius: float, width: float, pieces: int) -> tuple[Corners, Faces]:
    """Return corners[pieces + 2, 3] and faces[pieces, 3] of a flat sector towards +x.

    radius  metres
    width   of the sector, radians
    """
    turn = np.linspace(-width / 2, width / 2, pieces + 1)
    rim = np.stack([np.cos(turn) * radius, np.sin(turn) * radius, np.zeros_like(turn)], axis=1)
    faces = np.array([[0, number + 1, number + 2] for number in range(pieces)], np.uint32)
    return np.vstack([np.zeros((1, 3)), rim]).astype(np.float32), faces


def squares(cells: NDArray[np.int64]) -> tuple[Corners, Faces]:
    """Return corners[4 n, 3] and faces[2 n, 3] of squares on cells[n, 2], (row, col)."""
    around = 0.46 * np.array(AROUND)
    middles = np.stack([cells[:, 1], -cells[:, 0]], axis=1)[:, None]
    return flat(np.asarray(middles + around), 0.0)


def star() -> tuple[Corners, Faces]:
    """Return corners[17, 3] and faces[16, 3] of a flat eight-pointed star."""
    turn = np.arange(16) * np.pi / 8
    rim = np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.tile([[0.55], [0.95]], (8, 1))
    corners = np.hstack([np.vstack([rim, [[0.0, 0.0]]]), np.zeros((17, 1))])
    faces = [[n, (n + 1) % 16, 16] for n in range(16)]
    return corners.astype(np.float32), np.array(faces, np.uint32)


def dashes(path: Sequence[tuple[int, int]]) -> tuple[Corners, Faces]:
    """Return corners[4 n, 3] and faces[2 n, 3] of flat dashes along (row, col)."""
    steps = {frozenset((one, two)): (one, two) for one, two in pairwise(path) if one != two}
    cells = np.array(list(steps.values()), np.float32).reshape(-1, 2, 2)
    places = np.stack([cells[..., 1], -cells[..., 0]], axis=-1)
    middle, ahead = places.mean(axis=1), places[:, 1] - places[:, 0]
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    corners = [middle + long * ahead + wide * aside for long, wide in DASH]
    return flat(np.stack(corners, axis=1), 0.05)


def relief(rows: int, cols: int) -> tuple[Corners, Faces]:
    """Return corners and faces of the dunes around a board; equal sizes, equal dunes.

    They begin below its edge and rise with the distance from it, so that they hide nothing of it.
    """
    wide, step = 0.45 * max(rows, cols), max(1.0, max(rows, cols) / 28)
    x = np.arange(-wide, cols + wide + step, step) - 0.5
    y = np.arange(-rows - wide, wide + step, step) + 0.5
    across, along = np.meshgrid(x, y)
    outside = np.maximum(
        np.maximum(-0.5 - across, across - cols + 0.5), np.maximum(along - 0.5, 0.5 - rows - along)
    )
    rng = np.random.default_rng(rows * 1009 + cols)
    swell = np.sin(across / (3 * step) + 1.7 * np.sin(along / (5 * step))) * np.cos(
        along / (4 * step)
    )
    rough = 0.5 + 0.4 * swell + 0.3 * rng.standard_normal(across.shape)
    height = -0.12 + 0.4 * np.clip(outside, 0, 4) * np.clip(rough, 0.05, None)
    corners = np.stack([across, along, height], axis=-1).reshape(-1, 3).astype(np.float32)
    ids = np.arange(across.size, dtype=np.uint32).reshape(across.shape)
    squares_of = np.stack(
        [ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]], axis=-1
    ).reshape(-1, 4)
    squares_of = squares_of[(outside.reshape(-1)[squares_of] > 0).any(axis=1)]
    return corners, np.vstack([squares_of[:, [0, 1, 2]], squares_of[:, [0, 2, 3]]])


def flat(corners: NDArray[np.float64], height: float) -> tuple[Corners, Faces]:
    """Return corners[4 n, 3], faces[2 n, 3] of level quadrilaterals corners[n, 4, 2]."""
    points = corners.reshape(-1, 2)
    level = np.hstack([points, np.full((len(points), 1), height)]).astype(np.float32)
    first = 4 * np.arange(len(corners), dtype=np.uint32)[:, None, None]
    return level, (first + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)).reshape(-1, 3)
