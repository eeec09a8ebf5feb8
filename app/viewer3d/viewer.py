"""The 3-D view of every session: viser's client page and its websocket inside our app, one mirror for each browser that looks.

`ViserServer` builds its transport from `viser.infra.WebsockServer`; here that class is `viser_transport.Transport`.
"""

from __future__ import annotations

import asyncio
import gzip
import logging
import zlib
from pathlib import Path
from unittest import mock

import numpy as np
import viser
import viser.infra
from starlette.requests import Request
from starlette.responses import Response
from starlette.websockets import WebSocket

from app.play.paired_board import PairedBoardListener, paired_episode
from app.play.session import Session
from app.viewer3d.camera import View
from app.viewer3d.scene import Scene
from app.viewer3d.textures import NIGHT
from app.viewer3d.viser_transport import PROTOCOL, Connection, Transport

CLIENT = Path(viser.__file__).parent / "client" / "build" / "index.html"

logger = logging.getLogger(__name__)

INJECTED = (
    "<style>[data-floating-window],[data-dock-region],.mantine-Notifications-root,.mantine-Paper-root{display:none!important}"
    "html,body,:has(>canvas),:has(>div>canvas),:has(>div>div>canvas),:has(>div>div>div>canvas)"
    "{background:#0e0b0d!important}</style>"
    "<script>document.hasFocus=()=>true</script>"
    '<script src="../../static/viewer/software_canvas.js"></script>'
)
"""Ahead of viser's own: hides its panels, lets it reconnect while the page around it has the focus, and shows what a
processor draws without the page waiting for it."""

POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; worker-src blob: data:; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; connect-src 'self' blob: data:; "
    "frame-ancestors 'self'"
)


class Viewer:
    """The 3-D view of every session. Construct it on the running loop; `close` ends it."""

    def __init__(self) -> None:
        with (
            mock.patch.object(viser.infra, "WebsockServer", Transport),
            mock.patch("rich.print"),
        ):
            self._server = viser.ViserServer(host="asgi", port=0, verbose=False)
        transport = self._server._websock_server
        assert isinstance(transport, Transport), "this viser builds its transport another way; see viser_transport.py"
        self._transport = transport
        self._mirrors: dict[int, asyncio.Task[None]] = {}
        self._dress()
        self._server.on_client_connect(self._welcome)
        self._server.on_client_disconnect(self._dismiss)
        page = CLIENT.read_bytes().replace(b"<head>", b"<head>" + INJECTED.encode(), 1)
        self._page, self._zipped = page, gzip.compress(page, 6, mtime=0)
        self._etag = f'"{PROTOCOL}-{zlib.crc32(page):08x}"'

    def _dress(self) -> None:
        """Set what all boards share: dark theme, light, night around."""
        server = self._server
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(False)
        server.scene.configure_environment_map(None)
        server.scene.add_light_ambient("/sky", intensity=1.5)
        server.scene.add_light_directional(
            "/sun", color=(255, 226, 196), intensity=2.4, position=(-30, -20, 50), cast_shadow=False
        )
        server.scene.set_background_image(np.full((2, 2, 3), NIGHT, np.uint8), format="png")

    @property
    def clients(self) -> int:
        """How many browsers look."""
        return len(self._transport.sessions)

    def html(self, request: Request) -> Response:
        """Return viser's client, the same for every session; its version and content are its ETag."""
        headers = {
            "ETag": self._etag,
            "Cache-Control": "private, no-cache",
            "Vary": "Accept-Encoding",
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "same-origin",
        }
        if request.headers.get("if-none-match") == self._etag:
            return Response(status_code=304, headers=headers)
        if "gzip" in request.headers.get("accept-encoding", ""):
            return Response(self._zipped, media_type="text/html", headers={**headers, "Content-Encoding": "gzip"})
        return Response(self._page, media_type="text/html", headers=headers)

    async def serve(self, websocket: WebSocket, session: Session) -> None:
        """Serve one browser's 3-D socket until it goes."""
        if PROTOCOL not in websocket.scope.get("subprotocols", []):
            await websocket.accept()
            await websocket.close(1002, f"expected the subprotocol {PROTOCOL}; reload the page")
            return
        await websocket.accept(subprotocol=PROTOCOL)
        await self._transport.serve(Connection(websocket), session)

    def close(self) -> None:
        """End every mirror and every connection."""
        for task in self._mirrors.values():
            task.cancel()
        self._server.stop()

    async def _welcome(self, client: viser.ClientHandle) -> None:
        session = self._transport.sessions.get(client.client_id)
        if session is not None:
            task = self._mirrors[client.client_id] = asyncio.create_task(mirror(client, session))
            task.add_done_callback(lambda task: self._report(client.client_id, task))

    def _report(self, client_id: int, task: asyncio.Task[None]) -> None:
        """Say in the log why a mirror broke, and close its socket: viser's client connects again by itself."""
        error = None if task.cancelled() else task.exception()
        if error is None:
            return
        logger.error("the 3-D view of a session broke; its browser will connect again", exc_info=error)
        state = self._transport._client_state_from_id.get(client_id)
        if state is not None:
            state.message_buffer.set_done()

    async def _dismiss(self, client: viser.ClientHandle) -> None:
        task = self._mirrors.pop(client.client_id, None)
        if task is not None:
            task.cancel()


async def mirror(client: viser.ClientHandle, session: Session) -> None:
    """Keep one browser's scene like the session's board, from now until cancelled."""
    scene: Scene | None = None
    view = View(client)
    with session.channel.subscribe() as subscriber, PairedBoardListener(session, subscriber.wake) as paired_board:
        async for _ in subscriber:
            paired_board.update()
            episode = session.episode
            with client.atomic():
                if scene is None:
                    scene = Scene(client.scene, episode, session.is_second)
                scene.show(episode)
                scene.show_ghost(paired_episode(session))
                view.show(episode.config.rows, episode.config.cols)
            client.flush()
