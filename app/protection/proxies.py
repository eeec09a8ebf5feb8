"""Headers by which a proxy tells whose request it hands on: they count from named proxies alone."""

from __future__ import annotations

from collections.abc import Sequence
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

FORWARDED = (
    b"x-forwarded-for",
    b"x-forwarded-host",
    b"x-forwarded-port",
    b"x-forwarded-prefix",
    b"x-forwarded-proto",
)


class ForwardedHeaders:
    """Takes client address, scheme and host from the X-Forwarded headers of named proxies, and drops everybody else's.

    Uvicorn's ProxyHeadersMiddleware reads the address (the last one in X-Forwarded-For that is no proxy's) and the scheme.
    What stands in X-Forwarded-Host becomes the Host; `AllowedHosts` has looked at it before. Only X-Forwarded-Prefix
    remains for handlers to read.

    proxies     addresses and networks of the named proxies, as text
    public_url  says scheme and path prefix of what is asked for under its host, where no named proxy does
    """

    def __init__(self, app: ASGIApp, proxies: Sequence[str], public_url: str | None = None) -> None:
        self._app, self._public = app, urlsplit(public_url or "")
        self._reading = ProxyHeadersMiddleware(self._hand_on, list(proxies))  # type: ignore[arg-type]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        peer = scope.get("client")
        if peer is not None and peer[0] in self._reading.trusted_hosts:
            await self._reading(scope, receive, send)  # type: ignore[arg-type]
            return
        kept = [(name, value) for name, value in scope["headers"] if name not in FORWARDED]
        await self._app(self._as_public({**scope, "headers": kept}), receive, send)

    async def _hand_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on what a named proxy sent, under the host that the browser asked for."""
        hosts = [
            value
            for name, value in scope["headers"]
            if name == b"x-forwarded-host" and value.strip()
        ]
        if hosts:
            kept = [(name, value) for name, value in scope["headers"] if name != b"host"]
            scope = {**scope, "headers": [(b"host", hosts[0].split(b",")[0].strip()), *kept]}
        await self._app(self._as_public(scope), receive, send)

    def _as_public(self, scope: Scope) -> Scope:
        """Return a scope with the scheme and the prefix of the public address, if that is what was asked for."""
        headers = Headers(scope=scope)
        if not self._public.netloc or headers.get("host", "").lower() not in (
            self._public.netloc,
            self._public.hostname,
        ):
            return scope
        if self._public.scheme == "https":
            scope = {**scope, "scheme": "wss" if scope["type"] == "websocket" else "https"}
        if self._public.path and "x-forwarded-prefix" not in headers:
            scope = {
                **scope,
                "headers": [*scope["headers"], (b"x-forwarded-prefix", self._public.path.encode())],
            }
        return scope
