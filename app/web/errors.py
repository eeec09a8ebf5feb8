"""Errors as answers: one sentence under `detail`, with the status that fits."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException

from app.play.lobby import UnknownSessionError
from app.play.validation import NO_BODY, describe_errors
from app.storage.store import StoreError


def add_error_handlers(app: FastAPI) -> None:
    """Answer the errors of handlers and of the router in this server's own words."""
    app.add_exception_handler(HTTPException, _answer_http_error)
    app.add_exception_handler(UnknownSessionError, _answer_with(404))
    app.add_exception_handler(StoreError, _answer_with(503))
    app.add_exception_handler(RequestValidationError, _answer_bad_input)


def _answer_with(status: int) -> Callable[[Request, Exception], Response]:
    """Return a handler that answers the error's text with a status."""

    def answer(_: Request, error: Exception) -> Response:
        return JSONResponse({"detail": str(error)}, status)

    return answer


def _answer_bad_input(_: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    return JSONResponse({"detail": describe_errors(error.errors())}, 422)


def _answer_http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    if error.status_code == 400:  # what FastAPI raises for a body that is not even text
        return JSONResponse({"detail": f"{NO_BODY}, in UTF-8"}, 422)
    detail = error.detail
    if detail in ("Not Found", "Method Not Allowed"):  # the router's own words
        detail = f"nothing answers {request.method} {request.url.path}; /docs lists every call"
    return JSONResponse({"detail": detail}, error.status_code, error.headers)
