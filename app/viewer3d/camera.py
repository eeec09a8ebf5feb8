"""The camera of the 3-D view: north at the top, all of the board in sight."""

from __future__ import annotations

import numpy as np
import viser

TILT, FOV, FILLED = float(np.deg2rad(64)), float(np.deg2rad(30)), 0.93
"""Of the camera: above the horizon, vertical angle of view (radians), and the share of the view that a board may fill."""


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


class BoardCamera:
    """Points one browser's camera at the board, and again whenever the board or the view changes its shape."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._board, self._aspect = (0, 0), 0.0
        client.camera.on_update(self._on_update)

    def show(self, rows: int, cols: int) -> None:
        """Look at a board of this size; the direction that the user has chosen stays when the size is the same."""
        if self._board != (rows, cols):
            self._board = rows, cols
            self._point_at_board()

    async def _on_update(self, camera: viser.CameraHandle) -> None:
        if self._board != (0, 0) and abs(aspect_of(camera) / self._aspect - 1) > 0.02:
            self._point_at_board()
            self._client.flush()

    def _point_at_board(self) -> None:
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
    """Return width over height of a view, within what a screen can have."""
    return min(max(camera.image_width / max(camera.image_height, 1), 0.1), 10.0)
