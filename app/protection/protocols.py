"""Uvicorn's protocol classes with limits: what is refused here never reaches the application.

A connection beyond the caps is answered 503 with Retry-After. A connection that sends no request is closed. A socket whose
pings or messages come faster than any page sends them is closed with 1008.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from app.protection.buckets import TokenBucket
from app.protection.socket_budget import POLICY_VIOLATION

if TYPE_CHECKING:
    from uvicorn._types import ASGISendEvent
    from websockets.frames import Frame

    from app.protection.service import Protection

RETRY_AFTER_S = 30
"""What a refused browser is told to wait, in seconds."""

FIRST_REQUEST_S = 20.0
"""How long a new connection may take to send its first request."""

LINGER_S = 1.0
"""How long a refused connection may take to read why."""

SLICE_BYTES = 1024
"""Bytes of a socket that are looked at before its limits are: 170 pings."""

READ_BYTES = 2048
"""Bytes that are read of one socket in a turn of the event loop: a quarter of a megabyte of small messages, asyncio's own
measure, would keep everybody else waiting."""

FULL = "The playground is full at the moment: too many connections are open. Wait half a minute, then load the page again."
_FULL_PAGE = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><title>The playground is full</title>'
    '<body style="font:18px/1.5 sans-serif;max-width:32em;margin:15vh auto;padding:0 1em;background:#1d0f0a;color:#f3e3d7">'
    f"<h1>The playground is full</h1><p>{FULL}</p>"
)


class LimitedHttp(H11Protocol):
    """HTTP whose connections are counted until they, or the sockets that they become, are lost."""

    protection: ClassVar[Protection]
    _key: str | None = None
    _is_counted = False
    _is_refused = False

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        connections = self.protection.connections
        self._key = connections.key_of(self.client[0] if self.client else "")
        self._is_counted = connections.take(self._key)
        self._is_refused = not self._is_counted
        if self._is_refused:
            self.protection.count_refusal("connections")
            self.loop.call_later(LINGER_S, transport.abort)
        else:
            self.loop.call_later(FIRST_REQUEST_S, self._abort_without_request)
            if turn_s := connections.turn_s(self._key):
                transport.pause_reading()
                self.loop.call_later(turn_s, self._serve)

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._release()

    def data_received(self, data: bytes) -> None:
        if not self._is_refused:
            super().data_received(data)
        elif not self.transport.is_closing():
            self.transport.write(_full_answer(is_page=b"text/html" in data))
            self.transport.close()

    def handle_websocket_upgrade(self, event: object) -> None:
        super().handle_websocket_upgrade(event)  # type: ignore[arg-type]
        protocol = self.transport.get_protocol()
        if isinstance(protocol, LimitedWebSocket):
            protocol.on_lost = self._release
            if self._key is not None:
                protocol.of_address = self.protection.messages.of(self._key)
            protocol.punish = lambda: self.protection.connections.punish(self._key)

    def _serve(self) -> None:
        """Read the first request: the connection's turn has come."""
        if not self.transport.is_closing():
            self.transport.resume_reading()

    def _release(self) -> None:
        if self._is_counted:
            self._is_counted = False
            self.protection.connections.slots.give_back(self._key)

    def _abort_without_request(self) -> None:
        if self.scope is None and not self.transport.is_closing() and self.transport.get_protocol() is self:
            self.protection.count_refusal("no_request")
            self.transport.abort()


class LimitedWebSocket(WebSocketsSansIOProtocol):
    """A websocket that is closed with 1008 when pings or messages come too fast."""

    protection: ClassVar[Protection]
    on_lost: Callable[[], None] | None = None
    """What the HTTP connection that this one was before wants to be told when it is lost."""
    punish: Callable[[], None] | None = None
    """What is called when this one is closed for too much."""
    of_address: TokenBucket | None = None
    """The bucket of messages of all sockets of its address; None behind a named proxy."""
    _is_shut = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if hasattr(transport, "max_size"):
            transport.max_size = READ_BYTES
        self._pings = TokenBucket(self.protection.bucket_sizes["pings"])
        self._messages = TokenBucket(self.protection.bucket_sizes["messages"])

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        if self.on_lost is not None:
            self.on_lost()

    def data_received(self, data: bytes) -> None:
        for start in range(0, len(data), SLICE_BYTES):
            if self._is_shut:
                return
            super().data_received(data[start : start + SLICE_BYTES])

    def handle_ping(self) -> None:
        if self._pings.take():
            self._shut("pings")
        else:
            super().handle_ping()

    async def send(self, message: ASGISendEvent) -> None:
        await super().send(message)
        if message["type"] == "websocket.close" and message.get("code") == POLICY_VIOLATION and not self._is_shut:
            self._is_shut = True
            self._stop_reading()

    def _stop_reading(self) -> None:
        """Read nothing more, and leave the other side time to read why it was closed; its address opens fewer from now on."""
        if self.punish is not None:
            self.punish()
        self.read_paused = False  # nothing resumes it
        self.transport.pause_reading()
        self.loop.call_later(LINGER_S, self.transport.abort)

    def handle_pong(self, event: Frame) -> None:
        if self._pings.take():
            self._shut("pings")
        else:
            super().handle_pong(event)

    def handle_cont(self, event: Frame) -> None:
        """Count each fragment: a message that never ends would be counted never, and an empty one has no size to limit."""
        if self._messages.take():
            self._shut("messages")
        else:
            super().handle_cont(event)

    def send_receive_event_to_app(self) -> None:
        if self._messages.take() or (self.of_address is not None and not self.of_address.take_if_there()):
            self._shut("messages")
        else:
            super().send_receive_event_to_app()

    def _shut(self, kind: str) -> None:
        """Close the socket with 1008."""
        if self._is_shut:
            return
        self._is_shut = True
        self.protection.count_refusal(f"socket_{kind}")
        self.stop_keepalive()
        if not self.close_sent:
            self.conn.data_to_send()  # the answers to its pings
            self.conn.send_close(POLICY_VIOLATION, f"too many {kind}")
            self.transport.write(b"".join(self.conn.data_to_send()))
            self.close_sent = True
        self.queue.put_nowait({"type": "websocket.disconnect", "code": POLICY_VIOLATION})
        self._stop_reading()


def limited_protocols(protection: Protection) -> tuple[type[LimitedHttp], type[LimitedWebSocket]]:
    """Return the protocol classes of a server with its limits, for uvicorn's `http` and `ws`."""
    members = {"protection": protection}
    return type("LimitedHttp", (LimitedHttp,), members), type("LimitedWebSocket", (LimitedWebSocket,), members)


def _full_answer(is_page: bool) -> bytes:
    """Return the whole answer to a refused connection's request: a page where a browser asks for one, else JSON."""
    body = (_FULL_PAGE if is_page else f'{{"detail": "{FULL}"}}').encode()
    kind = "text/html; charset=utf-8" if is_page else "application/json"
    lines = ("HTTP/1.1 503 Service Unavailable", f"content-type: {kind}", f"content-length: {len(body)}",
             f"retry-after: {RETRY_AFTER_S}", "cache-control: no-store", "connection: close", "", "")  # fmt: skip
    return "\r\n".join(lines).encode() + body
