"""The 3-D view of a session: viser's page and its websocket, for whoever may see the session."""

from __future__ import annotations

from fastapi import APIRouter, Request, WebSocket
from fastapi.responses import Response

from app.play.lobby import UnknownSessionError
from app.web.access import has_own_origin, services_of, visible_session
from app.web.sockets import FOREIGN_ORIGIN, UNKNOWN_SESSION

VIEWER_CSP = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; worker-src blob: data:; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; connect-src 'self' blob: data:; "
    "frame-ancestors 'self'"
)

router = APIRouter(include_in_schema=False)


@router.get("/viewer/{session_id}/")
async def viewer_page(request: Request, session_id: str) -> Response:
    """Serve viser's page, the same for every session; its version and content are its ETag."""
    await visible_session(request, session_id)
    page = services_of(request).viewer.page
    headers = {
        "ETag": page.etag,
        "Cache-Control": "private, no-cache",
        "Vary": "Accept-Encoding",
        "Content-Security-Policy": VIEWER_CSP,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "same-origin",
    }
    if request.headers.get("if-none-match") == page.etag:
        return Response(status_code=304, headers=headers)
    if "gzip" in request.headers.get("accept-encoding", ""):
        return Response(page.zipped, media_type="text/html", headers={**headers, "Content-Encoding": "gzip"})
    return Response(page.html, media_type="text/html", headers=headers)


@router.websocket("/viewer/{session_id}")
async def viewer_socket(websocket: WebSocket, session_id: str) -> None:
    """Serve one browser's 3-D socket until it leaves."""
    if has_own_origin(websocket) is False:
        await websocket.close(FOREIGN_ORIGIN)
        return
    try:
        session = await visible_session(websocket, session_id)
    except UnknownSessionError:
        await websocket.accept()
        await websocket.close(UNKNOWN_SESSION, "unknown session")
        return
    await services_of(websocket).viewer.serve(websocket, session)
