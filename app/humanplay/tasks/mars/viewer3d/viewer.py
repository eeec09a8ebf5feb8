"""The 3-D view of every session: a scene and a camera for each browser.

viser's server runs without a port.

`ViserServer` builds its transport from `viser.infra.WebsockServer`; here that class is `viser_transport.Transport`.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from unittest import mock

import numpy as np
import viser
import viser.infra
from starlette.websockets import WebSocket

from humanplay.board.session import Session
from humanplay.tasks.mars.run import View
from humanplay.tasks.mars.viewer3d.client_page import ClientPage
from humanplay.tasks.mars.viewer3d.scene import Scene, ViewOptions
from humanplay.tasks.mars.viewer3d.viser_transport import (
    PROTOCOL,
    Connection,
    ShownBoard,
    Transport,
)

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
    """Return the camera's (y, distance) that centres a board and shows all of it.

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
    """Points one browser's camera at each new board, or at its rover.

    So it does when the view gets another shape. In between, the direction and the distance that the
    user chose by the mouse stay; a followed rover takes them along.
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
        is_late = self._pointed_s + SETTLING_S < time.monotonic()
        if is_late or np.allclose(offset, self._offset, atol=0.2):
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
                self._client.scene.configure_fog(
                    CLEAR * distance, OPAQUE * distance, color=self._options.colours.dust
                )
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


GLIDE, GLIDE_PAUSE_S = (0.2, 0.4, 0.6, 0.8, 1.0), 0.018
"""Shares of a move at which a browser with effects is shown the rover, and the seconds between them."""

GROUND_FIRST_S = 0.25
"""Seconds by which ground and trail of a large board go before the rover, where the processor draws; moves made meanwhile are
drawn together."""

_log = logging.getLogger(__name__)


class Viewer:
    """The 3-D view of every session. Construct it on the running loop; `close` it.

    page  what a browser loads before it opens its socket
    """

    def __init__(self) -> None:
        with mock.patch.object(viser.infra, "WebsockServer", Transport), mock.patch("rich.print"):
            self._server = viser.ViserServer(host="asgi", port=0, verbose=False)
        transport = self._server._websock_server
        assert isinstance(transport, Transport), (
            "this viser builds its transport another way; see viser_transport.py"
        )
        self._transport = transport
        self._tasks: dict[int, asyncio.Task[None]] = {}
        self._set_up_scene()
        self._server.on_client_connect(self._on_connect)
        self._server.on_client_disconnect(self._on_disconnect)
        self.page = ClientPage.load()

    def _set_up_scene(self) -> None:
        """Set what all boards share: a dark theme and no light but a scene's own."""
        server = self._server
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(False)
        server.scene.configure_environment_map(None)

    @property
    def clients(self) -> int:
        """Return how many browsers look."""
        return len(self._transport.boards)

    async def serve(self, websocket: WebSocket, session: object) -> None:
        """Serve one browser's 3-D socket until it leaves; its query has `ViewOptions`."""
        if not isinstance(session, Session):
            raise TypeError(f"expected a board's session, got a {type(session).__name__}")
        if PROTOCOL not in websocket.scope.get("subprotocols", []):
            await websocket.accept()
            reason = f"expected the subprotocol {PROTOCOL}; reload the page"
            await Connection(websocket).close(1002, reason)
            return
        await websocket.accept(subprotocol=PROTOCOL)
        options = ViewOptions.from_query(websocket.query_params)
        await self._transport.serve(Connection(websocket), ShownBoard(session, options))

    def close(self) -> None:
        """End every scene's task and every connection."""
        for task in self._tasks.values():
            task.cancel()
        self._server.stop()

    async def _on_connect(self, client: viser.ClientHandle) -> None:
        board = self._transport.boards.get(client.client_id)
        if board is not None:
            scene = keep_scene(client, board.session, board.options)
            task = self._tasks[client.client_id] = asyncio.create_task(scene)
            task.add_done_callback(lambda task: self._report(client.client_id, task))

    def _report(self, client_id: int, task: asyncio.Task[None]) -> None:
        """Log why a scene broke and close its socket; viser's client reconnects by itself."""
        error = None if task.cancelled() else task.exception()
        if error is None:
            return
        message = "the 3-D view of a session broke; its browser will connect again"
        _log.error(message, exc_info=error)
        state = self._transport._client_state_from_id.get(client_id)
        if state is not None:
            state.message_buffer.set_done()

    async def _on_disconnect(self, client: viser.ClientHandle) -> None:
        task = self._tasks.pop(client.client_id, None)
        if task is not None:
            task.cancel()


def mars_view(session: Session) -> View:
    """Return what may be seen on a board of this task; TypeError on another task's."""
    if not isinstance(session.shown, View):
        raise TypeError(f"the 3-D view shows MarsExplorer, and {session.task.name} is played here")
    return session.shown


def player_board(session: Session) -> Session:
    """Return the player's board of a pair: the session itself unless it is the second."""
    return session.paired_with if session.is_second and session.paired_with is not None else session


def paired_view(session: Session) -> View | None:
    """Return the episode whose path is drawn under the board's own.

    None until the player's episode has ended.

    None also where no board is paired, or where the two are on different terrains.
    """
    other = session.paired_with
    if other is None or not player_board(session).shown.ended:
        return None
    here, there = session.current, other.current
    are_alike = (here.config, here.terrain) == (there.config, there.terrain)
    return mars_view(other) if are_alike else None


@contextmanager
def paired_board_listener(
    session: Session, wake: Callable[[], None]
) -> Iterator[Callable[[], None]]:
    """Call `wake` when the paired board moves, while its path is drawn.

    Yields what is to be called before each drawing: the paired board may be another one by then, and no other is listened to.
    """
    listened_to: Session | None = None
    with ExitStack() as listening:

        def on_change() -> None:
            if player_board(session).shown.ended:
                wake()

        def update() -> None:
            nonlocal listened_to
            if session.paired_with is not listened_to:
                listening.close()
                listened_to = session.paired_with
                if listened_to is not None:
                    listening.callback(listened_to.channel.add_listener(on_change))

        yield update


async def keep_scene(client: viser.ClientHandle, session: Session, options: ViewOptions) -> None:
    """Keep one browser's scene up to date with the session's board, until cancelled."""
    scene: Scene | None = None
    camera = BoardCamera(client, options)
    with (
        session.channel.subscribe() as subscriber,
        paired_board_listener(session, subscriber.wake) as update,
    ):
        async for _ in subscriber:
            update()
            episode = mars_view(session)
            with client.atomic():
                if scene is None:
                    scene = Scene(client.scene, episode, session.is_second, options)
                steps = scene.steps
                scene.show(episode)
                scene.show_paired_path(paired_view(session))
                camera.show(episode.config.rows, episode.config.cols, scene.rover_place)
            client.flush()
            if scene.steps != steps and scene.rover_waits:
                await (glide if options.has_effects else follow)(client, scene, camera)


async def glide(client: viser.ClientHandle, scene: Scene, camera: BoardCamera) -> None:
    """Move the rover, its discoveries and a following camera in a few steps."""
    for share in GLIDE:
        with client.atomic():
            scene.glide(share)
            camera.show(scene.episode.config.rows, scene.episode.config.cols, scene.rover_place)
        client.flush()
        await asyncio.sleep(GLIDE_PAUSE_S)


async def follow(client: viser.ClientHandle, scene: Scene, camera: BoardCamera) -> None:
    """Move the rover and a following camera once ground and trail have been drawn."""
    await asyncio.sleep(GROUND_FIRST_S)
    with client.atomic():
        scene.glide(1.0)
        camera.show(scene.episode.config.rows, scene.episode.config.cols, scene.rover_place)
    client.flush()
