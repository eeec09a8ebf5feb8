"""How the middleware of this package refuses a request: with a status and one sentence, and the connection is closed.

So whoever asks on regardless needs a connection for each request, and an address opens these at a rate (`limits.opened`).
"""

from __future__ import annotations

from collections.abc import Callable

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import Receive, Scope, Send

Answer = Callable[[Request, int, str], Response]
"""Makes the answer to a refused request from its status and its sentence; the server's draws pages for browsers."""


async def refuse(
    scope: Scope, receive: Receive, send: Send, status: int, detail: str, answer: Answer
) -> None:
    """Answer a request, or the handshake of a socket, with a status and a sentence, and close the connection."""
    response = (
        answer(Request(scope), status, detail)
        if scope["type"] == "http"
        else JSONResponse({"detail": detail}, status)
    )
    response.headers["connection"] = "close"
    await response(scope, receive, send)
