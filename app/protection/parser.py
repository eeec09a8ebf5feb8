"""Reading of requests: what would take long to read is refused before it is read."""

from __future__ import annotations

import re

import h11

HEAD_BYTES = 2**14
"""Bytes of the headers of a request, at most."""

MOST_LINES = 100
"""Lines of the headers of a request, at most: each takes some microseconds, and 64 KB of the shortest would take 37 ms."""

MOST_PIECES = 300
"""Pieces that a body may come in, and lines of it that wait where each piece is sent with its length: 64 KB of the shortest
pieces would take 100 ms. Those of the longest body fill some fifty packets of a network."""

_BLANK_LINE = re.compile(rb"\n\r?\n")


class LimitedParser(h11.Connection):
    """The server's side of a connection of HTTP/1.1.

    refusal   why a request was not read: one sentence; None where all were
    """

    def __init__(self) -> None:
        super().__init__(h11.SERVER, HEAD_BYTES)
        self.refusal: str | None = None
        self._pieces, self._is_chunked = 0, False

    def next_event(self) -> h11.Event | type[h11.NEED_DATA] | type[h11.PAUSED]:
        """Return what comes next; RemoteProtocolError where the other side breaks the protocol or a limit."""
        if self.their_state is h11.IDLE:
            if _lines(self.trailing_data[0]) > MOST_LINES:
                self._refuse(f"the headers of a request must be {MOST_LINES} lines at most")
        elif (
            self._is_chunked
            and self.their_state is h11.SEND_BODY
            and self.trailing_data[0].count(b"\n") > MOST_PIECES
        ):
            self._refuse(f"a body must come in {MOST_PIECES} pieces at most")
        try:
            event = super().next_event()
        except h11.RemoteProtocolError as error:
            if error.error_status_hint == 431:
                self.refusal = f"the headers of a request must be {HEAD_BYTES} bytes at most"
            raise
        if isinstance(event, h11.Request):
            self._pieces, self._is_chunked = (
                0,
                any(name == b"transfer-encoding" for name, _ in event.headers),
            )
        elif isinstance(event, h11.Data):
            self._pieces += 1
            if self._pieces > MOST_PIECES:
                self._refuse(f"a body must come in {MOST_PIECES} pieces at most")
        return event

    def _refuse(self, detail: str) -> None:
        self.refusal = detail
        raise h11.RemoteProtocolError(detail)


def _lines(waiting: bytes) -> int:
    """Return how many lines the headers have that wait, as far as they have come."""
    if waiting.count(b"\n") <= MOST_LINES:
        return 0
    return _BLANK_LINE.split(waiting, maxsplit=1)[0].count(b"\n")
