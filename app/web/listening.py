"""Serving an app on a socket: a listening socket, uvicorn's configuration, and a server that announces its address."""

from __future__ import annotations

import errno
import os
import socket
from typing import Any

import uvicorn
from fastapi import FastAPI

from app.play.messages import MAX_MESSAGE_BYTES
from app.protection import limited_protocols

BACKLOG = 2048
"""Connections that may wait to be accepted."""

FIRST_INHERITED_FD = 3
"""The descriptor of the first socket that systemd passes on (sd_listen_fds(3))."""

ACCEPTED_AT_ONCE = 50
"""Connections that are accepted in one turn of the event loop."""


class ServerError(RuntimeError):
    """The server cannot start; the text says why and what to do."""


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket; ServerError when the port is taken or the host is none of this machine's."""
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
    """Return the listening socket that systemd (`marsexplorer.socket`) has passed on to this process; None when it has not.

    It stays open while the server is started anew: who connects meanwhile waits, and nobody is refused. ServerError unless it
    is one TCP socket.
    """
    if os.environ.get("LISTEN_PID") != str(os.getpid()):
        return None
    count = os.environ.get("LISTEN_FDS", "")
    for name in ("LISTEN_PID", "LISTEN_FDS", "LISTEN_FDNAMES"):
        os.environ.pop(name, None)  # they are not for the processes that this one starts
    if count != "1":
        raise ServerError(
            f"expected one socket from systemd, got {count or 'none'}: marsexplorer.socket needs one ListenStream"
        )
    sock = socket.socket(fileno=FIRST_INHERITED_FD)
    if sock.family not in (socket.AF_INET, socket.AF_INET6):
        sock.close()
        raise ServerError(
            "expected a TCP socket from systemd, got another kind: give ListenStream an address and a port"
        )
    return sock


def address_of(sock: socket.socket) -> str:
    """Return the http:// address of a listening socket."""
    host, port = sock.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def uvicorn_config(app: FastAPI, **changes: Any) -> uvicorn.Config:
    """Return uvicorn's configuration for the app, with its limits and some options changed."""
    http, ws = limited_protocols(app.state.protection)
    options: dict[str, Any] = {
        "http": http, "ws": ws, "backlog": ACCEPTED_AT_ONCE,
        "ws_per_message_deflate": False, "ws_max_size": 2 * MAX_MESSAGE_BYTES, "lifespan": "on",
        "access_log": False, "log_level": "warning", "timeout_graceful_shutdown": 3, "server_header": False,
        "proxy_headers": False,  # `app.protection` reads them
    }  # fmt: skip
    return uvicorn.Config(app, **{**options, **changes})


class AnnouncingServer(uvicorn.Server):
    """Prints the page's address once the page can be opened."""

    def __init__(self, config: uvicorn.Config, address: str) -> None:
        super().__init__(config)
        self._address = address

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start serving, then print the address."""
        await super().startup(sockets)
        for sock in sockets or ():
            sock.listen(BACKLOG)  # asyncio has made it as small as what it accepts at once
        if self.started:
            print(
                f"MarsExplorer Playground is open at {self._address} (Ctrl-C closes it)", flush=True
            )
