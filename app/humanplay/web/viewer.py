"""The 3-D view of a session: viser's page and its websocket.

They are for whoever may see the session.
"""

from __future__ import annotations

from fastapi import APIRouter, HTTPException, Request, WebSocket
from fastapi.responses import RedirectResponse, Response

from humanplay.board.lobby import UnknownSessionError
from humanplay.task import View3D, ViewPage
from humanplay.web.access import close, services_of, session_of
from humanplay.web.protection import framing_sites, viewer_policy
from humanplay.web.sockets import UNKNOWN_SESSION

NO_VIEW = "this server's environment has no 3-D view"
router = APIRouter(include_in_schema=False)


@router.get("/viewer/client/")
async def newest_client(request: Request) -> Response:
    """Send a browser to the client's address of this version.

    There it keeps the client for as long as it likes.
    """
    query = f"?{request.url.query}" if request.url.query else ""
    address = f"{_viewer(request).page.version}/{query}"
    return RedirectResponse(address, 307, {"Cache-Control": "no-cache"})


@router.get("/viewer/client/{version}/")
async def client_page(request: Request, version: str) -> Response:
    """Serve viser's page for every board; the name of its frame says which.

    Another version is sent to this server's own.
    """
    page = _viewer(request).page
    if version != page.version:
        return RedirectResponse(f"../{page.version}/", 307, {"Cache-Control": "no-cache"})
    return client_response(request, page, "public, max-age=31536000, immutable")


@router.get("/viewer/{session_id}/")
async def viewer_page(request: Request, session_id: str) -> Response:
    """Serve viser's page under a session's own address."""
    await session_of(request, session_id)
    return client_response(request, _viewer(request).page, "private, no-cache")


def _viewer(request: Request) -> View3D:
    """The 3-D view.

    Raises:
        HTTPException: 404 on a server of another task.
    """
    if (viewer := services_of(request).viewer) is None:
        raise HTTPException(404, NO_VIEW)
    return viewer


def client_response(request: Request, page: ViewPage, cache_control: str) -> Response:
    """The page, or 304 if the browser has this version.

    It is gzipped if the browser reads that.
    """
    headers = {
        "ETag": page.etag,
        "Cache-Control": cache_control,
        "Vary": "Accept-Encoding",
        "Content-Security-Policy": viewer_policy(page.script_hashes, framing_sites(request)),
    }
    if request.headers.get("if-none-match") == page.etag:
        return Response(status_code=304, headers=headers)
    content = page.html
    if "gzip" in request.headers.get("accept-encoding", ""):
        content, headers["Content-Encoding"] = page.zipped, "gzip"
    return Response(content, media_type="text/html", headers=headers)


@router.websocket("/viewer/{session_id}")
async def viewer_socket(websocket: WebSocket, session_id: str) -> None:
    """Serve one browser's 3-D socket until it leaves."""
    try:
        session = await session_of(websocket, session_id)
    except UnknownSessionError:
        await websocket.accept()
        await close(websocket, UNKNOWN_SESSION, "unknown session")
        return
    if (viewer := services_of(websocket).viewer) is None:
        await websocket.accept()
        await close(websocket, UNKNOWN_SESSION, NO_VIEW)
        return
    await viewer.serve(websocket, session)
