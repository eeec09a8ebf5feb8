"""The 3-D mirror of one board, for one viewer: soil, fog, rocks, rover, trail and the reach of the lidar.

Built from what the rover knows (`Episode.codes`, `Episode.path`) and nothing else, so it cannot show what is hidden. This is
where metres begin: a cell is one metre, x = col, y = -row, z is up, so north is at the top and west at the left.
The soil is a fixed picture for each size; the fog over it is a small picture with alpha, sent anew after each move.
"""

from __future__ import annotations

import io
from functools import lru_cache
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image

from marsexplorer.config import ACTIONS, OBSTACLE, UNKNOWN
from marsexplorer.episode import Episode

NIGHT = (14, 11, 13)
SOIL = (181, 101, 58)
ROCK = (94, 74, 70)
PLAYER, RIVAL = (255, 179, 71), (95, 208, 197)
PALE, DARK = (232, 224, 214), (46, 42, 44)

CLEAR, FOG, EDGE, SHADE = range(4)
FOG_COLOURS = bytes([0, 0, 0, *NIGHT, 255, 214, 150, 40, 24, 20])
FOG_ALPHA = bytes([0, 255, 46, 150])
"""Of clear ground, the unknown, known cells that border on it, and the ground under rocks."""

FACING_UP = (0.0, 1.0, 0.0, 0.0)
TRAIL_CHUNK = 32
BOX_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)], np.float32)
BOX_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [1, 5, 7], [1, 7, 3]], np.uint32
)


def linear(colour: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return sRGB 0..255 as the linear 0..255 that batched meshes are drawn with."""
    share = np.clip(colour, 0, 255) / 255
    low, high = share / 12.92, ((share + 0.055) / 1.055) ** 2.4
    colours: NDArray[np.uint8] = np.rint(255 * np.where(share <= 0.04045, low, high)).astype(np.uint8)
    return colours


def pixels_a_cell(side: int) -> int:
    """Return how many pixels a cell of soil and fog gets on a board with this longer side."""
    return 8 if side <= 32 else 4


@lru_cache(maxsize=16)
def soil(rows: int, cols: int) -> bytes:
    """Return the ground as a JPEG, the same for every terrain of a size: value noise and a faint grid."""
    scale = pixels_a_cell(max(rows, cols))
    height, width = rows * scale, cols * scale
    rng = np.random.default_rng(rows * 1009 + cols)
    noise = np.zeros((height, width))
    for cells, weight in ((max(rows, cols) / 9, 0.5), (max(rows, cols) / 3, 0.3), (max(rows, cols) * 1.5, 0.2)):
        coarse = rng.random((max(2, round(cells * rows / max(rows, cols))), max(2, round(cells * cols / max(rows, cols)))))
        blurred = Image.fromarray(coarse.astype(np.float32)).resize((width, height), Image.Resampling.BICUBIC)
        noise += weight * np.asarray(blurred)
    ground = np.array(SOIL) * (0.74 + 0.5 * noise[..., None])
    lines = (np.arange(height)[:, None] % scale == 0) | (np.arange(width)[None] % scale == 0)
    ground[lines] *= 0.88
    return encoded(Image.fromarray(np.clip(ground, 0, 255).astype(np.uint8)), format="JPEG", quality=82)


def encoded(image: Image.Image, **options: Any) -> bytes:
    """Return a picture's file."""
    file = io.BytesIO()
    image.save(file, **options)
    return file.getvalue()


def fog(codes: NDArray[np.uint8]) -> bytes:
    """Return the fog over codes[rows, cols] as a PNG with a palette and alpha."""
    unknown = codes == UNKNOWN
    near = np.pad(unknown, 1)
    borders = near[:-2, 1:-1] | near[2:, 1:-1] | near[1:-1, :-2] | near[1:-1, 2:]
    picture = np.where(unknown, FOG, np.where(codes == OBSTACLE, SHADE, np.where(borders, EDGE, CLEAR))).astype(np.uint8)
    scale = pixels_a_cell(max(codes.shape)) // 2
    image = Image.fromarray(picture.repeat(scale, 0).repeat(scale, 1), "P")
    image.putpalette(FOG_COLOURS)
    return encoded(image, format="PNG", transparency=FOG_ALPHA, compress_level=1)


class Scene:
    """One viewer's picture of one episode: build it, then `sync` after each move; only what changed is sent."""

    def __init__(self, scene: viser.SceneApi, episode: Episode, is_rival: bool) -> None:
        self._scene, self.episode = scene, episode
        self._accent = RIVAL if is_rival else PLAYER
        self._drawn, self._rocks_known = -1, 0
        rows, cols = episode.config.rows, episode.config.cols
        self._add_ground(rows, cols)
        self._add_rover()
        self._add_reach(episode.config.sensor_radius)
        self._add_border(rows, cols)
        self.sync()

    def sync(self) -> None:
        """Bring the picture to where the episode stands."""
        episode = self.episode
        if episode.steps == self._drawn:
            return
        self._fog._data = fog(episode.codes)
        self._show_rocks(episode.codes)
        row, col = episode.position
        self._rover.position = (float(col), -float(row), 0.0)
        quarter = ACTIONS.index(episode.heading)
        turn = np.pi / 2 * (1 - quarter)
        self._rover.wxyz = (float(np.cos(turn / 2)), 0.0, 0.0, float(np.sin(turn / 2)))
        self._show_trail(max(self._drawn, 0))
        self._drawn = episode.steps

    def _add_ground(self, rows: int, cols: int) -> None:
        centre = ((cols - 1) / 2, -(rows - 1) / 2)
        blank = np.zeros((2, 2, 3), np.uint8)
        flat: dict[str, Any] = {"wxyz": FACING_UP, "cast_shadow": False, "receive_shadow": False}
        ground = self._scene.add_image("/soil", blank, cols, rows, format="jpeg", position=(*centre, 0.0), **flat)
        ground._data = soil(rows, cols)
        veil = np.zeros((2, 2, 4), np.uint8)
        self._fog = self._scene.add_image("/fog", veil, cols, rows, format="png", position=(*centre, 0.02), **flat)

    def _add_border(self, rows: int, cols: int) -> None:
        x, y = cols - 0.5, 0.5 - rows
        corners = np.array([[-0.5, 0.5, 0.03], [x, 0.5, 0.03], [x, y, 0.03], [-0.5, y, 0.03]], np.float32)
        segments = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        self._scene.add_line_segments("/border", segments, colors=(92, 70, 62), thickness=1.5, thickness_units="screen")

    def _add_rover(self) -> None:
        plain: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}
        scene = self._scene
        self._rover = scene.add_frame("/rover", show_axes=False)
        scene.add_box("/rover/body", color=PALE, dimensions=(0.78, 0.58, 0.2), position=(0, 0, 0.36), **plain)
        scene.add_box("/rover/deck", color=self._accent, dimensions=(0.62, 0.62, 0.07), position=(-0.07, 0, 0.5), **plain)
        scene.add_box("/rover/mast", color=PALE, dimensions=(0.08, 0.08, 0.42), position=(0.27, 0, 0.68), **plain)
        scene.add_box("/rover/head", color=self._accent, dimensions=(0.18, 0.3, 0.15), position=(0.31, 0, 0.94), **plain)
        wheel: dict[str, Any] = {"color": DARK, "radius": 0.16, "height": 0.15, "radial_segments": 14, **plain}
        for number, (x, y) in enumerate((x, y) for x in (-0.32, 0.0, 0.32) for y in (-0.37, 0.37)):
            scene.add_cylinder(f"/rover/wheel{number}", position=(x, y, 0.16), wxyz=(0.7071, 0.7071, 0.0, 0.0), **wheel)

    def _add_reach(self, radius: int) -> None:
        turn = np.linspace(0, 2 * np.pi, 73)
        ring = np.stack([np.cos(turn) * radius, np.sin(turn) * radius, np.full_like(turn, 0.06)], 1).astype(np.float32)
        segments = np.stack([ring[:-1:2], ring[1::2]], axis=1)
        self._scene.add_line_segments("/rover/reach", segments, colors=self._accent, thickness=1.5, thickness_units="screen")

    def _show_rocks(self, codes: NDArray[np.uint8]) -> None:
        row, col = np.nonzero(codes == OBSTACLE)
        if len(row) == self._rocks_known:
            return
        self._rocks_known = len(row)
        grain = (row * 7919 + col * 104729) % 97 / 96
        positions = np.stack([col, -row, np.zeros(len(row))], axis=1).astype(np.float32)
        scales = np.stack([np.full(len(row), 0.97), np.full(len(row), 0.97), 0.62 + 0.42 * grain], axis=1).astype(np.float32)
        colours = linear(np.array(ROCK) * (0.82 + 0.36 * grain[:, None]))
        upright = np.tile(np.array([1, 0, 0, 0], np.float32), (len(row), 1))
        self._scene.add_batched_meshes_simple(
            "/rocks",
            BOX_CORNERS,
            BOX_FACES,
            upright,
            positions,
            batched_scales=scales,
            batched_colors=colours,
            flat_shading=True,
            lod="off",
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _show_trail(self, since: int) -> None:
        """Draw the path from step `since` on, in chunks, so that a move sends only the last one."""
        path = self.episode.path
        for start in range(since // TRAIL_CHUNK * TRAIL_CHUNK, len(path) - 1, TRAIL_CHUNK):
            cells = np.array(path[start : start + TRAIL_CHUNK + 1], np.float32)
            points = np.stack([cells[:, 1], -cells[:, 0], np.full(len(cells), 0.08)], axis=1).astype(np.float32)
            segments = np.stack([points[:-1], points[1:]], axis=1)
            self._scene.add_line_segments(
                f"/trail/{start}", segments, colors=self._accent, thickness=3.0, thickness_units="screen"
            )


def look_at_board(client: viser.ClientHandle, rows: int, cols: int) -> None:
    """Point a viewer's camera at a board so that all of it fits, whatever the shape of either."""
    tilt, fov = np.deg2rad(64), np.deg2rad(36)
    reach = np.tan(fov / 2)
    aspect = max(client.camera.aspect, 0.1)
    tall = (rows + 1) / 2 * np.sin(tilt) / reach + (rows + 1) / 2 * np.cos(tilt)
    wide = (cols + 1) / 2 / (reach * aspect) + (rows + 1) / 2 * np.cos(tilt)
    distance = 1.02 * max(tall, wide)
    x, y = (cols - 1) / 2, -(rows - 1) / 2
    y -= 0.02 * rows
    client.camera.up_direction = (0.0, 0.0, 1.0)
    client.camera.fov = float(fov)
    client.camera.position = (x, y - distance * np.cos(tilt), distance * np.sin(tilt))
    client.camera.look_at = (x, y, 0.0)
