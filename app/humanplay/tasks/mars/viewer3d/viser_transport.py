"""viser's transport without port, thread or loop: the app hands sockets over.

Relied on besides viser's public API (a test fails when an upgrade breaks it): the wire format of `_message_producer`,
`_append_aligned_buffers`, `_ClientHandleState` and `AsyncMessageBuffer`.
"""

from __future__ import annotations

import asyncio
import inspect
import itertools
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import msgspec
import viser
import zstandard
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState
from viser.infra import Message, WebsockClientConnection, _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.exceptions import ConnectionClosedOK

from humanplay.board.session import Session
from humanplay.tasks.mars.viewer3d.scene import ViewOptions

PROTOCOL = f"viser-v{viser.__version__}"
MAX_VIEWER_MESSAGE_BYTES = 64 * 1024
"""Longest message of a browser's 3-D view that is accepted."""
ACCEPTED_MESSAGES = frozenset({"ViewerCameraMessage"})
"""Types of viser's messages that a browser may send: where it looks from, and nothing that changes anything here."""

LARGEST = 1e6
"""Largest number in such a message, in metres, radians or pixels: what is computed from larger ones may not be finite."""

UNSUPPORTED, INVALID, TOO_BIG = 1003, 1007, 1009
"""Close codes of RFC 6455: a text message, one that viser cannot read, one that is too large."""


_VECTORS = {"wxyz": 4, "position": 3, "look_at": 3, "up_direction": 3}
_NUMBERS = ("fov", "near", "far", "image_height", "image_width")


class ViewerMessageError(Exception):
    """A browser sent what is not accepted; only its socket is closed, with a reason."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code, self.reason = code, reason


class ShownBoard(NamedTuple):
    """What a browser's socket shows: a session's board, and how."""

    session: Session
    options: ViewOptions


class Connection:
    """One browser's socket with the methods that viser calls.

    stamps   the times that batches are stamped with, seconds
    """

    def __init__(self, websocket: WebSocket) -> None:
        self._websocket = websocket
        self.stamps = itertools.count(1.0)

    async def send(self, data: bytes) -> None:
        """Send a batch; ConnectionClosedOK when the browser has left."""
        if self._websocket.application_state is not WebSocketState.CONNECTED:
            raise ConnectionClosedOK(None, None)
        try:
            await self._websocket.send_bytes(data)
        except (WebSocketDisconnect, RuntimeError, OSError) as error:
            raise ConnectionClosedOK(None, None) from error

    async def recv(self) -> bytes:
        """Return the next binary message; ViewerMessageError for another kind.

        ConnectionClosedOK when the browser has left.
        """
        message = await self._websocket.receive()
        if message["type"] == "websocket.disconnect":
            raise ConnectionClosedOK(None, None)
        data = message.get("bytes")
        if data is None:
            reason = "expected a binary message of viser's client, got text"
            raise ViewerMessageError(UNSUPPORTED, reason)
        if len(data) > MAX_VIEWER_MESSAGE_BYTES:
            reason = f"expected at most {MAX_VIEWER_MESSAGE_BYTES} bytes, got {len(data)}"
            raise ViewerMessageError(TOO_BIG, reason)
        return bytes(data)

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Close the socket, whatever state it is in."""
        self._websocket.scope["noted"]["status"] = code
        with suppress(Exception):
            await self._websocket.close(code, reason)


async def produce(
    connection: Connection, buffer: AsyncMessageBuffer, client_id: int, last: Message | None = None
) -> None:
    """Send batches in viser's wire format; ConnectionClosedOK at the buffer's end.

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
            whole = {"messages": messages, "timestampSec": stamp, "binaryBufferLengths": lengths}
            body = msgspec.msgpack.encode(whole)
            packed = compressor.compress(body)
            sizes = len(body).to_bytes(8, "little") + len(packed).to_bytes(8, "little")
            parts: list[bytes | memoryview] = [sizes, packed]
            _infra._append_aligned_buffers(parts, blobs, 16 + len(packed))
            await connection.send(b"".join(parts))
        raise ConnectionClosedOK(None, None)
    finally:
        await batches.aclose()


class Transport(_infra.WebsockServer):
    """viser's transport, fed by the host app; it lives on the loop it is started on."""

    def start(self) -> None:
        """Prepare the buffers on the running loop; nothing listens and no thread runs."""
        loop = asyncio.get_running_loop()
        self._background_event_loop = loop
        self._broadcast_buffer = AsyncMessageBuffer(loop, persistent_messages=True)
        self._stop_event = asyncio.Event()
        self._server_thread = threading.Thread(target=lambda: None)
        self._server_thread.start()
        self._next_id = 0
        self.boards: dict[int, ShownBoard] = {}

    def stop(self) -> None:
        """End every connection."""
        self._broadcast_buffer.set_done()
        for state in list(self._client_state_from_id.values()):
            state.message_buffer.set_done()

    async def serve(self, connection: Connection, board: ShownBoard) -> None:
        """Serve one browser until it leaves, or until it sends what is not accepted."""
        loop = asyncio.get_running_loop()
        client_id, self._next_id = _infra.ClientId(self._next_id), self._next_id + 1
        state = _infra._ClientHandleState(AsyncMessageBuffer(loop, persistent_messages=False), loop)
        client = _infra.WebsockClientConnection(client_id, state)
        self._client_state_from_id[client_id] = state
        self._live_connections[client_id] = connection  # type: ignore[assignment]
        self.boards[client_id] = board
        tasks: list[asyncio.Task[None]] = []
        try:
            await _call(self._client_connect_cb, client)
            last = self._backlog_done_message
            work = (
                produce(connection, state.message_buffer, client_id),
                produce(connection, self._broadcast_buffer, client_id, last),
                self._consume(connection, client, client_id),
            )
            tasks = [asyncio.create_task(coroutine) for coroutine in work]
            await asyncio.gather(*tasks)
        except ConnectionClosedOK:
            pass
        except ViewerMessageError as refusal:
            await connection.close(refusal.code, refusal.reason)
        finally:
            await self._forget(client, state, tasks)
            await connection.close()

    async def _consume(
        self,
        connection: Connection,
        client: _infra.WebsockClientConnection,
        client_id: _infra.ClientId,
    ) -> None:
        """Hand each accepted message to viser; ViewerMessageError for a bad one."""
        while True:
            data = await connection.recv()
            try:
                message = self._message_class.deserialize(data)
                if type(message).__name__ in ACCEPTED_MESSAGES:
                    _check_numbers(message)
                    await self._handle_incoming_message(client_id, message)
                    await client._handle_incoming_message(client_id, message)
            except ConnectionClosedOK:
                raise
            except Exception as error:  # whatever the bytes cause, it ends this connection alone
                reason = "expected a message of viser's client; reload the page"
                raise ViewerMessageError(INVALID, reason) from error

    async def _forget(
        self,
        client: _infra.WebsockClientConnection,
        state: _infra._ClientHandleState,
        tasks: list[asyncio.Task[None]],
    ) -> None:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        state.message_buffer.set_done()
        self._client_state_from_id.pop(client.client_id, None)
        self._live_connections.pop(client.client_id, None)
        self._broadcast_buffer.generator_cursors.pop(client.client_id, None)
        await _call(self._client_disconnect_cb, client)
        self.boards.pop(client.client_id, None)


def _check_numbers(camera: object) -> None:
    """Raise ValueError unless a camera's vectors and numbers are well formed."""
    for name, length in _VECTORS.items():
        if len(getattr(camera, name)) != length:
            raise ValueError(f"{name} must hold {length} numbers")
    numbers = [getattr(camera, name) for name in _NUMBERS]
    for number in itertools.chain(numbers, *(getattr(camera, name) for name in _VECTORS)):
        if not abs(number) <= LARGEST:  # not a number compares with nothing
            raise ValueError(f"expected a number of at most {LARGEST:g}, got {number}")


async def _call(
    callbacks: Sequence[Callable[[WebsockClientConnection], object]],
    client: WebsockClientConnection,
) -> None:
    for callback in callbacks:
        result = callback(client)
        if inspect.isawaitable(result):
            await result
