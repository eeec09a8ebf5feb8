"""Uvicorn's protocol classes with limits: what is refused here never reaches the application.

A connection beyond the caps is answered 503 with Retry-After. A connection that sends no request is closed, and one whose
request comes too slowly is answered 408. A socket whose pings or messages come faster than any page sends them is closed with
1008.
"""

from __future__ import annotations

import asyncio
import json
import random
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, Literal

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from app.protection.buckets import TokenBucket
from app.protection.connections import MOST_REFUSED, MOST_WAITING
from app.protection.parser import LimitedParser
from app.protection.socket_budget import POLICY_VIOLATION

if TYPE_CHECKING:
    from uvicorn._types import ASGISendEvent
    from websockets.frames import Frame

    from app.protection.service import Protection

RETRY_AFTER_S = 30
"""What a refused browser is told to wait, in seconds."""

LINGER_S = 1.0
"""How long a refused connection may take to read why."""

REFUSED_AFTER_S = 0.3, 0.8
"""Seconds that a refused connection waits until it is told so, at least and at most: told at once, a client that floods would
open the next at once, and told after the same time, it would open them all at the same moments."""

SLICE_BYTES = 1024
"""Bytes of a socket that are looked at before its limits are: 170 pings."""

REQUEST_BYTES = 2048
"""Bytes of requests that are read of one connection in a turn of the event loop."""

READ_BYTES = 256
"""Bytes that are read of one socket in a turn of the event loop: a page's message, or eighteen of the smallest. A quarter of a
megabyte of these, asyncio's own measure, would keep everybody else waiting, and so do 2 KB from each of thirty sockets."""

WAITING_MESSAGES = 4
"""Messages of one socket that wait for the application before nothing more is read of it. Uvicorn pauses and resumes reading at
each message, which is two calls of the system and a fifth of the work of a move."""

DISCARDED_BYTES = 2**18
"""Bytes that are read at once of a socket whose message breaks the protocol: nothing looks at them."""

FULL = "The playground is full at the moment: too many connections are open. Wait half a minute, then load the page again."
_FULL_PAGE = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><title>The playground is full</title>'
    '<body style="font:18px/1.5 sans-serif;max-width:32em;margin:15vh auto;padding:0 1em;background:#1d0f0a;color:#f3e3d7">'
    f"<h1>The playground is full</h1><p>{FULL}</p>"
)


class LimitedHttp(H11Protocol):
    """HTTP whose connections are counted until they, or the sockets that they become, are lost."""

    protection: ClassVar[Protection]
    conn: LimitedParser
    _key: str | None = None
    _is_counted = False
    _is_refused = False
    _is_answered_at_once = False
    _asked = b""
    """What came over a refused connection."""
    _awaited: Literal["headers", "body"] | None = None
    """The part of a request that has begun to come, or of a first one that is due."""
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.conn = LimitedParser()
        _read_at_once(transport, REQUEST_BYTES)
        self.protection.slow_readers.add(transport)
        connections = self.protection.connections
        self._key = connections.key_of(self.client[0] if self.client else "")
        self._is_counted = connections.take(self._key)
        self._is_refused = not self._is_counted
        if self._is_refused:
            self._refuse()
        elif turn_s := connections.turn_s(self._key):
            self.loop.call_soon(
                transport.pause_reading
            )  # Python 3.11.2 reads in spite of a pause that is made here
            self.loop.call_later(turn_s, self._serve)
        else:
            self._watch(is_coming=True)

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self.protection.connections.refused -= self._is_refused
        self._release()
        self._await(None)

    def data_received(self, data: bytes) -> None:
        if not self._is_refused:
            super().data_received(data)
            self._watch(is_coming=True)
        elif not self.transport.is_closing():
            self.transport.pause_reading()
            self._asked = data
            if self._is_answered_at_once:
                self._tell_refused()

    def handle_events(self) -> None:
        super().handle_events()
        if self.cycle is not None and self.cycle.transport is self.transport:
            self.cycle.transport = HeadWithBody(self.transport, self.loop)  # type: ignore[assignment]

    def send_400_response(self, msg: str) -> None:
        """Refuse what cannot be read, or would take long to read, where its answer has not begun, and close the connection."""
        may_answer = self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE)
        if self.conn.refusal is None and may_answer:
            super().send_400_response(msg)
            return
        if self.conn.refusal is not None:
            self.protection.count_refusal("long_request")
            if may_answer:
                self.transport.write(
                    _json_answer("431 Request Header Fields Too Large", self.conn.refusal)
                )
        if self.conn.our_state is h11.IDLE:
            self.transport.pause_reading()  # closed with something unread, it would be reset before the answer is read
            self.loop.call_later(LINGER_S, self.transport.abort)
        else:
            self.transport.close()

    def handle_websocket_upgrade(self, event: object) -> None:
        super().handle_websocket_upgrade(event)  # type: ignore[arg-type]
        protocol = self.transport.get_protocol()
        if isinstance(protocol, LimitedWebSocket):
            protocol.on_lost = self._release
            if self._key is not None:
                protocol.of_address = self.protection.messages.of(self._key)
            protocol.punish = lambda: self.protection.connections.punish(self._key)
            if protocol.conn.handshake_exc is not None and not self.transport.is_closing():
                self._refuse_handshake()

    def _refuse_handshake(self) -> None:
        """Answer a request that the library `websockets` has not taken: Uvicorn would keep the connection and do nothing."""
        self.protection.count_refusal("handshake")
        detail = "a request for a websocket must have no body and no line of more than 8 KB, as browsers send it"
        self.transport.write(_json_answer("400 Bad Request", detail))
        self.transport.close()

    def pause_writing(self) -> None:
        super().pause_writing()
        self.protection.slow_readers.pause(self.transport)

    def resume_writing(self) -> None:
        super().resume_writing()
        self.protection.slow_readers.resume(self.transport)

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._watch(is_coming=False)

    def _refuse(self) -> None:
        """Tell the connection that it is refused, after a wait or at once; or close it where too many are told so."""
        connections = self.protection.connections
        self.protection.count_refusal("connections")
        connections.refused += 1
        if connections.refused > MOST_REFUSED:
            self.transport.abort()
            return
        self._is_answered_at_once = connections.refused > MOST_WAITING
        if not self._is_answered_at_once:
            self.loop.call_later(random.uniform(*REFUSED_AFTER_S), self._end_wait)
        self.loop.call_later(LINGER_S, self.transport.abort)

    def _end_wait(self) -> None:
        """Answer what a refused connection has asked for, now or as soon as it does."""
        self._is_answered_at_once = True
        self._tell_refused()

    def _tell_refused(self) -> None:
        if self._asked and not self.transport.is_closing():
            self.transport.write(_full_answer(is_page=b"text/html" in self._asked))
            self.transport.close()

    def _serve(self) -> None:
        """Read the first request: the connection's turn has come."""
        if not self.transport.is_closing():
            self.transport.resume_reading()
            self._watch(is_coming=True)

    def _watch(self, is_coming: bool) -> None:
        """Await the part of a request that is not whole; between requests (not `is_coming`) uvicorn's own time limit holds."""
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            self._await(None)
        elif self.conn.their_state is h11.SEND_BODY:
            self._await("body")
        else:
            self._await("headers" if is_coming and self.conn.their_state is h11.IDLE else None)

    def _await(self, part: Literal["headers", "body"] | None) -> None:
        """Give a part of a request its seconds, unless they run already."""
        if part == self._awaited:
            return
        if self._deadline is not None:
            self._deadline.cancel()
        limits = self.protection.limits
        self._awaited = part
        self._deadline = (
            None
            if part is None
            else self.loop.call_later(getattr(limits, f"{part}_s"), self._end_slow, part)
        )

    def _release(self) -> None:
        self.protection.slow_readers.remove(self.transport)
        if self._is_counted:
            self._is_counted = False
            self.protection.connections.slots.give_back(self._key)

    def _end_slow(self, part: Literal["headers", "body"]) -> None:
        """Close a connection whose request did not come in time, with an answer where something of it came."""
        if self.transport.is_closing():
            return
        is_silent = self.scope is None and not self.conn.trailing_data[0]
        self.protection.count_refusal("no_request" if is_silent else f"slow_{part}")
        if not is_silent and self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            seconds = getattr(self.protection.limits, f"{part}_s")
            self.transport.write(
                _json_answer(
                    "408 Request Timeout", f"the {part} of a request must come within {seconds:g} s"
                )
            )
        self.transport.close()
        self.loop.call_later(LINGER_S, self.transport.abort)


class HeadWithBody:
    """Writes the head of an answer together with what comes of its body in the same turn of the event loop.

    Each write wakes the client, on the server's own processor perhaps; uvicorn makes two of an answer.
    """

    def __init__(self, transport: asyncio.Transport, loop: asyncio.AbstractEventLoop) -> None:
        self._transport, self._loop = transport, loop
        self._head = b""
        self._has_head = False
        self.is_closing = transport.is_closing

    def write(self, data: bytes) -> None:
        """Write, or keep a head until the first bytes of the body come or the turn ends."""
        if not self._has_head and not data.startswith(
            b"HTTP/1.1 1"
        ):  # 100 Continue is an answer of its own
            self._has_head, self._head = True, data
            self._loop.call_soon(self._write_head)
        else:
            head, self._head = self._head, b""
            self._transport.write(head + data)

    def close(self) -> None:
        """Close the connection once all of it is written."""
        self._write_head()
        self._transport.close()

    def _write_head(self) -> None:
        if self._head:
            self.write(b"")


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
        _read_at_once(self.transport, READ_BYTES)
        self._pings = TokenBucket(self.protection.bucket_sizes["pings"])
        self._messages = TokenBucket(self.protection.bucket_sizes["messages"])

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        if self.on_lost is not None:
            self.on_lost()

    def pause_writing(self) -> None:
        super().pause_writing()
        self.protection.slow_readers.pause(self.transport)

    def resume_writing(self) -> None:
        super().resume_writing()
        self.protection.slow_readers.resume(self.transport)

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
        if (
            message["type"] == "websocket.close"
            and message.get("code") == POLICY_VIOLATION
            and not self._is_shut
        ):
            self._is_shut = True
            self._stop_reading()

    def _stop_reading(self) -> None:
        """Read nothing more, and leave the other side time to read why it was closed; its address opens fewer from now on."""
        if self.punish is not None:
            self.punish()
        self.read_paused = False  # nothing resumes it
        self.transport.pause_reading()
        self._close_later()

    def _close_later(self) -> None:
        """Close the connection once the other side had time to read why; without a timer Uvicorn does with the application."""
        if self.close_timer is not None:
            self.close_timer.cancel()
        self.close_timer = self.loop.call_later(
            LINGER_S + random.random(), self.transport.abort
        )  # not all in one turn

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
        if self._messages.take() or (
            self.of_address is not None and not self.of_address.take_if_there()
        ):
            self._shut("messages")
            return
        was_paused, self.read_paused = self.read_paused, True  # so that uvicorn does not pause
        super().send_receive_event_to_app()
        self.read_paused = was_paused
        if not was_paused and not self._is_shut and self.queue.qsize() >= WAITING_MESSAGES:
            self.read_paused = True
            self.transport.pause_reading()

    def handle_parser_exception(self) -> None:
        """Close a socket whose message breaks the protocol; what still comes is discarded.

        Unread, it would reset the connection, or keep the other side sending, before the reason can be read.
        """
        if self._is_shut:
            return
        self._is_shut = True
        self.stop_keepalive()
        assert self.conn.close_sent is not None
        self.transport.write(b"".join(self.conn.data_to_send()))
        self.close_sent = True
        self.queue.put_nowait({"type": "websocket.disconnect", "code": self.conn.close_sent.code})
        _read_at_once(self.transport, DISCARDED_BYTES)
        self.transport.resume_reading()
        self._close_later()

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


def _read_at_once(transport: asyncio.BaseTransport, size: int) -> None:
    """Read so many bytes at once, where a transport has such a size."""
    if hasattr(transport, "max_size"):
        transport.max_size = size


def limited_protocols(protection: Protection) -> tuple[type[LimitedHttp], type[LimitedWebSocket]]:
    """Return the protocol classes of a server with its limits, for uvicorn's `http` and `ws`."""
    members = {"protection": protection}
    return type("LimitedHttp", (LimitedHttp,), members), type(
        "LimitedWebSocket", (LimitedWebSocket,), members
    )


def _full_answer(is_page: bool) -> bytes:
    """Return the whole answer to a refused connection's request: a page where a browser asks for one, else JSON."""
    status, wait = "503 Service Unavailable", f"retry-after: {RETRY_AFTER_S}"
    return (
        _whole_answer(status, "text/html; charset=utf-8", _FULL_PAGE, wait)
        if is_page
        else _json_answer(status, FULL, wait)
    )


def _json_answer(status: str, detail: str, *headers: str) -> bytes:
    return _whole_answer(status, "application/json", json.dumps({"detail": detail}), *headers)


def _whole_answer(status: str, kind: str, body: str, *headers: str) -> bytes:
    """Return an answer after which the connection is closed, as it is sent."""
    lines = (f"HTTP/1.1 {status}", f"content-type: {kind}", f"content-length: {len(body.encode())}", *headers,
             "cache-control: no-store", "connection: close", "", body)  # fmt: skip
    return "\r\n".join(lines).encode()
