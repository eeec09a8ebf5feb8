"""The log on stderr, as text or as JSON.

What strangers cause in it is cut and rated, and JSON names nobody.
"""

from __future__ import annotations

import logging
import re
import traceback
from collections import Counter
from types import TracebackType

from pythonjsonlogger.json import JsonFormatter

from humanplay.web.protection.limits import TokenBucket
from humanplay.web.requests import request_id

MOST_CHARACTERS = 2_000
"""Characters of a message, and of the places that a failure passed, at most."""
LINES, REQUESTS = (20, 0.2), (2_000, 100.0)
"""Lines that one place in the code may write at once, and a second after that: warnings and errors,
and requests (INFO)."""

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")
_LONG = re.compile(r"[A-Za-z0-9_-]{16,}")
_WORDS = re.compile(r"[a-z]+(?:[_-][a-z]+)*|[A-Z][a-z]+(?:[A-Z][a-z]+)*")
"""Long words of prose, of options and of classes, which stay."""


_SECRET_ADDRESS = re.compile(r"(/agents/)[^/\s\"'?]+")
"""An address that is a password: whoever has it acts by it."""


def mask(text: str) -> str:
    """A text with `***` for everything that could be a cookie, a token or an id.

    Those have 16 characters or more.
    """
    return _LONG.sub(lambda match: match[0] if _WORDS.fullmatch(match[0]) else "***", text)


_Raised = tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]
"""What `sys.exc_info` returns."""


class _TextFormatter(logging.Formatter):
    def formatException(self, ei: _Raised) -> str:  # noqa: N802 - the name of the standard library
        """The end of the traceback, cut: what was raised, and the innermost places."""
        lines = [_on_one_line(line[:200]) for line in super().formatException(ei).split("\n")]
        return _SECRET_ADDRESS.sub(r"\1***", "\n".join(lines)[-MOST_CHARACTERS:])


class _SafeFormatter(JsonFormatter):
    """Writes a failure as its class and the places it passed.

    Its text may hold what somebody sent, so it is left out.
    """

    def process_log_record(self, log_data: dict[str, object]) -> dict[str, object]:
        """Mask what a library wrote in words; the other fields are ours."""
        for name in log_data.keys() & {"message", "error"}:
            log_data[name] = mask(str(log_data[name]))
        return log_data

    def formatException(self, ei: _Raised) -> str:  # noqa: N802 - the name of the standard library
        """The class of an exception and the places that it passed, innermost last."""
        places = [f"{place.name}:{place.lineno}" for place in traceback.extract_tb(ei[2])]
        name = "nothing" if ei[0] is None else ei[0].__name__
        return f"{name} in {' > '.join(places)[-MOST_CHARACTERS:]}"


class _CutAndRated(logging.Filter):
    """Cuts messages to one line each, and leaves out what comes too often.

    It counts by the place in the code that writes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._buckets = dict[tuple[str, int], TokenBucket]()
        self._left_out = Counter[tuple[str, int]]()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is written.

        Of those that are left out the next one says how many they were.
        """
        place = record.pathname, record.lineno
        if (bucket := self._buckets.get(place)) is None:
            size = LINES if record.levelno > logging.INFO else REQUESTS
            bucket = self._buckets[place] = TokenBucket(*size)
        if bucket.take():
            self._left_out[place] += 1
            return False
        text = _on_one_line(record.getMessage().strip()[:MOST_CHARACTERS])[:MOST_CHARACTERS]
        text = _SECRET_ADDRESS.sub(r"\1***", text)
        if count := self._left_out.pop(place, 0):
            text += f" (after {count} more from here, which are left out)"
        record.msg, record.args, record.request_id = text, (), request_id.get()
        return True


def _on_one_line(text: str) -> str:
    return _CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def log_config(log_format: str) -> dict[str, object]:
    """The configuration of a log on stderr (`logging.config.dictConfig`).

    It has the warnings and errors of everything. JSON has a line for each request too. An object
    has `time` (UTC), `level`, `logger`, `message`, `request_id` and, of a request, `method`,
    `route` (the pattern, not the address), `status` (HTTP status, or close code of a socket) and
    `ms`.

    Args:
        log_format: "text" or "json".
    """
    text = {"()": _TextFormatter, "fmt": "%(levelname)s: %(message)s"}
    names = {"levelname": "level", "name": "logger", "exc_info": "error"}
    fields = ["levelname", "name", "message", "request_id"]
    json = {"()": _SafeFormatter, "fmt": fields, "rename_fields": names, "timestamp": "time"}
    handler = {"class": "logging.StreamHandler", "formatter": "line", "filters": ["cut"]}
    level = "INFO" if log_format == "json" else "WARNING"
    return {
        "version": 1, "disable_existing_loggers": False,
        "filters": {"cut": {"()": _CutAndRated}},
        "formatters": {"line": json if log_format == "json" else text},
        "handlers": {"stderr": handler},
        "root": {"handlers": ["stderr"], "level": "WARNING"},
        "loggers": {"humanplay.web.requests": {"level": level}},
    }  # fmt: skip
