"""The pages and their files: scripts and styles are served as they stand in `static/`, pages with what they have in common."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response
from fastapi.staticfiles import StaticFiles

from app.protection import NO_CACHE, page_policy
from app.settings import STATIC
from app.web import api_docs
from app.web.templates import environment, root_of

ADMIN_CSP = page_policy(framed="'none'")
"""The operator's page stands in no frame: nobody can be made to press a button that they do not see."""

router = APIRouter(include_in_schema=False)
admin_router = APIRouter(include_in_schema=False)
"""The operator's page, for a server that has one."""


class PageFiles(StaticFiles):
    """The files of `static/`, which are the same for everybody."""

    def file_response(self, *arguments: Any, **named: Any) -> Response:
        """Return a file, or 304 where the browser has this version."""
        response = super().file_response(*arguments, **named)
        response.headers.update(NO_CACHE)
        return response


static_files = PageFiles(directory=STATIC)


def page(request: Request, name: str, headers: dict[str, str] | None = None) -> Response:
    """Return the page of a folder of `static/`, with the head and the bar that pages share."""
    text = environment.get_template(f"{name}/index.html").render(root=root_of(request))
    return HTMLResponse(text, headers=NO_CACHE if headers is None else headers)


@router.get("/")
async def play_page(request: Request) -> Response:
    """Serve the page to play on."""
    return page(request, "play")


@router.get("/study/{name}")
async def study_page(request: Request, name: str) -> Response:
    """Serve a study's page, which says so itself when there is no such study."""
    return page(request, "study")


@router.get("/leaderboard")
async def leaderboard_page(request: Request) -> Response:
    """Serve the leaderboard."""
    return page(request, "leaderboard")


@router.get("/about")
async def about_page(request: Request) -> Response:
    """Serve the page about the rules, the policies, the paper and what is stored."""
    return page(request, "about")


@router.get("/study")
async def studies_page(request: Request) -> Response:
    """Serve the page about studies, which lists those that anybody may join."""
    return page(request, "studies")


@router.get("/daily")
async def daily_page(request: Request) -> Response:
    """Serve the page of today's terrain."""
    return page(request, "daily")


@router.get("/me")
async def me_page(request: Request) -> Response:
    """Serve the page of one's own episodes."""
    return page(request, "me")


@router.get("/docs")
async def docs_page(request: Request) -> Response:
    """Serve the documentation of the API."""
    return HTMLResponse(api_docs.render_docs(request.app.openapi()), headers=NO_CACHE)


@admin_router.get("/admin")
async def admin_page(request: Request) -> Response:
    """Serve the operator's page."""
    return page(request, "admin", {"Content-Security-Policy": ADMIN_CSP})
