"""The cookies of a request: only our own are handed on, as they were set."""

from __future__ import annotations

import re
from collections.abc import Iterable

from starlette.types import ASGIApp, Receive, Scope, Send

_VALUE = re.compile(rb"[^\s\"\\,;]{1,1024}")
"""What a cookie of this server looks like. Python takes seconds for the escapes in a long value between quotation marks
(CVE-2024-7592, until 3.11.10 and 3.12.6), on the event loop and for a cookie of any name; ours has none."""


class OwnCookies:
    """Hands on the cookies of some names alone, and of these no value that this server cannot have set."""

    def __init__(self, app: ASGIApp, names: Iterable[str]) -> None:
        self._app, self._names = app, frozenset(name.encode() for name in names)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket"):
            given = [value for name, value in scope["headers"] if name == b"cookie"]
            if given:
                rest = [each for each in scope["headers"] if each[0] != b"cookie"]
                own = [each for value in given for each in value.split(b";") if self._is_own(each)]
                scope = {
                    **scope,
                    "headers": [*rest, *([(b"cookie", b";".join(own))] if own else [])],
                }
        await self._app(scope, receive, send)

    def _is_own(self, cookie: bytes) -> bool:
        name, _, value = cookie.partition(b"=")
        return name.strip() in self._names and _VALUE.fullmatch(value.strip()) is not None
