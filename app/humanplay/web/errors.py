"""Errors as answers: one sentence under `detail`, with the status that fits.

A browser that asked for a page gets one.
"""

from __future__ import annotations

import asyncio
import logging
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, Response
from starlette.exceptions import HTTPException

from humanplay.board.lobby import UnknownSessionError
from humanplay.board.messages import NO_BODY, describe_errors
from humanplay.board.spectators import UnwatchableError
from humanplay.db.store import StoreError
from humanplay.jobs import REMEMBERED_S, RETRY_S, JobError, JobsFullError
from humanplay.task import NotReadyError, TaskFullError
from humanplay.web.protection.headers import headers_of
from humanplay.web.replays.episodes import UnknownReplayError
from humanplay.web.replays.files import VideoMissingError
from humanplay.web.templates import addresses, environment, path_of

STATUSES: dict[type[Exception], int] = {
    UnknownSessionError: 404, UnwatchableError: 404, UnknownReplayError: 404, VideoMissingError: 404,
    RequestValidationError: 422, StoreError: 503, JobError: 503, JobsFullError: 503, TaskFullError: 503,
    NotReadyError: 503, sqlite3.DatabaseError: 503,
}  # fmt: skip
"""Errors that may leave a handler as they are. A study's are none of them: their text may name
files of the server."""

PAUSE_S = 1.0
"""Seconds before such an answer: whoever asks again at once does so as often as they have
connections, and no faster."""

TITLES = {
    400: "This server does not go by that name",
    403: "This is not yours to open",
    404: "There is nothing here",
    405: "This address is not used that way",
    500: "Something went wrong here",
    503: "The server cannot do this now",
}
"""Headings of the pages of errors by status."""

FAILED = "The fault is the server's, and it has noted it. Try again in a moment."
UNREADABLE = (
    "the server's database cannot be read here: whoever runs the server finds the reason in its log, and `humanplay verify` "
    "says what is damaged"
)
_log = logging.getLogger(__name__)
_PAGE = environment.get_template("error_page.html")


def add_error_handlers(app: FastAPI) -> None:
    """Answer the errors of handlers and of the router in this server's own words."""
    for kind in STATUSES:
        app.add_exception_handler(kind, _answer_error)
    app.add_exception_handler(HTTPException, _answer_http_error)
    app.add_exception_handler(JobsFullError, _answer_undone)
    app.add_exception_handler(JobError, _answer_undone)
    app.add_exception_handler(sqlite3.DatabaseError, _answer_database_error)
    app.add_exception_handler(RequestValidationError, _answer_bad_input)
    app.add_exception_handler(Exception, _answer_failure)


def status_of(error: Exception) -> int:
    """The status with which an error is answered; 500 for one that nobody foresaw."""
    if isinstance(error, HTTPException):
        return error.status_code
    return next((STATUSES[kind] for kind in type(error).__mro__ if kind in STATUSES), 500)


@contextmanager
def bad_input() -> Iterator[None]:
    """Answer ValueError with 422.

    It is an unknown policy, say, or a level without a solvable terrain.
    """
    try:
        yield
    except ValueError as error:
        raise HTTPException(422, str(error)) from error


def wants_page(request: Request) -> bool:
    """Whether a browser asks for a page to show.

    It names HTML then, as it does not for `fetch`. The API has no pages.
    """
    is_call = path_of(request).startswith("/api/")
    return "text/html" in request.headers.get("accept", "") and not is_call


def answer(
    request: Request, status: int, detail: object, headers: Mapping[str, str] | None = None
) -> Response:
    """The answer for a status: a page for a browser, else {"detail": ...}."""
    if not wants_page(request):
        return JSONResponse({"detail": detail}, status, headers)
    title, text = TITLES.get(status, "That did not work"), str(detail)
    sentence = text[:1].upper() + text[1:] + ("" if text.endswith((".", "?", "!")) else ".")
    shown = _PAGE.render(**addresses(request), status=status, title=title, detail=sentence)
    return HTMLResponse(shown, status, headers)


async def _answer_error(request: Request, error: Exception) -> Response:
    return answer(request, status_of(error), str(error))


async def _answer_undone(request: Request, error: Exception) -> Response:
    """Answer that something takes too long, or waits behind the asker's other things.

    See PAUSE_S.
    """
    await asyncio.sleep(PAUSE_S)
    wait_s = RETRY_S if isinstance(error, JobsFullError) else REMEMBERED_S
    return answer(request, 503, str(error), {"Retry-After": f"{wait_s:.0f}"})


async def _answer_bad_input(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    return answer(request, 422, describe_errors(error.errors()))


async def _answer_database_error(request: Request, error: Exception) -> Response:
    """Answer a query that SQLite could not make.

    It was of a damaged page, say, or of a disk that cannot be read.
    """
    _log.error("the database cannot be read: %s", error)
    return answer(request, 503, UNREADABLE)


async def _answer_failure(request: Request, _: Exception) -> Response:
    """Answer what nobody foresaw.

    It stands outside the middleware, so it sets the headers itself.
    """
    headers = {**headers_of(request), "X-Request-ID": request.scope.get("request_id", "")}
    return answer(request, 500, FAILED, headers)


async def _answer_http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    if error.status_code == 400:  # what FastAPI raises for a body that is not even text
        return answer(request, 422, f"{NO_BODY}, in UTF-8")
    detail = error.detail
    if detail in ("Not Found", "Method Not Allowed"):  # the router's own words
        detail = f"nothing answers {request.method} {request.url.path}; /docs lists every call"
        if wants_page(request) and error.status_code == 404:
            detail = f"No page has the address {request.url.path}. It may have been mistyped, or what it showed is gone."
    return answer(request, error.status_code, detail, error.headers)
