"""The 3-D scene of one board in one browser: soil, fog, rocks, rover, trail and the range of the lidar.

It is built from what the rover knows (`Episode.codes`, `Episode.path`) and nothing else, so it cannot show what is hidden.
Metres begin here: a cell is one metre, x = col, y = -row, z is up, so north is at the top and west at the left. The soil is
a fixed picture for each size; the fog over it is a small picture with alpha, which is sent again after each move.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from app.viewer3d.textures import NIGHT, fog, soil
from marsexplorer.config import ACTIONS, OBSTACLE
from marsexplorer.episode import Episode

ROCK = (100, 74, 64)
PLAYER, RIVAL = (255, 179, 71), (95, 208, 197)
PALE, DARK = (232, 224, 214), (46, 42, 44)

FACING_UP = (0.0, 1.0, 0.0, 0.0)
ITEMS_PER_NODE = 32
"""Rocks, and steps of a path, in one node of the scene: a move sends only the last one again."""

DASH = ((-0.3, -0.11), (0.3, -0.11), (0.3, 0.11), (-0.3, 0.11))
"""Corners of a dash of the paired path around the middle of its step: along and across it, in steps."""


def boulder() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return corners[12, 3] and faces[22, 3] of a rock: a block on one square metre, one metre high, narrower at the top."""
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


class Scene:
    """One browser's scene: call `show` with an episode after each of its moves, and then with the next episode.

    Nodes stay and change where they can, so that only what changed is sent. (A node removed and added again under its
    name in one batch would keep its old place: viser sends the later of two messages about a name.)
    """

    def __init__(self, scene: viser.SceneApi, episode: Episode, is_rival: bool) -> None:
        self._scene = scene
        self._accent, self._other = (RIVAL, PLAYER) if is_rival else (PLAYER, RIVAL)
        self._board, self._drawn = (0, 0), -1
        self._paired: Episode | None = None
        self._episode_nodes: list[viser.SceneNodeHandle] = []
        self._add_ground()
        self._add_rover()
        self._add_lidar_range(episode.config.sensor_radius)
        self._begin(episode)
        self.show(episode)

    def show(self, episode: Episode) -> None:
        """Bring the scene up to date with the episode."""
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

    def show_paired_path(self, paired: Episode | None) -> None:
        """Draw the paired board's path so far, dashed and translucent, under this board's own; None removes it."""
        if paired is not self._paired:
            for node in [node for node in self._episode_nodes if node.name.startswith("/paired_path/")]:
                node.remove()
                self._episode_nodes.remove(node)
            self._paired, self._paired_steps = paired, 0
        if paired is None or paired.steps == self._paired_steps:
            return
        for start in range(self._paired_steps // ITEMS_PER_NODE * ITEMS_PER_NODE, paired.steps, ITEMS_PER_NODE):
            corners, faces = dashes(paired.path[start : start + ITEMS_PER_NODE + 1])
            if len(faces):
                self._add_episode_node(add_dashes(self._scene, f"/paired_path/{start}", corners, faces, self._other))
        self._paired_steps = paired.steps

    def _begin(self, episode: Episode) -> None:
        """Remove what the last episode left, its rocks and its trail, and fit the ground to the new one."""
        for node in self._episode_nodes:
            node.remove()
        self._episode_nodes = []
        self._paired, self._paired_steps = None, 0
        self.episode = episode
        self._drawn = -1
        self._shown = np.zeros(episode.codes.shape, np.bool_)
        self._open_rocks: list[tuple[int, int]] = []
        self._rock_nodes = 0
        if self._board != episode.codes.shape:
            self._resize_ground(episode.config.rows, episode.config.cols)

    def _add_ground(self) -> None:
        flat: dict[str, Any] = {"wxyz": FACING_UP, "cast_shadow": False, "receive_shadow": False}
        night = np.full((2, 2, 4), (*NIGHT, 255), np.uint8)
        self._soil = self._scene.add_image("/soil", night[..., :3], 1, 1, format="jpeg", **flat)
        self._fog = self._scene.add_image("/fog", night, 1, 1, format="png", **flat)
        self._border = self._scene.add_line_segments(
            "/border", np.zeros((4, 2, 3), np.float32), colors=(126, 92, 76), thickness=1.5, thickness_units="screen"
        )

    def _resize_ground(self, rows: int, cols: int) -> None:
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

    def _add_lidar_range(self, radius: int) -> None:
        """Draw the range of the lidar, dashed, and a small ring that marks the rover on small boards."""
        dashes, ring = circle(radius, 72, 0.06)[::2], circle(0.66, 24, 0.1)
        for name, segments, thickness in (("reach", dashes, 1.5), ("ring", ring, 2.0)):
            self._scene.add_line_segments(
                f"/rover/{name}", segments, colors=self._accent, thickness=thickness, thickness_units="screen"
            )

    def _show_rocks(self, codes: NDArray[np.uint8]) -> None:
        """Add newly discovered rocks to the last node of rocks, and begin another node when it is full."""
        fresh = (codes == OBSTACLE) & ~self._shown
        if not fresh.any():
            return
        self._shown |= fresh
        self._open_rocks += [(int(row), int(col)) for row, col in np.argwhere(fresh)]
        self._add_episode_node(add_rocks(self._scene, f"/rocks/{self._rock_nodes}", np.array(self._open_rocks)))
        if len(self._open_rocks) >= ITEMS_PER_NODE:
            self._open_rocks, self._rock_nodes = [], self._rock_nodes + 1

    def _add_episode_node(self, node: viser.SceneNodeHandle) -> None:
        """Keep a node that is removed with the episode, in the place of one of the same name."""
        self._episode_nodes = [other for other in self._episode_nodes if other.name != node.name] + [node]

    def _show_trail(self, since: int) -> None:
        """Draw the path from step `since` on, in chunks, so that a move sends only the last one."""
        path = self.episode.path
        for start in range(since // ITEMS_PER_NODE * ITEMS_PER_NODE, len(path) - 1, ITEMS_PER_NODE):
            cells = np.array(path[start : start + ITEMS_PER_NODE + 1], np.float32)
            points = np.stack([cells[:, 1], -cells[:, 0], np.full(len(cells), 0.08)], axis=1).astype(np.float32)
            segments = np.stack([points[:-1], points[1:]], axis=1)
            self._add_episode_node(
                self._scene.add_line_segments(
                    f"/trail/{start}", segments, colors=self._accent, thickness=0.26, thickness_units="world"
                )
            )


def circle(radius: float, pieces: int, height: float) -> NDArray[np.float32]:
    """Return segments[pieces, 2, 3] of a level circle around the origin, metres."""
    turn = np.linspace(0, 2 * np.pi, pieces + 1)
    points = np.stack([np.cos(turn) * radius, np.sin(turn) * radius, np.full_like(turn, height)], axis=1)
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def dashes(path: Sequence[tuple[int, int]]) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return corners[4 n, 3] and faces[2 n, 3] of flat dashes, one over each step of a path of (row, col)."""
    steps = {frozenset((one, two)): (one, two) for one, two in pairwise(path) if one != two}
    cells = np.array(list(steps.values()), np.float32).reshape(-1, 2, 2)
    places = np.stack([cells[..., 1], -cells[..., 0]], axis=-1)
    middle, ahead = places.mean(axis=1), places[:, 1] - places[:, 0]
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    flat = np.stack([middle + long * ahead + wide * aside for long, wide in DASH], axis=1).reshape(-1, 2)
    corners = np.hstack([flat, np.full((len(flat), 1), 0.05, np.float32)]).astype(np.float32)
    first = 4 * np.arange(len(cells), dtype=np.uint32)[:, None, None]
    return corners, (first + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)).reshape(-1, 3)


def add_dashes(
    scene: viser.SceneApi, name: str, corners: NDArray[np.float32], faces: NDArray[np.uint32], colour: tuple[int, int, int]
) -> viser.MeshHandle:
    """Add the dashes of a paired path and return their node."""
    plain: dict[str, Any] = {"side": "double", "flat_shading": True, "cast_shadow": False, "receive_shadow": False}
    return scene.add_mesh_simple(name, corners, faces, color=colour, opacity=0.85, **plain)


def add_rocks(scene: viser.SceneApi, name: str, cells: NDArray[np.int64]) -> viser.BatchedMeshHandle:
    """Add a rock on each of cells[n, 2], (row, col), and return their node; height, turn and colour follow from the cell."""
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
