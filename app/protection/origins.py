"""Which page a request came from: only our own pages, and scripts without a page, may change anything here.

A browser sends an Origin with everything that can change something, and with every socket; older ones that leave it out send
Sec-Fetch-Site. A script sends neither and is welcome: it has no visitor's cookies to misuse.
"""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from app.protection.hosts import SHOWN
from app.protection.refusals import Answer, refuse

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
"""Methods that change nothing (RFC 9110, section 9.2.1)."""

OWN_SITES = ("same-origin", "none")
"""Values of Sec-Fetch-Site that no other site's page can cause; "none" is an address that somebody typed."""

_ORIGIN = re.compile(r"[a-z][a-z0-9+.-]*://[^\s/?#@]*", re.IGNORECASE)


class MalformedOriginError(ValueError):
    """An Origin header is none that a browser sends."""


def has_own_origin(connection: HTTPConnection) -> bool | None:
    """Return whether a page of this server asks, by its Origin; None without one (a browser sends one with each change)."""
    own: bool | None = connection.scope["has_own_origin"]
    return own


def read_origin(headers: Headers, public_url: str | None = None) -> bool | None:
    """Return whether Origin names the host asked for, or that of `public_url`; None without one.

    A Host without a port (nginx's `$host`) speaks for any. MalformedOriginError for what is neither null nor scheme://host.
    """
    given = headers.getlist("origin")
    if not given:
        return None
    if given == ["null"]:
        return False
    if len(given) > 1 or not _ORIGIN.fullmatch(given[0]):
        raise MalformedOriginError(given[0])
    try:
        came = urlsplit(given[0])
        _ = came.port
    except ValueError as error:
        raise MalformedOriginError(given[0]) from error
    if came.scheme not in ("http", "https") or not came.hostname:
        return False
    host = headers.get("host", "").lower()
    names = (came.netloc.lower(), came.hostname)
    if public_url is not None:
        public = urlsplit(public_url)
        if (came.scheme, names[0]) == (public.scheme, public.netloc.lower()):
            return True
    return bool(host) and host in names


class OwnPages:
    """Refuses with 403 a change that another site's page asks for, every socket of one, and any malformed Origin.

    public_url   where the operator says that the server is found; None: the Host is all that is known
    """

    def __init__(self, app: ASGIApp, public_url: str | None, answer: Answer) -> None:
        self._app, self._public_url, self._answer = app, public_url, answer

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        try:
            own = read_origin(headers, self._public_url)
        except MalformedOriginError as error:
            detail = f"an Origin must be null or scheme://host, as browsers send it, got {str(error)[:SHOWN]!r}; a script needs none"
            await refuse(scope, receive, send, 403, detail, self._answer)
            return
        if self._is_changing(scope) and (
            own is False or (own is None and is_foreign_fetch(headers))
        ):
            await refuse(scope, receive, send, 403, _sentence(headers), self._answer)
            return
        await self._app({**scope, "has_own_origin": own}, receive, send)

    def _is_changing(self, scope: Scope) -> bool:
        return scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS


def is_foreign_fetch(headers: Headers) -> bool:
    """Return whether the browser says that a page of another site asks."""
    return headers.get("sec-fetch-site", "none") not in OWN_SITES


def _sentence(headers: Headers) -> str:
    came = (
        f"Origin {headers['origin'][:SHOWN]!r}"
        if "origin" in headers
        else "Sec-Fetch-Site of another site"
    )
    return (
        f"this call changes something, so it must come from a page of this server or from a script, and it came with {came}; "
        "behind a proxy, serve --public-url URL names the pages' address"
    )
