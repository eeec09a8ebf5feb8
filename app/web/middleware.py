"""What surrounds every request beside `app.protection`: a limit on the size of a body."""

from __future__ import annotations

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.play.messages import MAX_MESSAGE_BYTES


class BodyLimit:
    """Refuses bodies over MAX_MESSAGE_BYTES with 413."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        length = Headers(scope=scope).get("content-length", "0")
        if length.isdigit() and int(length) > MAX_MESSAGE_BYTES:
            await JSONResponse({"detail": _too_large(int(length))}, 413)(scope, receive, send)
            return
        await self._app(scope, _capped(receive), send)


def _too_large(size: int) -> str:
    return f"a body must be at most {MAX_MESSAGE_BYTES} bytes, got {size} or more"


def _capped(receive: Receive) -> Receive:
    """Return `receive`, raising HTTPException 413 once a body without a length has grown too long."""
    taken = 0

    async def receive_capped() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        if taken > MAX_MESSAGE_BYTES:
            raise HTTPException(413, _too_large(taken))
        return message

    return receive_capped
