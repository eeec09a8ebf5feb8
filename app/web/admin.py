"""The page /admin and its calls; none of this exists on a server that was started without a password.

Every call asks the door first. What changes anything must come from our own page: its Origin says so, and the cookie is
sent from nowhere else.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncGenerator
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, HTTPException, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import FileResponse
from pydantic import Field

from app.admin import live_boards, participants
from app.admin.exports import ExportKind, ExportRunningError, Exports
from app.admin.health import Health
from app.play.lobby import UnknownSessionError
from app.play.messages import Message, encode_error
from app.storage.reader import Reader
from app.study.folder import Study
from app.study.progress import ParticipantProgress
from app.study.protocol import DraftStudyError, StudyError, UnknownStudyError
from app.web.admin_login import AdminLogin, TooManyAttemptsError, WrongPasswordError, forget, remember
from app.web.cookies import has_own_origin
from app.web.middleware import PAGE_CSP
from app.web.sockets import FOREIGN_ORIGIN, UNKNOWN_SESSION
from marsexplorer.config import CORE_VERSION

ALONE = PAGE_CSP.replace("frame-ancestors 'self'", "frame-ancestors 'none'")
"""In no page's frame: nobody can be made to press a button that they do not see."""

STRANGER = 4401
"""Close code of a socket without the operator's cookie."""


class Login(Message):
    """What the operator types."""

    password: str


class Close(Message):
    """The study's name once more: closing has no way back."""

    name: str


class Release(Message):
    """Who is to be cited."""

    authors: list[Annotated[str, Field(min_length=1, max_length=200)]] = Field(default_factory=list, max_length=50)


class AdminServices:
    """What the operator's calls work on."""

    def __init__(self, door: AdminLogin, progress: ParticipantProgress, studies: Path) -> None:
        database = progress.lobby.store.path
        self.door, self.progress = door, progress
        self.health, self.figures = Health(database), participants.LiveFigures(database)
        self.exports = Exports(database, studies)
        self.began = time.monotonic()

    def study(self, name: str) -> Study:
        """Return a frozen study; HTTPException 404 or 409 with what is wrong with it."""
        try:
            return self.progress.folder.study(name)
        except (UnknownStudyError, DraftStudyError) as error:
            raise HTTPException(404, str(error)) from error
        except StudyError as error:
            raise HTTPException(409, str(error)) from error

    def studies(self) -> list[dict[str, Any]]:
        """Return every study in the folder: drafts and broken ones too, with what is wrong."""
        return [self._listed(name) for name in self.progress.folder.names()]

    def _listed(self, name: str) -> dict[str, Any]:
        folder = self.progress.folder
        try:
            status, title = folder.status(name), folder.draft(name).title
            if status != "draft":
                folder.study(name)
        except StudyError as error:
            return {"name": name, "title": name, "status": "broken", "error": str(error)}
        return {"name": name, "title": title, "status": status, "error": None}


def check_page(request: Request) -> None:
    """Return when the call comes from a page of ours, or is a reading one without an Origin; HTTPException 403 otherwise."""
    own = has_own_origin(request)
    if own is False or (own is None and request.method not in ("GET", "HEAD")):
        raise HTTPException(403, "this call must come from the operator's own page, at /admin of this server")


def check_operator(request: Request, response: Response) -> AdminServices:
    """Return the console for the operator on our page; HTTPException 401 or 403 for anybody else."""
    response.headers["Cache-Control"] = "no-store"
    check_page(request)
    console = _console(request)
    if not console.door.admits(request):
        raise HTTPException(401, "log in at /admin first: this is the operator's alone")
    return console


def _console(connection: Request | WebSocket) -> AdminServices:
    found: AdminServices = connection.app.state.console
    return found


Operator = Annotated[AdminServices, Depends(check_operator)]


def router(page: Path) -> APIRouter:
    """Return the routes; `page` is the HTML file."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/admin")
    async def admin() -> FileResponse:
        return FileResponse(page, headers={"Content-Security-Policy": ALONE})

    routes.include_router(_calls)
    return routes


_calls = APIRouter(include_in_schema=False)


@_calls.post("/api/admin/login", dependencies=[Depends(check_page)])
async def login(request: Request, response: Response, given: Login) -> dict[str, Any]:
    """Open the door."""
    try:
        value = _console(request).door.open(given.password, request.client.host if request.client else "")
    except WrongPasswordError as error:
        raise HTTPException(401, str(error)) from error
    except TooManyAttemptsError as error:
        raise HTTPException(429, str(error), {"Retry-After": str(error.wait_s)}) from error
    remember(response, request, value)
    return {"in": True}


@_calls.post("/api/admin/logout", dependencies=[Depends(check_page)])
async def logout(request: Request, response: Response) -> dict[str, Any]:
    """Close it behind oneself."""
    _console(request).door.leave(request)
    forget(response, request)
    return {"in": False}


@_calls.get("/api/admin/overview")
async def overview(console: Operator) -> dict[str, Any]:
    """Studies, boards and the server's health."""
    health = await asyncio.to_thread(console.health.state)
    lobby = console.progress.lobby
    return {
        "studies": await asyncio.to_thread(console.studies),
        "boards": live_boards.list_boards(lobby, console.progress.records),
        "health": {**health, "sessions": len(lobby), "up_s": round(time.monotonic() - console.began)},
        "core_version": CORE_VERSION,
        "now_ms": lobby.sources.clock_ms(),
    }


@_calls.get("/api/admin/studies/{name}")
async def study(console: Operator, name: str) -> dict[str, Any]:
    """A study as it stands: participants, figure, labels, exports."""
    found = console.study(name)
    store, now = console.progress.lobby.store, console.progress.lobby.sources.clock_ms()

    def read() -> list[dict[str, Any]]:
        with closing(Reader.open(store.path)) as reader:
            return participants.list_participants(reader, name, now)

    present = await asyncio.to_thread(read)
    protocol = found.protocol
    return {
        "name": name,
        "title": protocol.title,
        "status": "open" if found.is_open else "closed",
        "frozen_ms": found.frozen_ms,
        "closed_ms": found.closed_ms,
        "protocol_hash": found.protocol_hash,
        "commitment": found.commitment,
        "level": protocol.env_config.level,
        "rows": protocol.env_config.rows,
        "cols": protocol.env_config.cols,
        "max_steps": protocol.env_config.limit,
        "planned": protocol.players,
        "warm_up": protocol.warm_up,
        "ranked": protocol.ranked,
        "stages": participants.count_stages(present),
        "participants": present,
        **await asyncio.to_thread(console.figures.of, name),
        "exports": console.exports.state(name),
        "now_ms": now,
    }


@_calls.post("/api/admin/studies/{name}/close")
async def close(console: Operator, name: str, given: Close) -> dict[str, Any]:
    """End the study for good; 422 unless its name was typed."""
    if given.name != name:
        raise HTTPException(422, f"type the study's name, {name!r}, to close it for ever; got {given.name[:60]!r}")
    console.study(name)
    try:
        closed = await asyncio.to_thread(console.progress.folder.close, name)
    except StudyError as error:
        raise HTTPException(409, str(error)) from error
    console.progress.records.note_closed(closed)
    return {"closed_ms": closed.closed_ms}


@_calls.post("/api/admin/studies/{name}/exports/{what}", status_code=202)
async def begin_export(console: Operator, name: str, what: ExportKind, wanted: Release | None = None) -> dict[str, Any]:
    """Have the report or the release made; a release needs a closed study."""
    if what == "release" and console.study(name).is_open:
        raise HTTPException(409, f"the study {name!r} is open: close it first, then release it")
    console.study(name)
    try:
        console.exports.begin(name, what, tuple(wanted.authors) if wanted else ())
    except ExportRunningError as error:
        raise HTTPException(409, str(error)) from error
    return console.exports.state(name)


@_calls.get("/api/admin/studies/{name}/files/{file}")
async def download(console: Operator, name: str, file: str) -> FileResponse:
    """A file that was made."""
    path = console.exports.file(name, file)
    if path is None:
        raise HTTPException(404, f"no file {file!r} has been made; make the report or the release first")
    return FileResponse(path, filename=file, headers={"Cache-Control": "no-store"})


@_calls.post("/api/admin/check")
async def check(console: Operator) -> dict[str, Any]:
    """Have the database checked now."""
    await asyncio.to_thread(console.health.check)
    return await asyncio.to_thread(console.health.state)


@_calls.websocket("/ws/admin/sessions/{session_id}")
async def watch_board(websocket: WebSocket, session_id: str) -> None:
    """Follow a board; what the operator sends is not listened to."""
    if has_own_origin(websocket) is not True:
        await websocket.close(FOREIGN_ORIGIN, "the Origin of this page is not this server's")
        return
    console = _console(websocket)
    if not console.door.admits(websocket):
        await websocket.close(STRANGER, "log in at /admin first")
        return
    await websocket.accept()
    with contextlib.suppress(WebSocketDisconnect):
        try:
            session = await console.progress.lobby.get(session_id)
        except UnknownSessionError as error:
            await websocket.send_text(encode_error(str(error)))
            await websocket.close(UNKNOWN_SESSION, "unknown session")
            return
        sender = asyncio.create_task(_send(websocket, console, live_boards.board_messages(session)))
        try:
            while (await websocket.receive())["type"] != "websocket.disconnect":
                pass
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sender


async def _send(websocket: WebSocket, console: AdminServices, messages: AsyncGenerator[str, None]) -> None:
    """Send what comes, as long as the door stays open."""
    async with contextlib.aclosing(messages):
        async for message in messages:
            if not console.door.admits(websocket):
                await websocket.close(STRANGER, "logged out")
                return
            await websocket.send_text(message)
