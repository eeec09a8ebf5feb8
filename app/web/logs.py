"""Logs as JSON: one object a line on stderr, with the request's id and without anything by which a person is known."""

from __future__ import annotations

import logging
import re
import sys
import traceback

from pythonjsonlogger.json import JsonFormatter

from app.web.requests import request_id

_LONG = re.compile(r"[A-Za-z0-9_-]{16,}")
_WORDS = re.compile(r"[a-z]+(?:[_-][a-z]+)*|[A-Z][a-z]+(?:[A-Z][a-z]+)*")
"""Long words of prose, of options and of classes, which stay."""


def mask(text: str) -> str:
    """Return the text with everything that could be a cookie, a token or an id (16 characters or more) as `***`."""
    return _LONG.sub(lambda found: found[0] if _WORDS.fullmatch(found[0]) else "***", text)


class _SafeFormatter(JsonFormatter):
    """Writes a failure as its class and the places it passed; its text may hold what somebody sent, so it is left out."""

    def process_log_record(self, log_data: dict[str, object]) -> dict[str, object]:
        """Mask what a library wrote in words; the other fields are ours."""
        for name in log_data.keys() & {"message", "error"}:
            log_data[name] = mask(str(log_data[name]))
        return log_data

    def formatException(self, ei: object) -> str:  # noqa: N802 - the name of the standard library
        """Return the class of an exception and the places that it passed, innermost last."""
        assert isinstance(ei, tuple)
        places = [f"{place.name}:{place.lineno}" for place in traceback.extract_tb(ei[2])]
        return f"{ei[0].__name__} in {' > '.join(places)}"


class _RequestId(logging.Filter):
    """Adds the id of the request under way."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Add `request_id`; nothing is left out."""
        record.request_id = request_id.get()
        return True


def log_as_json() -> None:
    """Let this process write its log as JSON on stderr: each request, and warnings and errors of all libraries.

    An object has `time` (UTC), `level`, `logger`, `message`, `request_id` and, of a request, `method`, `route` (the pattern,
    not the address), `status` (HTTP status, or close code of a socket) and `ms`.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(_RequestId())
    fields = ["levelname", "name", "message", "request_id"]
    names = {"levelname": "level", "name": "logger", "exc_info": "error"}
    handler.setFormatter(_SafeFormatter(fields, rename_fields=names, timestamp="time"))
    logging.root.handlers = [handler]
    logging.root.setLevel(logging.WARNING)
    logging.getLogger("app.web.requests").setLevel(logging.INFO)
    logging.captureWarnings(True)
