"""Serving an app on a socket: a listening socket, uvicorn's configuration, and a server that announces its address."""

from __future__ import annotations

import errno
import socket
from typing import Any

import uvicorn
from fastapi import FastAPI

from app.protection import limited_protocols

BACKLOG = 2048
"""Connections that may wait to be accepted."""

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
        raise ServerError(f"cannot listen on {host} port {port}: {reason}; choose another with {option}") from error
    sock.set_inheritable(True)
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
        "ws_per_message_deflate": False, "ws_max_size": 2**20, "lifespan": "on",
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
            print(f"MarsExplorer Playground is open at {self._address} (Ctrl-C closes it)", flush=True)
