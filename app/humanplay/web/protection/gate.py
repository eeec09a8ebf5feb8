"""The gate: what a request says of itself is looked at here, once.

So is the handshake of a socket; the messages of one that was let in pass by. The gate leaves its
judgement in the connection, for `client_address`, `has_own_origin` and `is_secure`; handlers read
no Origin and no forwarded header themselves.

Only our own pages, and scripts without a page, may change anything. A browser sends an Origin with
everything that can change something, and with every socket; older ones that leave it out send
Sec-Fetch-Site. A script sends neither and is welcome: it has no visitor's cookies to misuse.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from humanplay.web.protection.headers import headers_of
from humanplay.web.protection.hosts import MOST_HOSTS, Proxies, hosts_of, serves

Answer = Callable[[Request, int, str], Response]
"""Makes the answer to a refused request from its status and its sentence: a page for a browser."""

SHOWN = 60
"""Characters of a stranger's input that a refusal repeats, at most."""

FOREIGN_HOST = (
    "this server does not answer for the host {!r}: open it by its IP address or as localhost; its operator makes a public "
    "address known with serve --public-url URL, or play(env, public_url=URL)"
)
TWO_LENGTHS = (
    "a request says how long its body is by Content-Length or by Transfer-Encoding, and this one has both: "
    "what stands before the server may have read another body than it would"
)
MALFORMED_ORIGIN = (
    "an Origin must be null or scheme://host, as browsers send it, got {!r}; a script needs none"
)
FOREIGN_PAGE = (
    "this call changes something, so it must come from a page of this server or from a script, and it came with {}; behind a "
    "proxy, serve --public-url URL names the pages' address"
)

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
"""Methods that change nothing (RFC 9110, section 9.2.1)."""

OWN_SITES = ("same-origin", "none")
"""Values of Sec-Fetch-Site that no other site's page can cause; "none" is a typed address."""

_ORIGIN = re.compile(r"[a-z][a-z0-9+.-]*://[^\s/?#@]*", re.IGNORECASE)
_COOKIE = re.compile(rb"[^\s\"\\,;]{1,1024}")
"""What a cookie of this server looks like. Python takes seconds for the escapes in a long value
between quotation marks (CVE-2024-7592, until 3.11.10 and 3.12.6), on the event loop."""


class RefusedRequestError(Exception):
    """A request, or the handshake of a socket, is refused.

    Args:
        status: Of the answer.
        detail: One sentence.
        wait_s: When it may come again, in seconds; None: never.
    """

    def __init__(self, status: int, detail: str, wait_s: int | None = None) -> None:
        super().__init__(detail)
        self.status, self.detail, self.wait_s = status, detail, wait_s


class Gate:
    """Looks at every request, and sets every answer's headers.

    It refuses foreign hosts and two lengths with 400, other sites' pages with 403.

    Args:
        names: What the server answers for, in lower case (`own_names`); None: for every name that is well-formed.
        proxies: Whose X-Forwarded headers count.
        public_url: Where the operator says that the server is found; None: the Host is all we know.
        cookies: The names of the server's own.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        names: frozenset[str] | None,
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
            if {b"content-length", b"transfer-encoding"} <= {name for name, _ in scope["headers"]}:
                raise RefusedRequestError(400, TWO_LENGTHS)
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
        """What `has_own_origin` says.

        Raises:
            RefusedRequestError: For another site's change.
        """
        headers = Headers(scope=scope)
        is_ours, site = self._read_origin(headers), headers.get("sec-fetch-site", "none")
        is_foreign = is_ours is False or (is_ours is None and site not in OWN_SITES)
        if is_foreign and (scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS):
            came = "Sec-Fetch-Site of another site"
            if "origin" in headers:
                came = f"Origin {headers['origin'][:SHOWN]!r}"
            raise RefusedRequestError(403, FOREIGN_PAGE.format(came))
        return is_ours

    def _read_origin(self, headers: Headers) -> bool | None:
        """Whether Origin names the host asked for, or that of the public address.

        None without one. A Host without a port (nginx's `$host`) speaks for any.

        Raises:
            RefusedRequestError: For what is neither null nor scheme://host.
        """
        origins = headers.getlist("origin")
        if not origins:
            return None
        if origins == ["null"]:
            return False
        malformed = RefusedRequestError(403, MALFORMED_ORIGIN.format(origins[0][:SHOWN]))
        if len(origins) > 1 or not _ORIGIN.fullmatch(origins[0]):
            raise malformed
        try:
            came = urlsplit(origins[0])
            _ = came.port
        except ValueError as error:
            raise malformed from error
        if came.scheme not in ("http", "https") or not came.hostname:
            return False
        if self._public_url is not None:
            public = urlsplit(self._public_url)
            if (came.scheme, came.netloc.lower()) == (public.scheme, public.netloc.lower()):
                return True
        host = headers.get("host", "").lower()
        return bool(host) and host in (came.netloc.lower(), came.hostname)

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
    """`send` with the headers of every answer, where an answer has none of its own."""
    added = Headers(headers_of(HTTPConnection(scope))).raw

    async def send_guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = list(message.get("headers", ()))
            names = {name for name, _ in headers}
            message["headers"] = headers + [header for header in added if header[0] not in names]
        await send(message)

    return send_guarded


def has_own_origin(connection: HTTPConnection) -> bool | None:
    """Whether a page of this server asks, by its Origin; None without one."""
    is_ours: bool | None = connection.scope["has_own_origin"]
    return is_ours


def with_own_cookies(scope: Scope, names: frozenset[bytes]) -> Scope:
    """A scope with the cookies of some names alone.

    A value that we cannot have set is left out.
    """
    sent = [value for name, value in scope["headers"] if name == b"cookie"]
    if not sent:
        return scope
    ours = [cookie for value in sent for cookie in value.split(b";") if _is_own(cookie, names)]
    rest = [header for header in scope["headers"] if header[0] != b"cookie"]
    return {**scope, "headers": [*rest, *([(b"cookie", b";".join(ours))] if ours else [])]}


def _is_own(cookie: bytes, names: frozenset[bytes]) -> bool:
    name, _, value = cookie.partition(b"=")
    return name.strip() in names and _COOKIE.fullmatch(value.strip()) is not None
