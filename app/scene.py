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
ROCK = (100, 74, 64)
PLAYER, RIVAL = (255, 179, 71), (95, 208, 197)
PALE, DARK = (232, 224, 214), (46, 42, 44)

CLEAR, FOG, LINE, EDGE, SHADE = range(5)
FOG_COLOURS = bytes([0, 0, 0, 26, 20, 23, 34, 26, 29, 255, 214, 150, 40, 24, 20])
FOG_ALPHA = bytes([0, 255, 255, 46, 150])
"""Of clear ground, the unknown and the lines between its cells, known cells that border on it, the ground under rocks."""

TILT, FOV, FILLED = float(np.deg2rad(64)), float(np.deg2rad(30)), 0.93
"""Of the camera: above the horizon, vertical angle of view (radians), and the share of the view that a board may fill."""

FACING_UP = (0.0, 1.0, 0.0, 0.0)
CHUNK = 32
"""Rocks, and steps of the trail, in one node of the scene: a move sends only the last one again."""


def boulder() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return corners[12, 3] and faces[22, 3] of a rock: a block on one square metre, one high, its shoulders worn."""
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    worn = square * np.array([[0.30, 0.34], [0.36, 0.28], [0.31, 0.35], [0.37, 0.30]])
    heights = np.array([[0.0] * 4, [0.66, 0.58, 0.70, 0.62], [0.96, 1.0, 0.93, 0.99]]).reshape(12, 1)
    corners = np.hstack([np.vstack([square * 0.5, square * 0.48, worn]), heights])
    faces = [[8, 9, 10], [8, 10, 11]]
    for low in (0, 4):
        for side in range(4):
            one, two = low + side, low + (side + 1) % 4
            faces += [[one, two, two + 4], [one, two + 4, one + 4]]
    return corners.astype(np.float32), np.array(faces, np.uint32)


BOULDER = boulder()


def linear(colour: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return sRGB 0..255 as the linear 0..255 that batched meshes are drawn with."""
    share = np.clip(colour, 0, 255) / 255
    low, high = share / 12.92, ((share + 0.055) / 1.055) ** 2.4
    colours: NDArray[np.uint8] = np.rint(255 * np.where(share <= 0.04045, low, high)).astype(np.uint8)
    return colours


def pixels_a_cell(side: int, pixels: int, most: int) -> int:
    """Return how many pixels, 1 to `most`, a cell gets so that the longer side of a picture stays within `pixels`."""
    return max(1, min(most, pixels // side))


@lru_cache(maxsize=16)
def soil(rows: int, cols: int) -> bytes:
    """Return the ground as a JPEG, the same for every terrain of a size: value noise and a faint grid."""
    scale = pixels_a_cell(max(rows, cols), 768, 16)
    height, width = rows * scale, cols * scale
    rng = np.random.default_rng(rows * 1009 + cols)
    noise = np.zeros((height, width))
    for cells, weight in ((max(rows, cols) / 9, 0.5), (max(rows, cols) / 3, 0.3), (max(rows, cols) * 1.5, 0.2)):
        coarse = rng.random((max(2, round(cells * rows / max(rows, cols))), max(2, round(cells * cols / max(rows, cols)))))
        blurred = Image.fromarray(coarse.astype(np.float32)).resize((width, height), Image.Resampling.BICUBIC)
        noise += weight * np.asarray(blurred)
    ground = np.array(SOIL) * (0.74 + 0.5 * noise[..., None])
    lines = (np.arange(height)[:, None] % scale == 0) | (np.arange(width)[None] % scale == 0)
    ground[lines] *= 0.86
    ground *= 1 + 0.05 * rng.standard_normal((height, width, 1))
    return encoded(Image.fromarray(np.clip(ground, 0, 255).astype(np.uint8)), format="JPEG", quality=80)


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
    scale = pixels_a_cell(max(codes.shape), 400, 4)
    picture = picture.repeat(scale, 0).repeat(scale, 1)
    if scale > 2:
        for lines in (picture[::scale], picture[:, ::scale]):
            lines[lines == FOG] = LINE
    image = Image.fromarray(picture, "P")
    image.putpalette(FOG_COLOURS)
    return encoded(image, format="PNG", transparency=FOG_ALPHA, compress_level=1)


class Scene:
    """One viewer's picture of a board: `show` an episode after each of its moves, and then the next one.

    Nodes stay and change where they can, so that only what changed is sent. (A node taken away and added again under its
    name in one batch would keep its old place: viser sends the later of two messages about a name.)
    """

    def __init__(self, scene: viser.SceneApi, episode: Episode, is_rival: bool) -> None:
        self._scene = scene
        self._accent = RIVAL if is_rival else PLAYER
        self._board, self._drawn = (0, 0), -1
        self._passing: list[viser.SceneNodeHandle] = []
        self._add_ground()
        self._add_rover()
        self._add_reach(episode.config.sensor_radius)
        self._begin(episode)
        self.show(episode)

    def show(self, episode: Episode) -> None:
        """Bring the picture to where the episode stands."""
        if episode is not self.episode:
            self._begin(episode)
        if episode.steps == self._drawn:
            return
        self._fog._data = fog(episode.codes)
        self._show_rocks(episode.codes)
        row, col = episode.position
        self._rover.position = (float(col), -float(row), 0.0)
        turn = np.pi / 2 * (1 - ACTIONS.index(episode.heading))
        self._rover.wxyz = (float(np.cos(turn / 2)), 0.0, 0.0, float(np.sin(turn / 2)))
        self._show_trail(max(self._drawn, 0))
        self._drawn = episode.steps

    def _begin(self, episode: Episode) -> None:
        """Take away what the last episode left: its rocks, its trail, its size."""
        for node in self._passing:
            node.remove()
        self._passing = []
        self.episode = episode
        self._drawn = -1
        self._shown = np.zeros(episode.codes.shape, np.bool_)
        self._pile: list[tuple[int, int]] = []
        self._piles = 0
        if self._board != episode.codes.shape:
            self._lay(episode.config.rows, episode.config.cols)

    def _add_ground(self) -> None:
        flat: dict[str, Any] = {"wxyz": FACING_UP, "cast_shadow": False, "receive_shadow": False}
        night = np.full((2, 2, 4), (*NIGHT, 255), np.uint8)
        self._soil = self._scene.add_image("/soil", night[..., :3], 1, 1, format="jpeg", **flat)
        self._fog = self._scene.add_image("/fog", night, 1, 1, format="png", **flat)
        self._border = self._scene.add_line_segments(
            "/border", np.zeros((4, 2, 3), np.float32), colors=(126, 92, 76), thickness=1.5, thickness_units="screen"
        )

    def _lay(self, rows: int, cols: int) -> None:
        """Give soil, fog and border a size."""
        self._board = rows, cols
        self._soil._data = soil(rows, cols)
        for picture, height in ((self._soil, 0.0), (self._fog, 0.02)):
            picture.render_width, picture.render_height = float(cols), float(rows)
            picture.position = ((cols - 1) / 2, -(rows - 1) / 2, height)
        x, y = cols - 0.5, 0.5 - rows
        corners = np.array([[-0.5, 0.5, 0.03], [x, 0.5, 0.03], [x, y, 0.03], [-0.5, y, 0.03]], np.float32)
        self._border.points = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)

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
        """Draw how far the lidar sees, dashed, and a small ring that marks the rover on small boards."""
        dashes, ring = circle(radius, 72, 0.06)[::2], circle(0.66, 24, 0.1)
        for name, segments, thickness in (("reach", dashes, 1.5), ("ring", ring, 2.0)):
            self._scene.add_line_segments(
                f"/rover/{name}", segments, colors=self._accent, thickness=thickness, thickness_units="screen"
            )

    def _show_rocks(self, codes: NDArray[np.uint8]) -> None:
        """Add what has come to light to the open pile, and close it when it is full."""
        fresh = (codes == OBSTACLE) & ~self._shown
        if not fresh.any():
            return
        self._shown |= fresh
        self._pile += [(int(row), int(col)) for row, col in np.argwhere(fresh)]
        self._keep(add_rocks(self._scene, f"/rocks/{self._piles}", np.array(self._pile)))
        if len(self._pile) >= CHUNK:
            self._pile, self._piles = [], self._piles + 1

    def _keep(self, node: viser.SceneNodeHandle) -> None:
        """Remember a node that goes when the episode does, in the place of one of the same name."""
        self._passing = [other for other in self._passing if other.name != node.name] + [node]

    def _show_trail(self, since: int) -> None:
        """Draw the path from step `since` on, in chunks, so that a move sends only the last one."""
        path = self.episode.path
        for start in range(since // CHUNK * CHUNK, len(path) - 1, CHUNK):
            cells = np.array(path[start : start + CHUNK + 1], np.float32)
            points = np.stack([cells[:, 1], -cells[:, 0], np.full(len(cells), 0.08)], axis=1).astype(np.float32)
            segments = np.stack([points[:-1], points[1:]], axis=1)
            self._keep(
                self._scene.add_line_segments(
                    f"/trail/{start}", segments, colors=self._accent, thickness=0.26, thickness_units="world"
                )
            )


def circle(radius: float, pieces: int, height: float) -> NDArray[np.float32]:
    """Return segments[pieces, 2, 3] of a level circle around the origin, metres."""
    turn = np.linspace(0, 2 * np.pi, pieces + 1)
    points = np.stack([np.cos(turn) * radius, np.sin(turn) * radius, np.full_like(turn, height)], axis=1)
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def add_rocks(scene: viser.SceneApi, name: str, cells: NDArray[np.int64]) -> viser.BatchedMeshHandle:
    """Return the node with a rock on each of cells[n, 2], (row, col); height, turn and colour follow from the place."""
    row, col = cells[:, 0], cells[:, 1]
    grain = (row * 7919 + col * 104729) % 97 / 96
    turn = (row * 31 + col * 17) % 4 * (np.pi / 4)
    still = np.zeros(len(cells))
    width = np.ones(len(cells))
    return scene.add_batched_meshes_simple(
        name,
        *BOULDER,
        np.stack([np.cos(turn), still, still, np.sin(turn)], axis=1).astype(np.float32),
        np.stack([col, -row, still], axis=1).astype(np.float32),
        batched_scales=np.stack([width, width, 0.6 + 0.5 * grain], axis=1).astype(np.float32),
        batched_colors=linear(np.array(ROCK) * (0.84 + 0.36 * grain[:, None])),
        flat_shading=True,
        lod="off",
        cast_shadow=False,
        receive_shadow=False,
    )


def camera_for(rows: int, cols: int, aspect: float) -> tuple[float, float]:
    """Return (y, distance): what the camera looks at and from how far, so that all of a board fits and is centred.

    aspect   width of the view over its height
    """
    x, y, z = np.meshgrid([-cols / 2, cols / 2], [0.5 - rows, 0.5], [0.0, 1.2])
    targets = (1 - rows) / 2 + np.linspace(-0.3, 0.3, 121)[:, None] * rows
    up = (y.ravel() - targets) * np.sin(TILT) + z.ravel() * np.cos(TILT)
    ahead = (y.ravel() - targets) * np.cos(TILT) - z.ravel() * np.sin(TILT)
    tall = FILLED * np.tan(FOV / 2)
    distances = np.maximum(np.abs(up) / tall, np.abs(x.ravel()) / (tall * aspect)) - ahead
    distance = distances.max(axis=1)
    heights = up / (distance[:, None] + ahead)
    best = int(np.abs(heights.max(axis=1) + heights.min(axis=1)).argmin())
    return float(targets[best, 0]), float(distance[best])


class View:
    """Where one viewer looks from: north at the top, all of the board in sight, again whenever the view changes shape."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._board, self._aspect = (0, 0), 0.0
        client.camera.on_update(self._reshape)

    def show(self, rows: int, cols: int) -> None:
        """Look at a board of this size; what the viewer has turned to stays when the size is the same."""
        if self._board != (rows, cols):
            self._board = rows, cols
            self._look()

    async def _reshape(self, camera: viser.CameraHandle) -> None:
        if self._board != (0, 0) and abs(aspect_of(camera) / self._aspect - 1) > 0.02:
            self._look()
            self._client.flush()

    def _look(self) -> None:
        camera, (rows, cols) = self._client.camera, self._board
        self._aspect = aspect_of(camera)
        y, distance = camera_for(rows, cols, self._aspect)
        x = (cols - 1) / 2
        with self._client.atomic():
            camera.fov = FOV
            camera.far = max(1000.0, 4 * distance)
            camera.up_direction = (0.0, 0.0, 1.0)
            camera.position = (x, y - distance * np.cos(TILT), distance * np.sin(TILT))
            camera.look_at = (x, y, 0.0)


def aspect_of(camera: viser.CameraHandle) -> float:
    """Return width over height of a view, within what a screen can be."""
    return min(max(camera.image_width / max(camera.image_height, 1), 0.1), 10.0)
