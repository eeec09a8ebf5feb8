"""Turns for agents: one at a time, so that people's moves do not wait for them."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import TypeVar

T = TypeVar("T")

TURN_S, REST = 1.0, 3.0
"""Most seconds of a turn, and the pause after it as a multiple of the time that it took."""


class Turns:
    """Does what agents ask for one at a time.

    After each turn everybody else has REST times as long.
    """

    def __init__(self) -> None:
        self._turn = asyncio.Lock()

    async def take(self, doing: Coroutine[object, object, T]) -> T:
        """Run something in a turn of its own.

        The turn ends after TURN_S even if it is not done; its result is returned when it is.
        """
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
