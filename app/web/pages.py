"""The pages and their files: HTML, scripts and styles are served as they stand in `static/`."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, HTMLResponse, Response
from fastapi.staticfiles import StaticFiles

from app.settings import STATIC
from app.web import api_docs
from app.web.middleware import PAGE_CSP

ADMIN_CSP = PAGE_CSP.replace("frame-ancestors 'self'", "frame-ancestors 'none'")
"""The operator's page stands in no frame: nobody can be made to press a button that they do not see."""

router = APIRouter(include_in_schema=False)
admin_router = APIRouter(include_in_schema=False)
"""The operator's page, for a server that has one."""

static_files = StaticFiles(directory=STATIC)


@router.get("/")
async def play_page() -> Response:
    """Serve the page to play on."""
    return FileResponse(STATIC / "play" / "index.html")


@router.get("/study/{name}")
async def study_page(name: str) -> Response:
    """Serve a study's page, which says so itself when there is no such study."""
    return FileResponse(STATIC / "study" / "index.html")


@router.get("/leaderboard")
async def leaderboard_page() -> Response:
    """Serve the leaderboard."""
    return FileResponse(STATIC / "leaderboard" / "index.html")


@router.get("/about")
async def about_page() -> Response:
    """Serve the page about the rules, the policies, the paper and what is stored."""
    return FileResponse(STATIC / "about" / "index.html")


@router.get("/study")
async def studies_page() -> Response:
    """Serve the page about studies, which lists those that anybody may join."""
    return FileResponse(STATIC / "studies" / "index.html")


@router.get("/daily")
async def daily_page() -> Response:
    """Serve the page of today's terrain."""
    return FileResponse(STATIC / "daily" / "index.html")


@router.get("/me")
async def me_page() -> Response:
    """Serve the page of one's own episodes."""
    return FileResponse(STATIC / "me" / "index.html")


@router.get("/docs")
async def docs_page(request: Request) -> Response:
    """Serve the documentation of the API."""
    return HTMLResponse(api_docs.render_docs(request.app.openapi()))


@admin_router.get("/admin")
async def admin_page() -> Response:
    """Serve the operator's page."""
    return FileResponse(STATIC / "admin" / "index.html", headers={"Content-Security-Policy": ADMIN_CSP})
