"""The 3-D view of every session: viser's server without a port, and one scene for each browser that looks.

`ViserServer` builds its transport from `viser.infra.WebsockServer`; here that class is `viser_transport.Transport`.
"""

from __future__ import annotations

import asyncio
import json
import logging
from typing import Any
from unittest import mock

import viser
import viser.infra
from starlette.websockets import WebSocket

from app.play.paired_board import PairedBoardListener, paired_episode
from app.play.session import Session
from app.viewer3d.camera import BoardCamera
from app.viewer3d.client_page import ClientPage
from app.viewer3d.scene import Scene
from app.viewer3d.view_options import ViewOptions
from app.viewer3d.viser_transport import PROTOCOL, Connection, ShownBoard, Transport

GLIDE, GLIDE_PAUSE_S = (0.2, 0.4, 0.6, 0.8, 1.0), 0.018
"""Shares of a move at which a browser with effects is shown the rover, and the seconds between them."""

_log = logging.getLogger(__name__)


class Viewer:
    """The 3-D view of every session. Construct it on the running loop; `close` ends it.

    page  what a browser loads before it opens its socket
    """

    def __init__(self) -> None:
        with (
            mock.patch.object(viser.infra, "WebsockServer", Transport),
            mock.patch("rich.print"),
        ):
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

    async def serve(self, websocket: WebSocket, session: Session, options: ViewOptions) -> None:
        """Serve one browser's 3-D socket until it leaves."""
        if PROTOCOL not in websocket.scope.get("subprotocols", []):
            await websocket.accept()
            await websocket.close(1002, f"expected the subprotocol {PROTOCOL}; reload the page")
            return
        await websocket.accept(subprotocol=PROTOCOL)
        await self._transport.serve(Connection(websocket), ShownBoard(session, options))

    def close(self) -> None:
        """End every scene's task and every connection."""
        for task in self._tasks.values():
            task.cancel()
        self._server.stop()

    async def _on_connect(self, client: viser.ClientHandle) -> None:
        board = self._transport.boards.get(client.client_id)
        if board is not None:
            task = self._tasks[client.client_id] = asyncio.create_task(
                keep_scene(client, board.session, board.options)
            )
            task.add_done_callback(lambda task: self._report(client.client_id, task))

    def _report(self, client_id: int, task: asyncio.Task[None]) -> None:
        """Log why a scene broke and close its socket: viser's client connects again by itself."""
        error = None if task.cancelled() else task.exception()
        if error is None:
            return
        _log.error(
            "the 3-D view of a session broke; its browser will connect again", exc_info=error
        )
        state = self._transport._client_state_from_id.get(client_id)
        if state is not None:
            state.message_buffer.set_done()

    async def _on_disconnect(self, client: viser.ClientHandle) -> None:
        task = self._tasks.pop(client.client_id, None)
        if task is not None:
            task.cancel()


async def keep_scene(client: viser.ClientHandle, session: Session, options: ViewOptions) -> None:
    """Keep one browser's scene up to date with the session's board, until cancelled."""
    scene: Scene | None = None
    camera = BoardCamera(client, options)
    with (
        session.channel.subscribe() as subscriber,
        PairedBoardListener(session, subscriber.wake) as paired_board,
    ):
        async for _ in subscriber:
            paired_board.update()
            episode = session.episode
            with client.atomic():
                if scene is None:
                    scene = Scene(client.scene, episode, session.is_second, options)
                steps = scene.steps
                scene.show(episode)
                scene.show_paired_path(paired_episode(session))
                thought = thought_of(session) if options.shows_thoughts else {}
                scene.show_thought(thought.get("probabilities"))
                scene.show_goal(thought.get("goal"))
                camera.show(episode.config.rows, episode.config.cols, scene.rover_place)
            client.flush()
            if options.has_effects and scene.steps != steps:
                await glide(client, scene, camera)


async def glide(client: viser.ClientHandle, scene: Scene, camera: BoardCamera) -> None:
    """Move the rover, what it has discovered and a camera that follows it to their places in a few steps."""
    for share in GLIDE:
        with client.atomic():
            scene.glide(share)
            camera.show(scene.episode.config.rows, scene.episode.config.cols, scene.rover_place)
        client.flush()
        await asyncio.sleep(GLIDE_PAUSE_S)


def thought_of(session: Session) -> dict[str, Any]:
    """Return the policy's thought about the newest frame, see `messages.Thought`; empty when there is none."""
    if not session.thought or session.episode.ended:
        return {}
    thought: dict[str, Any] = json.loads(session.thought)
    is_newest = (thought["episode"], thought["step"]) == (session.current.id, session.episode.steps)
    return thought if is_newest else {}
