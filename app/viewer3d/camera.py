"""The camera of the 3-D view: all of the board with north at the top, or behind the rover as it goes, through dusty air."""

from __future__ import annotations

import time

import numpy as np
import viser

from app.viewer3d.textures import DUST
from app.viewer3d.view_options import ViewOptions

TILT, FOV, FILLED = float(np.deg2rad(54)), float(np.deg2rad(30)), 0.97
"""Of the map: above the horizon, vertical angle of view (radians), and the share of the view that a board may fill."""
FOLLOW_TILT, FOLLOW_FOV, CELLS_ACROSS = float(np.deg2rad(33)), float(np.deg2rad(42)), 15.0
"""Behind the rover: the same two angles, and how many cells at its distance the view is wide at least."""

CLEAR, OPAQUE = 1.0, 4.7
"""With effects, haze begins at the first and hides everything at the second, in distances of what the camera looks at: ground
at the upper edge of the view is hazed by 8 % on the map and by 44 % behind the rover."""

SETTLING_S = 5.0
"""After the camera was pointed, what a browser says of it is old until it says the same, for so many seconds at most."""


def camera_for(rows: int, cols: int, aspect: float) -> tuple[float, float]:
    """Return (y, distance): what the camera looks at and from how far, so that all of a board fits and is centred.

    aspect   width of the view over its height
    """
    x, y, z = np.meshgrid([-cols / 2, cols / 2], [0.5 - rows, 0.5], [0.0, 1.0])
    targets = (1 - rows) / 2 + np.linspace(-0.35, 0.35, 141)[:, None] * rows
    up = (y.ravel() - targets) * np.sin(TILT) + z.ravel() * np.cos(TILT)
    ahead = (y.ravel() - targets) * np.cos(TILT) - z.ravel() * np.sin(TILT)
    tall = FILLED * np.tan(FOV / 2)
    distances = np.maximum(np.abs(up) / tall, np.abs(x.ravel()) / (tall * aspect)) - ahead
    distance = distances.max(axis=1)
    heights = up / (distance[:, None] + ahead)
    best = int(np.abs(heights.max(axis=1) + heights.min(axis=1)).argmin())
    return float(targets[best, 0]), float(distance[best])


class BoardCamera:
    """Points one browser's camera at the board or at the rover, and again whenever the board or the view changes its shape.

    In between the direction and the distance that the user has chosen by the mouse stay; a followed rover takes them along.
    """

    def __init__(self, client: viser.ClientHandle, options: ViewOptions) -> None:
        self._client, self._options = client, options
        self._board, self._aspect, self._rover = (0, 0), 0.0, (0.0, 0.0)
        self._offset, self._pointed_s = np.zeros(3), 0.0
        client.camera.on_update(self._on_update)

    def show(self, rows: int, cols: int, rover: tuple[float, float]) -> None:
        """Look at a board of this size with its rover at (x, y), metres."""
        before, self._rover = self._rover, rover
        if self._board != (rows, cols):
            self._board = rows, cols
            self._point()
        elif rover != before and self._options.follows(rows, cols):
            self._look_at(*rover)

    async def _on_update(self, camera: viser.CameraHandle) -> None:
        if self._board == (0, 0):
            return
        if abs(aspect_of(camera) / self._aspect - 1) > 0.02:
            self._point()
            self._client.flush()
            return
        offset = np.asarray(camera.position) - np.asarray(camera.look_at)
        if self._pointed_s + SETTLING_S < time.monotonic() or np.allclose(
            offset, self._offset, atol=0.2
        ):
            self._pointed_s = 0.0
        if self._pointed_s == 0.0:
            self._offset = offset

    def _point(self) -> None:
        """Take the camera's own place for this board, whatever the user had chosen."""
        camera, (rows, cols) = self._client.camera, self._board
        self._aspect, self._pointed_s = aspect_of(camera), time.monotonic()
        if self._options.follows(rows, cols):
            fov, tilt, (x, y) = FOLLOW_FOV, FOLLOW_TILT, self._rover
            distance = CELLS_ACROSS / (2 * np.tan(fov / 2) * min(self._aspect, 1.4))
        else:
            fov, tilt, x = FOV, TILT, (cols - 1) / 2
            y, distance = camera_for(rows, cols, self._aspect)
        self._offset = distance * np.array([0.0, -np.cos(tilt), np.sin(tilt)])
        with self._client.atomic():
            camera.fov = fov
            camera.far = max(1000.0, 4 * distance)
            camera.up_direction = (0.0, 0.0, 1.0)
            if self._options.has_effects:
                self._client.scene.configure_fog(CLEAR * distance, OPAQUE * distance, color=DUST)
        self._look_at(x, y)

    def _look_at(self, x: float, y: float) -> None:
        """Look at a place on the ground from the direction and the distance that hold now."""
        target, camera = np.array([x, y, 0.0]), self._client.camera
        with self._client.atomic():
            camera.position = target + self._offset
            camera.look_at = target


def aspect_of(camera: viser.CameraHandle) -> float:
    """Return width over height of a view, within what a screen can have."""
    return min(max(camera.image_width / max(camera.image_height, 1), 0.1), 10.0)
