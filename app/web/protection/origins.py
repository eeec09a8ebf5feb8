"""Which page a request came from, and which cookies came with it.

Only our own pages, and scripts without a page, may change anything. A browser sends an Origin with
everything that can change something, and with every socket; older ones that leave it out send
Sec-Fetch-Site. A script sends neither and is welcome: it has no visitor's cookies to misuse.
"""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.types import Scope

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
"""Methods that change nothing (RFC 9110, section 9.2.1)."""

OWN_SITES = ("same-origin", "none")
"""Values of Sec-Fetch-Site that no other site's page can cause; "none" is a typed address."""

_ORIGIN = re.compile(r"[a-z][a-z0-9+.-]*://[^\s/?#@]*", re.IGNORECASE)
_COOKIE = re.compile(rb"[^\s\"\\,;]{1,1024}")
"""What a cookie of this server looks like. Python takes seconds for the escapes in a long value
between quotation marks (CVE-2024-7592, until 3.11.10 and 3.12.6), on the event loop."""


class MalformedOriginError(ValueError):
    """An Origin header is none that a browser sends."""


def has_own_origin(connection: HTTPConnection) -> bool | None:
    """Return whether a page of this server asks, by its Origin; None without one."""
    own: bool | None = connection.scope["has_own_origin"]
    return own


def read_origin(headers: Headers, public_url: str | None = None) -> bool | None:
    """Return whether Origin names the host asked for, or that of `public_url`; None without one.

    A Host without a port (nginx's `$host`) speaks for any. MalformedOriginError for what is neither
    null nor scheme://host.
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


def is_changing(scope: Scope) -> bool:
    """Return whether a request may change something; every socket may."""
    return scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS


def is_foreign_fetch(headers: Headers) -> bool:
    """Return whether the browser says that a page of another site asks."""
    return headers.get("sec-fetch-site", "none") not in OWN_SITES


def with_own_cookies(scope: Scope, names: frozenset[bytes]) -> Scope:
    """Return a scope with the cookies of some names alone, and no value that we cannot have set."""
    given = [value for name, value in scope["headers"] if name == b"cookie"]
    if not given:
        return scope
    own = [each for value in given for each in value.split(b";") if _is_own(each, names)]
    rest = [each for each in scope["headers"] if each[0] != b"cookie"]
    return {**scope, "headers": [*rest, *([(b"cookie", b";".join(own))] if own else [])]}


def _is_own(cookie: bytes, names: frozenset[bytes]) -> bool:
    name, _, value = cookie.partition(b"=")
    return name.strip() in names and _COOKIE.fullmatch(value.strip()) is not None
