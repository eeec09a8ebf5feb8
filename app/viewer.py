"""viser inside our app: its client page and its websocket, without a port, thread or event loop of its own.

`ViserServer` builds its transport from `viser.infra.WebsockServer`; here that class is one whose connections the app hands
over. Relied on besides the public API (a test fails when an upgrade breaks it): the wire format of `_message_producer`,
`_append_aligned_buffers`, `_ClientHandleState` and `AsyncMessageBuffer`.
"""

from __future__ import annotations

import asyncio
import gzip
import inspect
import itertools
import logging
import threading
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest import mock

import msgspec
import numpy as np
import viser
import viser.infra
import zstandard
from starlette.requests import Request
from starlette.responses import Response
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState
from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.exceptions import ConnectionClosedOK

from app.scene import NIGHT, Scene, View
from app.session import Session

PROTOCOL = f"viser-v{viser.__version__}"
CLIENT = Path(viser.__file__).parent / "client" / "build" / "index.html"
MAX_BYTES = 64 * 1024
WELCOME = frozenset({"ViewerCameraMessage"})
"""What a browser may send: where it looks from, and nothing that opens a tunnel, uploads a file or changes a thing."""

UNSUPPORTED, RUBBISH, TOO_BIG = 1003, 1007, 1009
"""Close codes of RFC 6455: text came, a message that is none of viser's, one too large."""

logger = logging.getLogger(__name__)

INJECTED = (
    "<style>[data-floating-window],[data-dock-region],.mantine-Notifications-root,.mantine-Paper-root{display:none!important}"
    "html,body,:has(>canvas),:has(>div>canvas),:has(>div>div>canvas),:has(>div>div>div>canvas)"
    "{background:#0e0b0d!important}</style>"
    "<script>document.hasFocus=()=>true</script>"
)
"""Hides viser's own panels, and lets it reconnect while the page around it has the focus."""

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; worker-src blob: data:; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; connect-src 'self' blob: data:; "
    "frame-ancestors 'self'"
)


class Refusal(Exception):  # noqa: N818 - the word of the protocol
    """A browser sent what cannot be taken; it is told the close code and the reason, and nothing else has changed."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code, self.reason = code, reason


class Connection:
    """One browser's socket in viser's words.

    stamps   the times batches are stamped with, seconds
    """

    def __init__(self, websocket: WebSocket) -> None:
        self._websocket = websocket
        self.stamps = itertools.count(1.0)

    async def send(self, data: bytes) -> None:
        """Send, or tell viser in its own words that the browser is gone."""
        if self._websocket.application_state is not WebSocketState.CONNECTED:
            raise ConnectionClosedOK(None, None)
        try:
            await self._websocket.send_bytes(data)
        except (WebSocketDisconnect, RuntimeError, OSError) as error:
            raise ConnectionClosedOK(None, None) from error

    async def recv(self) -> bytes:
        """Return the next binary message; ConnectionClosedOK when the browser has gone, Refusal for text and giants."""
        message = await self._websocket.receive()
        if message["type"] == "websocket.disconnect":
            raise ConnectionClosedOK(None, None)
        data = message.get("bytes")
        if data is None:
            raise Refusal(UNSUPPORTED, "expected a binary message of viser's client, got text")
        if len(data) > MAX_BYTES:
            raise Refusal(TOO_BIG, f"expected at most {MAX_BYTES} bytes, got {len(data)}")
        return bytes(data)

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Close, whatever state the socket is in."""
        with suppress(Exception):
            await self._websocket.close(code, reason)


async def produce(connection: Connection, buffer: AsyncMessageBuffer, client_id: int, last: Any = None) -> None:
    """Send batches of messages in viser's wire format as they come; ConnectionClosedOK once the buffer is done.

    Stamped a second apart, so that the browser shows each on arrival: it paces batches stamped less than 100 ms apart.
    """
    compressor = zstandard.ZstdCompressor(level=1)
    batches = buffer.window_generator(client_id, backlog_done_message=last)
    try:
        while not buffer.done:
            try:
                batch = await anext(batches)
            except StopAsyncIteration:
                break
            blobs: list[memoryview] = []
            messages = tuple(message.as_serializable_dict(blobs) for message in batch)
            lengths = tuple(blob.nbytes for blob in blobs)
            stamp = next(connection.stamps)
            body = msgspec.msgpack.encode({"messages": messages, "timestampSec": stamp, "binaryBufferLengths": lengths})
            packed = compressor.compress(body)
            parts: list[bytes | memoryview] = [len(body).to_bytes(8, "little"), len(packed).to_bytes(8, "little"), packed]
            _infra._append_aligned_buffers(parts, blobs, 16 + len(packed))
            await connection.send(b"".join(parts))
        raise ConnectionClosedOK(None, None)
    finally:
        await batches.aclose()


class Transport(_infra.WebsockServer):
    """viser's transport, fed by the host app instead of a port; lives on the loop it is started on."""

    def start(self) -> None:
        loop = asyncio.get_running_loop()
        self._background_event_loop = loop
        self._broadcast_buffer = AsyncMessageBuffer(loop, persistent_messages=True)
        self._stop_event = asyncio.Event()
        self._server_thread = threading.Thread(target=lambda: None)
        self._server_thread.start()
        self._next_id = 0
        self.sessions: dict[int, Session] = {}

    def stop(self) -> None:
        self._broadcast_buffer.set_done()
        for state in list(self._client_state_from_id.values()):
            state.message_buffer.set_done()

    async def serve(self, connection: Connection, session: Session) -> None:
        """Return when the browser has gone, or has been sent away for what it sent."""
        loop = asyncio.get_running_loop()
        client_id, self._next_id = _infra.ClientId(self._next_id), self._next_id + 1
        state = _infra._ClientHandleState(AsyncMessageBuffer(loop, persistent_messages=False), loop)
        client = _infra.WebsockClientConnection(client_id, state)
        self._client_state_from_id[client_id] = state
        self._live_connections[client_id] = connection  # type: ignore[assignment]
        self.sessions[client_id] = session
        tasks: list[asyncio.Task[None]] = []
        try:
            await _call(self._client_connect_cb, client)
            tasks = [
                asyncio.create_task(produce(connection, state.message_buffer, client_id)),
                asyncio.create_task(produce(connection, self._broadcast_buffer, client_id, self._backlog_done_message)),
                asyncio.create_task(self._consume(connection, client, client_id)),
            ]
            await asyncio.gather(*tasks)
        except ConnectionClosedOK:
            pass
        except Refusal as refusal:
            await connection.close(refusal.code, refusal.reason)
        finally:
            await self._forget(client, state, tasks)
            await connection.close()

    async def _consume(
        self, connection: Connection, client: _infra.WebsockClientConnection, client_id: _infra.ClientId
    ) -> None:
        """Hand each welcome message to viser; Refusal for one that is none, or holds what viser cannot use."""
        while True:
            data = await connection.recv()
            try:
                message = self._message_class.deserialize(data)
                if type(message).__name__ in WELCOME:
                    await self._handle_incoming_message(client_id, message)
                    await client._handle_incoming_message(client_id, message)
            except ConnectionClosedOK:
                raise
            except Exception as error:  # whatever a stranger's bytes may cause, it ends his connection alone
                raise Refusal(RUBBISH, "expected a message of viser's client; reload the page") from error

    async def _forget(
        self, client: _infra.WebsockClientConnection, state: _infra._ClientHandleState, tasks: list[asyncio.Task[None]]
    ) -> None:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        state.message_buffer.set_done()
        self._client_state_from_id.pop(client.client_id, None)
        self._live_connections.pop(client.client_id, None)
        self._broadcast_buffer.generator_cursors.pop(client.client_id, None)
        await _call(self._client_disconnect_cb, client)
        self.sessions.pop(client.client_id, None)


async def _call(callbacks: list[Any], client: Any) -> None:
    for callback in callbacks:
        result = callback(client)
        if inspect.isawaitable(result):
            await result


class Viewer:
    """The 3-D view of every session. Construct it on the running loop; `close` ends it."""

    def __init__(self) -> None:
        with (
            mock.patch.object(viser.infra, "WebsockServer", Transport),
            mock.patch("rich.print"),
        ):
            self._server = viser.ViserServer(host="asgi", port=0, verbose=False)
        transport = self._server._websock_server
        assert isinstance(transport, Transport), "this viser builds its transport another way; see the head of app/viewer.py"
        self._transport = transport
        self._mirrors: dict[int, asyncio.Task[None]] = {}
        self._dress()
        self._server.on_client_connect(self._welcome)
        self._server.on_client_disconnect(self._dismiss)
        page = CLIENT.read_bytes().replace(b"</head>", INJECTED.encode() + b"</head>", 1)
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
    with session.channel.follow() as follower:
        async for _ in follower:
            episode = session.episode
            with client.atomic():
                if scene is None:
                    scene = Scene(client.scene, episode, session.row.rival_of is not None)
                scene.show(episode)
                view.show(episode.config.rows, episode.config.cols)
            client.flush()
