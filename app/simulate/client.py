"""The page of a synthetic player: the same HTTP calls and the same socket as a browser's, and the player's cookie.

Nothing is retried here. A lost server is a `ConnectionLostError`, a request that the server declines a `RequestRefusedError`;
the participant asks `GET me` where it stands and goes on.
"""

from __future__ import annotations

import asyncio
import json
import os
import ssl
from functools import cache
from typing import Any
from urllib.parse import quote, urlsplit

import httpx
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as open_websocket
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidMessage
from websockets.typing import Origin

COOKIE_NAME = "mars_player"
TOKEN_VARIABLE = "MARS_LIMITS__TOKEN"
"""The variable that holds the server's token, with which a server does not limit how many players join and play."""
ANSWER_TIMEOUT_S = 20.0
"""The time that one answer may take."""
SERVER_AWAY_STATUSES = (502, 503, 504)
"""The answers of a proxy while the server behind it is away."""


class ConnectionLostError(Exception):
    """The server is away, or the connection has broken."""


class RequestRefusedError(Exception):
    """The server declined: `status` and its sentence."""

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(detail)
        self.status, self.detail = status, detail


@cache
def _certificates() -> ssl.SSLContext:
    """Return the certificates that servers are checked against, read once for all players."""
    return httpx.create_ssl_context(trust_env=False)


def _token() -> dict[str, str]:
    """Return the header that says that this server's operator lets these players in."""
    token = os.environ.get(TOKEN_VARIABLE)
    return {"X-Mars-Token": token} if token else {}


class Page:
    """One browser tab: an HTTP client with the player's cookie, and at most one socket; ValueError for no http address."""

    def __init__(self, url: str, study: str, cookie: str | None = None) -> None:
        self.url, self.study = url.rstrip("/"), quote(study, safe="")
        parts = urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f"an address must be like http://127.0.0.1:8000, got {url!r}")
        self._origin = f"{parts.scheme}://{parts.netloc}"
        self._http = httpx.AsyncClient(
            timeout=ANSWER_TIMEOUT_S,
            trust_env=False,
            verify=_certificates(),
            headers={"Origin": self._origin, **_token()},
        )
        if cookie is not None:
            self._http.headers["Cookie"] = f"{COOKIE_NAME}={cookie}"
        self.cookie = cookie
        self._socket: ClientConnection | None = None
        self.session: str | None = None

    async def ask(self, method: str, path: str, body: Any = None) -> httpx.Response:
        """Return the answer to any call, refused or not; ConnectionLostError when there is none."""
        try:
            answer = await self._http.request(method, f"{self.url}/{path}", json=body)
        except httpx.TransportError as error:
            raise ConnectionLostError(str(error) or type(error).__name__) from error
        if answer.status_code in SERVER_AWAY_STATUSES:
            raise ConnectionLostError(f"{answer.status_code} {answer.reason_phrase}")
        return answer

    async def call(self, verb: str, body: Any = None) -> dict[str, Any]:
        """Return the answer of api/studies/STUDY/VERB: a GET without a body, else a POST."""
        path = f"api/studies/{self.study}" + (f"/{verb}" if verb else "")
        answer = await self.ask("GET" if body is None else "POST", path, body)
        if answer.is_error:
            raise RequestRefusedError(answer.status_code, detail_of(answer))
        found: dict[str, Any] = answer.json()
        return found

    async def join(self, outside_ids: dict[str, str], script: str) -> dict[str, Any]:
        """Join the study and return where the participant stands; the cookie is kept from then on."""
        found = await self.call("join", {"outside_ids": outside_ids, "script": script})
        self.cookie = self._http.cookies.get(COOKIE_NAME) or self.cookie
        self._http.cookies.clear()
        self._http.headers["Cookie"] = f"{COOKIE_NAME}={self.cookie}"
        return found

    async def open(self, session: str, path: str = "ws/sessions") -> None:
        """Open the socket of a session, after the old one is closed."""
        await self.close_socket()
        self._socket = await self.connect(f"{path}/{session}")
        self.session = session

    async def connect(self, path: str, cookie: str | None = None) -> ClientConnection:
        """Open and return a further socket of this page (or with another's cookie)."""
        url = "ws" + self.url.removeprefix("http") + f"/{path}"
        headers = {"Cookie": f"{COOKIE_NAME}={cookie or self.cookie}", **_token()}
        try:
            return await open_websocket(
                url, origin=Origin(self._origin), additional_headers=headers, proxy=None, compression=None, max_size=None,
                open_timeout=ANSWER_TIMEOUT_S, close_timeout=1.0,
            )  # fmt: skip
        except (
            OSError,
            TimeoutError,
            InvalidHandshake,
            InvalidMessage,
            EOFError,
            ConnectionClosed,
        ) as error:
            raise ConnectionLostError(str(error) or type(error).__name__) from error

    @property
    def is_open(self) -> bool:
        """Whether there is a socket that has not been found broken."""
        return self._socket is not None

    async def send(self, message: dict[str, Any]) -> None:
        """Send a message over the socket."""
        if self._socket is None:
            raise ConnectionLostError("the socket is closed")
        try:
            await self._socket.send(json.dumps(message))
        except (ConnectionClosed, OSError) as error:
            raise ConnectionLostError(str(error)) from error

    async def receive(self) -> dict[str, Any]:
        """Return the next message of the socket."""
        if self._socket is None:
            raise ConnectionLostError("the socket is closed")
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                found: dict[str, Any] = json.loads(await self._socket.recv())
        except (ConnectionClosed, OSError, TimeoutError) as error:
            raise ConnectionLostError(
                str(error) or f"no message within {ANSWER_TIMEOUT_S:.0f} s"
            ) from error
        return found

    async def close_socket(self) -> None:
        """Close the socket, as a tab does that is closed."""
        socket, self._socket, self.session = self._socket, None, None
        if socket is not None:
            await close_or_abort(socket)

    async def close(self) -> None:
        """Close everything, also when this is cancelled on the way."""
        try:
            await self.close_socket()
        finally:
            await self._http.aclose()


async def close_or_abort(socket: ClientConnection) -> None:
    """Close a socket with the closing handshake, or at once when this is cancelled on the way."""
    try:
        await socket.close()
    finally:
        socket.transport.abort()


def detail_of(answer: httpx.Response) -> str:
    """Return the server's sentence."""
    try:
        return str(answer.json()["detail"])
    except (ValueError, KeyError, TypeError):
        return f"{answer.status_code} {answer.reason_phrase}"
