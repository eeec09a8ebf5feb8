"""Turns of the event loop: of what one address asks for, one thing begins in each, so that others are served between."""

from __future__ import annotations

import asyncio
from collections import deque


class Turns:
    """Lets one thing of each address begin in a turn of the event loop; the others of that address wait, first come first."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[asyncio.Future[None]]] = {}

    async def begin(self, address: str) -> None:
        """Return at once where nothing else of this address has begun in this turn, else when it is next."""
        waiting = self._waiting.get(address)
        loop = asyncio.get_running_loop()
        if waiting is None:
            self._waiting[address] = deque()
            loop.call_soon(self._let_next_begin, address)
            return
        mine = loop.create_future()
        waiting.append(mine)
        await mine

    def _let_next_begin(self, address: str) -> None:
        waiting = self._waiting[address]
        while waiting:
            if not (first := waiting.popleft()).done():  # whoever was cancelled begins nothing
                first.set_result(None)
                asyncio.get_running_loop().call_soon(self._let_next_begin, address)
                return
        del self._waiting[address]
