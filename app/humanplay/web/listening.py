"""Serving an app on a socket: uvicorn, and a server that announces its address."""

from __future__ import annotations

import asyncio
import errno
import gc
import logging
import os
import resource
import socket
from collections.abc import Callable
from typing import Any

import uvicorn
from h11 import LocalProtocolError
from starlette.types import ASGIApp
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import ServerState

from humanplay.board.messages import MAX_MESSAGE_BYTES
from humanplay.web.protection.limits import POLICY_VIOLATION, LimitedFrames

BACKLOG = 1024
"""Connections that may wait to be accepted."""

HEAD_BYTES = 2**14
"""Bytes of the head of a request that may wait for its end."""

READ_BYTES = 2**13
"""Bytes that the system keeps of a connection until they are read; up to twice as many are at once.

More would keep everybody else waiting while what came over one connection is looked at.
"""

FIRST_INHERITED_FD = 3
"""The descriptor of the first socket that systemd passes on (sd_listen_fds(3))."""

_STRANGERS = (
    "Invalid HTTP request received.",
    "Invalid UTF-8 sequence received from client.",
    "Unsupported upgrade request.",
    "ASGI callable returned without completing handshake.",
    "ASGI callable returned without completing response.",
)
_NOT_TAKEN = (
    b"HTTP/1.1 400 Bad Request\r\ncontent-type: text/plain\r\nconnection: close\r\n\r\n"
    b"a request for a websocket must have no body and no long line, as browsers send it"
)


class ServerError(RuntimeError):
    """The server cannot start; the text says why and what to do."""


def listen(host: str, port: int) -> socket.socket:
    """A listening socket.

    Raises:
        ServerError: If the port is taken, or the host is none of this machine's.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # named TCP, so that asyncio sets TCP_NODELAY: else every kept-alive answer waits 40 ms for an acknowledgement
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((host, port))
        sock.listen(BACKLOG)
    except OSError as error:
        sock.close()
        reason = (error.strerror or str(error)).lower()
        option = "--port" if error.errno in (errno.EADDRINUSE, errno.EACCES) else "--host"
        raise ServerError(
            f"cannot listen on {host} port {port}: {reason}; choose another with {option}"
        ) from error
    sock.set_inheritable(True)
    return sock


def inherited_socket() -> socket.socket | None:
    """The listening socket that systemd (`humanplay.socket`) has passed on, if any.

    It stays open while the server is started anew: who connects meanwhile waits, and nobody is
    refused.

    Raises:
        ServerError: Unless it is one TCP socket.
    """
    if os.environ.get("LISTEN_PID") != str(os.getpid()):
        return None
    count = os.environ.get("LISTEN_FDS", "")
    for name in ("LISTEN_PID", "LISTEN_FDS", "LISTEN_FDNAMES"):
        os.environ.pop(name, None)  # they are not for the processes that this one starts
    if count != "1":
        raise ServerError(
            f"expected one socket from systemd, got {count or 'none'}: humanplay.socket needs one ListenStream"
        )
    sock = socket.socket(fileno=FIRST_INHERITED_FD)
    if sock.family not in (socket.AF_INET, socket.AF_INET6):
        sock.close()
        raise ServerError(
            "expected a TCP socket from systemd, got another kind: "
            "give ListenStream an address and a port"
        )
    return sock


def address_of(sock: socket.socket) -> str:
    """The http:// address of a listening socket."""
    host, port = sock.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def bound_connections(sock: socket.socket, answer_s: float) -> None:
    """Bound what a connection of a listening socket may hold, by the system's options.

    Little of what it sends waits for us, and one that takes nothing of what we send is ended after
    `answer_s`: this also ends what waits for it, which no time limit of ours would.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, READ_BYTES)
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1000 * answer_s))


def raise_file_limit() -> None:
    """Let this process open as many files, hence connections, as the system allows it."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def websocket_protocol(
    config: uvicorn.Config, server_state: ServerState, app_state: dict[str, Any]
) -> WebSocketsSansIOProtocol:
    """uvicorn's websocket, with what uvicorn 0.54 does not do.

    uvicorn neither answers nor closes a connection whose handshake the library `websockets` cannot
    read. It fails at bytes that are not ASCII there, at what comes before a handshake is answered,
    and at an answer to what cannot be read. And it reads pings and parts of messages however many
    come, of which the app, which counts messages, hears nothing.
    """
    protocol = WebSocketsSansIOProtocol(config, server_state, app_state)
    read, limited = protocol.data_received, LimitedFrames(protocol.conn)

    def read_handshake(data: bytes) -> None:
        del protocol.data_received  # the rest is uvicorn's alone
        read(data.decode("ascii", "replace").encode("ascii", "replace"))
        if not protocol.handshake_initiated:
            protocol.transport.write(_NOT_TAKEN)
            protocol.transport.close()

    def end_unreadable() -> None:
        if limited.is_exceeded:
            # the app counts it against the address
            protocol.queue.put_nowait({"type": "websocket.disconnect", "code": POLICY_VIOLATION})
        protocol.close_sent = protocol.disconnected = True
        protocol.transport.write(b"".join(protocol.conn.data_to_send()))
        protocol.transport.close()

    protocol.data_received = read_handshake  # type: ignore[method-assign]
    protocol.conn.recv_frame = limited.take  # type: ignore[method-assign]
    protocol.handle_parser_exception = end_unreadable  # type: ignore[method-assign]
    return protocol


def uvicorn_config(app: ASGIApp, **changes: Any) -> uvicorn.Config:
    """uvicorn's configuration for the app, with some options changed."""
    options: dict[str, Any] = {
        "http": "h11", "h11_max_incomplete_event_size": HEAD_BYTES,
        "ws": websocket_protocol, "ws_max_size": 2 * MAX_MESSAGE_BYTES,
        "ws_per_message_deflate": False, "ws_ping_interval": 20.0, "ws_ping_timeout": 20.0,
        "backlog": BACKLOG, "timeout_graceful_shutdown": 3, "lifespan": "on",
        "access_log": False, "log_level": "warning", "server_header": False,
        "proxy_headers": False,  # `humanplay.web.protection` reads them
    }  # fmt: skip
    config = uvicorn.Config(app, **{**options, **changes})
    logging.getLogger("uvicorn.error").addFilter(is_worth_a_line)
    return config


def is_worth_a_line(record: logging.LogRecord) -> bool:
    """Whether a record of uvicorn's is more than a stranger's bad request.

    Of a message that is no text it logs a traceback, of each refused handshake an error, when it
    stops a traceback of each request that it cancels, and one where it has refused the body of a
    request before that was answered.
    """
    error = None if record.exc_info is None else record.exc_info[1]
    is_answered = isinstance(error, LocalProtocolError) and "can't handle event" in str(error)
    is_strangers = str(record.msg).startswith(_STRANGERS)
    return not (is_answered or is_strangers or isinstance(error, asyncio.CancelledError))


class AnnouncingServer(uvicorn.Server):
    """Prints the page's address once the page can be opened.

    Args:
        opened: Called with the address then.
    """

    def __init__(
        self, config: uvicorn.Config, address: str, opened: Callable[[str], object]
    ) -> None:
        super().__init__(config)
        self._address, self._opened = address, opened

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start serving, then print the address."""
        await super().startup(sockets)
        gc.collect()
        gc.freeze()  # what is there now stays for ever, and is not looked at again while people play
        gc.enable()  # `serve` looks for no garbage while it starts
        if self.started:
            print(f"The playground is open at {self._address} (Ctrl-C closes it)", flush=True)
            self._opened(self._address)
