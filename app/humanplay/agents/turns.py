"""What agents ask for is done one at a time, so that people's moves do not wait for it."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import TypeVar

T = TypeVar("T")

TURN_S, REST = 1.0, 3.0
"""Seconds that a turn takes at most, and the rest after it as a multiple of the time that it took."""


class Turns:
    """Lets what agents ask for be done one at a time, and leaves everybody else REST times as long
    after each turn."""

    def __init__(self) -> None:
        self._turn = asyncio.Lock()

    async def take(self, doing: Coroutine[object, object, T]) -> T:
        """Return what comes of something once it has had its turn, which ends after TURN_S whether
        or not it is done."""
        try:
            await self._turn.acquire()
        except BaseException:
            doing.close()
            raise
        loop = asyncio.get_running_loop()
        began_s, task = loop.time(), asyncio.ensure_future(doing)
        try:
            await asyncio.wait([task], timeout=TURN_S)
        finally:
            loop.call_later(REST * (loop.time() - began_s), self._turn.release)
        return await task
