"""What surrounds every request and socket: an id, counts, and a line of the log.

The answer carries the id. The log names the route's pattern, `/api/sessions/{session_id}/act`, and
never the address that was asked for: addresses hold ids, and queries hold the outside ids of
participants.
"""

from __future__ import annotations

import logging
import secrets
import time
from contextvars import ContextVar

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from humanplay.db.metrics import Metrics

REQUEST_ID_HEADER = b"x-request-id"
request_id: ContextVar[str | None] = ContextVar("request_id", default=None)
"""The id of the request or socket that this task serves."""

_log = logging.getLogger(__name__)


class ObservedRequests:
    """Gives each request and socket an id, counts it, and logs it at level INFO.

    Whoever closes a socket or refuses its handshake notes the status in `scope["noted"]`; the
    messages of a socket pass untouched.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        is_socket = scope["type"] == "websocket"
        noted = scope["noted"] = {"status": 1000 if is_socket else 500}
        scope["request_id"] = secrets.token_hex(8)
        request_id.set(scope["request_id"])
        began = time.perf_counter()

        async def send_observed(message: Message) -> None:
            if message["type"] == "http.response.start":
                noted["status"] = message["status"]
                header = (REQUEST_ID_HEADER, scope["request_id"].encode())
                message["headers"] = [*message.get("headers", ()), header]
            await send(message)

        try:
            await self._app(scope, receive, send if is_socket else send_observed)
        except BaseException:
            noted["status"] = 1011 if is_socket else 500
            raise
        finally:
            self._count(is_socket, noted["status"])
            if _log.isEnabledFor(logging.INFO):
                self._write(scope, noted["status"], time.perf_counter() - began)

    def _count(self, is_socket: bool, status: int) -> None:
        if not is_socket:
            self._metrics.count_request(status)
        elif status != 1000:
            self._metrics.count_refusal(f"socket_{status}")

    def _write(self, scope: Scope, status: int, seconds: float) -> None:
        method, route = scope.get("method", "WEBSOCKET"), scope["noted"].get("route", "none")
        fields = {
            "method": method,
            "route": route,
            "status": status,
            "ms": round(seconds * 1000, 3),
        }
        _log.info("request", extra=fields)


class HeadRequests:
    """Answers HEAD wherever GET is answered: the server leaves the body away."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["method"] == "HEAD":
            # a copy: who counts and logs requests sees what was asked
            scope = {**scope, "method": "GET"}
        await self._app(scope, receive, send)


class NotedRoute:
    """Notes for ObservedRequests which route answered.

    It stands next to the router, with which it shares the scope.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await self._app(scope, receive, send)
        finally:
            if route := getattr(scope.get("route"), "path", None):
                scope["noted"]["route"] = route
