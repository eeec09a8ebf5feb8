"""The wiring: settings in, an app out; and `run`, which serves it on a socket of its own.

Nothing here is global: `create_app(settings)` makes an app with its own store, lobby and viewer, alive for its lifespan.
"""

from __future__ import annotations

import asyncio
import errno
import gc
import socket
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI, Request, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, HTMLResponse, JSONResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException

from app.play.lobby import Lobby, UnknownSessionError
from app.play.policy_catalogue import PolicyCatalogue
from app.play.sources import Sources
from app.play.validation import NO_BODY, describe_errors
from app.settings import ROOT, Settings
from app.storage.store import Store, StoreError
from app.study.debrief import Debriefs
from app.study.folder import Folder
from app.study.participant_board import Participations
from app.study.progress import ParticipantProgress
from app.study.records import Records
from app.viewer3d.viewer import Viewer
from app.web import api, api_docs, sockets
from app.web.access import enter
from app.web.admin import AdminServices
from app.web.admin import router as admin_routes
from app.web.admin_login import AdminLogin
from app.web.cookies import PlayerCookies, has_own_origin
from app.web.leaderboard import Leaderboard
from app.web.leaderboard import router as leaderboard_routes
from app.web.middleware import SecurityHeaders
from app.web.study import router as study_routes
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import describe

STATIC = next(path for path in (Path(__file__).parent / "static", ROOT / "static") if path.is_dir())
"""The page: beside this module in a wheel, at the root in a checkout."""

DESCRIPTION = """Drive the MarsExplorer rover, watch policies do it, and read what was played. `POST /api/sessions` begins a
board; its `frame` holds what the rover has discovered; `POST .../act` answers a frame with a move and brings the next.
Errors are `{"detail": "..."}` with what was expected and what came: 404 unknown, 409 not the current frame, 422 bad input."""


class ServerError(RuntimeError):
    """The server cannot start; its text says why and what to do."""


def create_app(settings: Settings, sources: Sources | None = None, policies: PolicyCatalogue | None = None) -> FastAPI:
    """Return the app: page, API, sockets and 3-D viewer on one database. `sources` and `policies` are for tests and `run`."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        on_offer = policies if policies is not None else await asyncio.to_thread(PolicyCatalogue, settings.policies)
        await asyncio.to_thread(warm_up)
        store = Store(settings.database, settings.durable)
        records, folder, origin = Records(store), Folder(settings.studies), sources or Sources()
        lobby = Lobby(store, on_offer, origin, settings.idle_s, Participations(folder, records, origin).of_session)
        viewer = Viewer()
        app.state.store, app.state.lobby, app.state.viewer = store, lobby, viewer
        app.state.players = PlayerCookies(store.secret())
        app.state.progress, app.state.debriefs = ParticipantProgress(lobby, folder, records), Debriefs(store)
        app.state.leaderboard = Leaderboard(store.path, on_offer.offers())
        if app.state.door:
            app.state.console = AdminServices(app.state.door, app.state.progress, settings.studies)
        sweeper = asyncio.create_task(lobby.sweep(), name="sweep")
        gc.collect()
        gc.freeze()  # what is loaded stays: collections that walk it would hold a move up for tens of milliseconds
        try:
            yield
        finally:
            sweeper.cancel()
            await app.state.leaderboard.close()
            if app.state.door:
                await app.state.console.exports.close()
            lobby.close()
            viewer.close()
            store.close()

    app = FastAPI(
        title="MarsExplorer Playground", version=CORE_VERSION, description=DESCRIPTION,
        lifespan=lifespan, docs_url=None, redoc_url=None,
    )  # fmt: skip
    app.state.door = AdminLogin.of(settings)
    app.state.is_admin = app.state.door.admits if app.state.door else lambda connection: False
    app.add_middleware(SecurityHeaders)
    _add_errors(app)
    app.include_router(api.router)
    app.include_router(study_routes)
    app.include_router(sockets.router)
    app.include_router(leaderboard_routes(STATIC / "leaderboard" / "index.html"))
    if app.state.door:
        app.include_router(admin_routes(STATIC / "admin" / "index.html"))
    _add_viewer(app)
    _add_page(app)
    return app


def warm_up() -> None:
    """Return with the rules compiled: the first start takes some seconds, later ones read numba's cache."""
    episode = Episode.begin(EnvConfig.of("random", 5), seed=0)
    episode.step(1)


def _add_errors(app: FastAPI) -> None:
    def answer(status: int) -> Callable[[Request, Exception], Response]:
        return lambda _, error: JSONResponse({"detail": str(error)}, status)

    def bad_input(_: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        return JSONResponse({"detail": describe_errors(error.errors())}, 422)

    def http_error(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        if error.status_code == 400:  # FastAPI's word for a body that is not even text
            return JSONResponse({"detail": f"{NO_BODY}, in UTF-8"}, 422)
        detail = error.detail
        if detail in ("Not Found", "Method Not Allowed"):  # the router's own words
            detail = f"nothing answers {request.method} {request.url.path}; /docs lists every call"
        return JSONResponse({"detail": detail}, error.status_code, error.headers)

    app.add_exception_handler(HTTPException, http_error)
    app.add_exception_handler(UnknownSessionError, answer(404))
    app.add_exception_handler(StoreError, answer(503))
    app.add_exception_handler(RequestValidationError, bad_input)


def _add_viewer(app: FastAPI) -> None:
    @app.get("/viewer/{session_id}/", include_in_schema=False)
    async def viewer_page(request: Request, session_id: str) -> Response:
        await enter(request, session_id)
        viewer: Viewer = app.state.viewer
        return viewer.html(request)

    @app.websocket("/viewer/{session_id}")
    async def viewer_socket(websocket: WebSocket, session_id: str) -> None:
        if has_own_origin(websocket) is False:
            await websocket.close(sockets.FOREIGN_ORIGIN)
            return
        try:
            session = await enter(websocket, session_id)
        except UnknownSessionError:
            await websocket.accept()
            await websocket.close(sockets.UNKNOWN_SESSION, "unknown session")
            return
        await app.state.viewer.serve(websocket, session)


def _add_page(app: FastAPI) -> None:
    @app.get("/", include_in_schema=False)
    async def index() -> Response:
        return FileResponse(STATIC / "play" / "index.html")

    @app.get("/study/{name}", include_in_schema=False)
    async def study(name: str) -> Response:
        return FileResponse(STATIC / "study" / "index.html")  # which says so when there is no such study

    @app.get("/docs", include_in_schema=False)
    async def docs() -> Response:
        return HTMLResponse(api_docs.render(app.openapi()))

    app.mount("/static", StaticFiles(directory=STATIC), name="static")


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket; ServerError when the port is taken or the host is none of this machine's."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # named TCP, so that asyncio sets TCP_NODELAY: else every kept-alive answer waits 40 ms for an acknowledgement
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((host, port))
        sock.listen(2048)
    except OSError as error:
        sock.close()
        reason = (error.strerror or str(error)).lower()
        way_out = "--port" if error.errno in (errno.EADDRINUSE, errno.EACCES) else "--host"
        raise ServerError(f"cannot listen on {host} port {port}: {reason}; choose another with {way_out}") from error
    sock.set_inheritable(True)
    return sock


class _Announcing(uvicorn.Server):
    """Says where the page is once it can be opened."""

    address = ""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            print(f"MarsExplorer Playground is open at {self.address} (Ctrl-C closes it)", flush=True)


def uvicorn_config(app: FastAPI, **rest: Any) -> uvicorn.Config:
    """Return how the app is served, here and in the tests."""
    plain: dict[str, Any] = {
        "ws": "websockets-sansio", "ws_per_message_deflate": False, "ws_max_size": 2**20, "lifespan": "on",
        "access_log": False, "log_level": "warning", "timeout_graceful_shutdown": 3, "server_header": False,
    }  # fmt: skip
    return uvicorn.Config(app, **{**plain, **rest})


@contextmanager
def _policy_errors() -> Iterator[None]:
    """Raise what is wrong with a policy's file as a ServerError."""
    try:
        yield
    except (LookupError, ValueError, OSError) as error:
        raise ServerError(str(error)) from error


def run(settings: Settings) -> None:
    """Serve until Ctrl-C; ServerError or StoreError before anything starts when it cannot."""
    try:
        AdminLogin.of(settings)
    except ValueError as error:
        raise ServerError(f"{error}; set another MARS_ADMIN_PASSWORD") from error
    with listen(settings.host, settings.port) as sock:
        with _policy_errors():
            for path in settings.policies:
                describe(str(path))
        print("compiling the rules and loading the policies (some seconds on the first start)", flush=True)
        with _policy_errors():
            policies = PolicyCatalogue(settings.policies)
        Store(settings.database, settings.durable).close()  # last: a start that fails leaves no new file behind
        sys.setswitchinterval(0.001)  # a policy thinking in a thread lets a move through within a millisecond
        app = create_app(settings, policies=policies)
        if app.state.door and app.state.door.drawn:
            print(f"the operator's page is /admin, its password until the server stops: {app.state.door.drawn}", flush=True)
        server = _Announcing(uvicorn_config(app))
        host, port = sock.getsockname()[:2]
        server.address = f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
        try:
            server.run(sockets=[sock])
        except KeyboardInterrupt:
            return
