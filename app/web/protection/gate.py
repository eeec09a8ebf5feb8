"""The gate: what a request, or the handshake of a socket, says of itself is looked at here, once.

It leaves its judgement in the connection, for `client_address`, `has_own_origin` and `is_secure`;
handlers read no Origin and no forwarded header themselves. The messages of a socket that was let in
pass by it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.web.protection.headers import headers_of
from app.web.protection.hosts import MOST_HOSTS, Proxies, hosts_of, serves
from app.web.protection.origins import (
    MalformedOriginError,
    is_changing,
    is_foreign_fetch,
    read_origin,
    with_own_cookies,
)

Answer = Callable[[Request, int, str], Response]
"""Makes the answer to a refused request from its status and its sentence: a page for a browser."""

SHOWN = 60
"""Characters of a stranger's input that a refusal repeats, at most."""

FOREIGN_HOST = (
    "this server does not answer for the host {!r}: open it by its IP address or as localhost; its operator makes a public "
    "address known with serve --public-url URL"
)
MALFORMED_ORIGIN = (
    "an Origin must be null or scheme://host, as browsers send it, got {!r}; a script needs none"
)
FOREIGN_PAGE = (
    "this call changes something, so it must come from a page of this server or from a script, and it came with {}; behind a "
    "proxy, serve --public-url URL names the pages' address"
)


class RefusedRequestError(Exception):
    """A request, or the handshake of a socket, is refused: with a status and one sentence.

    wait_s  when it may come again, in seconds; None: never
    """

    def __init__(self, status: int, detail: str, wait_s: int | None = None) -> None:
        super().__init__(detail)
        self.status, self.detail, self.wait_s = status, detail, wait_s


class Gate:
    """Refuses foreign hosts with 400 and other sites' pages with 403, and sets every answer's headers.

    names       what the server answers for, in lower case (`own_names`)
    proxies     whose X-Forwarded headers count
    public_url  where the operator says that the server is found; None: the Host is all we know
    cookies     the names of the server's own
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        names: frozenset[str],
        proxies: Proxies,
        public_url: str | None,
        cookies: Iterable[str],
        answer: Answer,
    ) -> None:
        self._app, self._answer = app, answer
        self._names, self._proxies, self._public_url = names, proxies, public_url
        self._cookies = frozenset(name.encode() for name in cookies)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        answering = send if scope["type"] == "websocket" else _with_headers(scope, send)
        try:
            self._check_host(scope)
            scope = self._proxies.scope_of(scope)
            answering = send if scope["type"] == "websocket" else _with_headers(scope, send)
            scope = {**with_own_cookies(scope, self._cookies), "has_own_origin": self._own(scope)}
            await self._app(scope, receive, answering)
        except RefusedRequestError as refusal:
            await self._refuse(scope, receive, answering, refusal)

    def _check_host(self, scope: Scope) -> None:
        hosts = hosts_of(scope)
        if len(hosts) > MOST_HOSTS:
            raise RefusedRequestError(400, f"a request must name {MOST_HOSTS} hosts at most")
        for host in hosts:
            if not serves(self._names, host):
                raise RefusedRequestError(400, FOREIGN_HOST.format(host[:SHOWN]))

    def _own(self, scope: Scope) -> bool | None:
        """Return what `has_own_origin` says; RefusedRequestError for another site's change."""
        headers = Headers(scope=scope)
        try:
            own = read_origin(headers, self._public_url)
        except MalformedOriginError as error:
            raise RefusedRequestError(403, MALFORMED_ORIGIN.format(str(error)[:SHOWN])) from error
        if is_changing(scope) and (own is False or (own is None and is_foreign_fetch(headers))):
            came = "Sec-Fetch-Site of another site"
            if "origin" in headers:
                came = f"Origin {headers['origin'][:SHOWN]!r}"
            raise RefusedRequestError(403, FOREIGN_PAGE.format(came))
        return own

    async def _refuse(
        self, scope: Scope, receive: Receive, send: Send, refusal: RefusedRequestError
    ) -> None:
        """Answer a refusal and close the connection."""
        if scope["type"] == "websocket":
            scope["noted"]["status"] = refusal.status
            response: Response = JSONResponse({"detail": refusal.detail}, refusal.status)
        else:
            response = self._answer(Request(scope), refusal.status, refusal.detail)
        response.headers["connection"] = "close"
        if refusal.wait_s is not None:
            response.headers["retry-after"] = str(refusal.wait_s)
        await response(scope, receive, send)


def _with_headers(scope: Scope, send: Send) -> Send:
    """Return `send` with the headers of every answer, where an answer has none of its own."""
    added = Headers(headers_of(HTTPConnection(scope))).raw

    async def send_guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = list(message.get("headers", ()))
            names = {name for name, _ in given}
            message["headers"] = given + [each for each in added if each[0] not in names]
        await send(message)

    return send_guarded
