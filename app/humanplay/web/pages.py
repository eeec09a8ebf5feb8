"""The pages and their files: scripts and styles are served as they stand in `static/`, pages with what they have in common."""

from __future__ import annotations

import asyncio
import gzip
from functools import lru_cache
from os import stat_result
from pathlib import Path
from typing import Any, NamedTuple

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.staticfiles import NotModifiedResponse
from starlette.types import Scope

from humanplay import STATIC
from humanplay.db import names
from humanplay.study.folder import Folder
from humanplay.task import Environment
from humanplay.web import api_docs
from humanplay.web.access import PLAYER, player_of, services_of
from humanplay.web.protection import NO_CACHE, page_policy
from humanplay.web.templates import environment, root_of

PAGES = {
    "/study": "studies", "/leaderboard": "leaderboard", "/about": "about",
    "/daily": "daily", "/me": "me",
}  # fmt: skip
"""The folders of `static/` whose pages are served, by their addresses."""

router = APIRouter(include_in_schema=False)
admin_router = APIRouter(include_in_schema=False)
"""The operator's page, for a server that has one."""


WORTH_ZIPPING = 600
"""Bytes from which on a text is sent gzipped; nothing that is gzipped holds a secret beside what somebody else chose."""
TEXTS = ("text/", "application/javascript", "image/svg", "application/json")


class PageFiles(StaticFiles):
    """The files of `static/`, which are the same for everybody, kept in memory; one that has changed is read again.

    A page asks for some sixty of them, and reading each anew takes most of the time.
    """

    def __init__(self, **named: Any) -> None:
        super().__init__(**named)
        self._kept: dict[str, KeptFile] = {}

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return a file, 304 where the browser has this version, or a part of one."""
        # out of the folder and in again, a file would go by any number of names and be kept under each
        if path.startswith(".."):
            raise HTTPException(404)
        headers = Headers(scope=scope)
        kept = self._kept.get(path)
        if kept is not None and kept.has_changed():
            del self._kept[path]
            kept = None
        if kept is None or "range" in headers or scope["method"] not in ("GET", "HEAD"):
            response = await super().get_response(path, scope)
            if isinstance(response, FileResponse) and kept is None:
                kept = self._kept[path] = await asyncio.to_thread(KeptFile, response)
                if response.status_code == 200 and "range" not in headers:
                    return kept.response(headers)
            response.headers.update(NO_CACHE)
            return response
        is_known = self.is_not_modified(kept.headers, headers)
        return NotModifiedResponse(kept.headers) if is_known else kept.response(headers)


class KeptFile:
    """A file in memory as it was when it was read.

    headers  those that StaticFiles gives it: type, length, time of its last change, ETag
    """

    def __init__(self, response: FileResponse) -> None:
        assert response.stat_result is not None
        self._path, self._seen = Path(response.path), _version(response.stat_result)
        self._body = self._path.read_bytes()
        self.headers = Headers(raw=[*response.raw_headers, *Headers(NO_CACHE).raw])
        self._zipped: bytes | None = None
        if len(self._body) >= WORTH_ZIPPING and (response.media_type or "").startswith(TEXTS):
            self._zipped = gzip.compress(self._body, 9, mtime=0)
            self.headers = Headers(raw=[*self.headers.raw, (b"vary", b"Accept-Encoding")])

    def has_changed(self) -> bool:
        """Return whether the file is another one by now, or gone."""
        try:
            return _version(self._path.stat()) != self._seen
        except OSError:
            return True

    def response(self, asked: Headers) -> Response:
        """Return the whole file, gzipped where the browser reads that; `asked` are the headers of the request."""
        response = Response()
        response.body, response.raw_headers = self._body, list(self.headers.raw)
        if self._zipped is not None and reads_gzip(asked):
            response.body = self._zipped
            response.headers.update(zipped_headers(self._zipped))
        return response


def reads_gzip(asked: Headers) -> bool:
    """Return whether whoever asks reads what is gzipped."""
    return "gzip" in asked.get("accept-encoding", "")


def zipped_headers(content: bytes) -> dict[str, str]:
    """Return the headers of an answer that is gzipped."""
    return {"Content-Encoding": "gzip", "Content-Length": str(len(content))}


def _version(found: stat_result) -> tuple[int, int, int]:
    return found.st_mtime_ns, found.st_size, found.st_ino


static_files = PageFiles(directory=STATIC)


def page(request: Request, name: str, headers: dict[str, str] = NO_CACHE) -> Response:
    """Return the page of a folder of `static/`, with the head and the bar that pages share."""
    text = environment.get_template(f"{name}/index.html").render(root=root_of(request))
    if not reads_gzip(request.headers):
        return HTMLResponse(text, headers={**headers, "Vary": "Accept-Encoding"})
    content = _zipped(text)
    more = {"Vary": "Accept-Encoding", **zipped_headers(content)}
    return HTMLResponse(content, headers={**headers, **more})


@lru_cache(maxsize=32)
def _zipped(text: str) -> bytes:
    return gzip.compress(text.encode(), 6, mtime=0)


def _serve(router: APIRouter, path: str, folder: str, headers: dict[str, str]) -> None:
    async def serve(request: Request) -> Response:
        return page(request, folder, headers)

    router.add_api_route(path, serve, methods=["GET"], name=f"{folder}_page")


@router.get("/")
async def play_page(request: Request, invitation: str = "") -> Response:
    """Serve the playground; first ask for a name, or know whoever comes by their invitation, where the server asks for that."""
    services = services_of(request)
    if not services.asks_name:
        return page(request, "play")
    if services.player_tokens.read(invitation) is not None:
        response = RedirectResponse("./", 303, NO_CACHE)
        PLAYER.set(response, request, invitation)
        return response
    player = player_of(request)
    is_named = player is not None and await services.store.read(
        lambda: names.own(services.store, player)["name"] is not None
    )
    if is_named:
        return page(request, "play")
    text = environment.get_template("name/index.html").render(
        root=root_of(request), about=services.lobby.task.about
    )
    return HTMLResponse(text, headers=NO_CACHE)


for _path, _folder in PAGES.items():
    _serve(router, _path, _folder, NO_CACHE)
_serve(admin_router, "/admin", "admin", {"Content-Security-Policy": page_policy(framed="'none'")})
# it stands in no frame: nobody can be made to press a button that they do not see


class PlayedTask(NamedTuple):
    """One of the environments that are played here, and the studies beside its database."""

    environment: Environment
    studies: Folder


@router.get("/play")
async def offers_page(request: Request) -> Response:
    """Serve the list of the environments that can be played here."""
    first, *others = request.app.state.offers.items()
    root = root_of(request) + "../../" * bool(request.scope.get("root_path"))
    offers = [
        (root or "./", first[1].environment.about),
        *((f"{root}play/{name}/", played.environment.about) for name, played in others),
    ]
    text = environment.get_template("offers/index.html").render(
        root=root_of(request), offers=offers
    )
    return HTMLResponse(text, headers=NO_CACHE)


@router.get("/play/{name}")
async def offer_page(request: Request, name: str) -> Response:
    """Lead to an environment that can be played here; 404 for none."""
    names = list(request.app.state.offers)
    if name not in names:
        raise HTTPException(404, f"no environment {name!r} is played here; /play lists them")
    return RedirectResponse("../" if name == names[0] else f"{name}/", 308)


@router.get("/study/{name}")
async def study_page(request: Request, name: str) -> Response:
    """Serve the page of a study, or lead to the environment played here that has it."""
    own, offers = services_of(request).progress.folder, request.app.state.offers
    if name not in own.names():  # the page shows what the API says of it
        for number, (offer, played) in enumerate(offers.items()):
            if name in played.studies.names():
                root = root_of(request) + "../../" * bool(request.scope.get("root_path"))
                place = f"play/{offer}/study/{name}" if number else f"study/{name}"
                at = request.url.replace(path=place, netloc="", scheme="")
                return RedirectResponse(f"{root}{at}", 307, NO_CACHE)
    return page(request, "study")


@router.get("/studies")
async def studies_page() -> Response:
    """Lead whoever guesses the address of the studies to their page."""
    return RedirectResponse("study", 308)


@router.get("/docs")
async def docs_page(request: Request) -> Response:
    """Serve the documentation of the API."""
    return HTMLResponse(api_docs.render_docs(request.app.openapi()), headers=NO_CACHE)
