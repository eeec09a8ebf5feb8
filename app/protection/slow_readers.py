"""Connections whose client does not take what is sent to it: they are closed after a time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

TAKEN_BYTES = 2**16
"""Bytes of what waits for a client that it takes in the time of `answer_s` at least, or all: 3 KB a second by default."""


class SlowReaders:
    """Watches what waits in the server to be taken by its clients.

    A connection is judged while nothing is added to what waits for it: where writing to it is paused since too much waits, or
    where it is closing and the rest is still to be taken. What waits can only become less then.
    """

    def __init__(self, answer_s: float, count_refusal: Callable[[str], None]) -> None:
        self._answer_s, self._count_refusal = answer_s, count_refusal
        self._left: dict[asyncio.Transport, int] = {}
        """What waited for each connection when it was looked at last; 0 where it was not judged."""
        self._paused: set[asyncio.Transport] = set()

    def add(self, transport: asyncio.Transport) -> None:
        """Watch a connection from now on."""
        self._left[transport] = 0

    def remove(self, transport: asyncio.Transport) -> None:
        """Forget a connection that is lost."""
        self._left.pop(transport, None)
        self._paused.discard(transport)

    def pause(self, transport: asyncio.Transport) -> None:
        """Note that writing to a connection is paused."""
        self._paused.add(transport)

    def resume(self, transport: asyncio.Transport) -> None:
        """Note that a client has taken so much that more is written."""
        self._paused.discard(transport)
        if transport in self._left:
            self._left[transport] = 0

    async def sweep(self) -> None:
        """Look at all connections every `answer_s` until cancelled."""
        while True:
            await asyncio.sleep(self._answer_s)
            self.close_slow()

    def close_slow(self) -> None:
        """Close the connections whose client has taken too little since the last look."""
        for transport, before in list(self._left.items()):
            is_judged = transport in self._paused or transport.is_closing()
            left = transport.get_write_buffer_size() if is_judged else 0
            if left and before and left > before - TAKEN_BYTES:
                self._count_refusal("slow_reader")
                transport.abort()
            self._left[transport] = left
