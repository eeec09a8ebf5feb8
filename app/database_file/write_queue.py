"""Writes that wait while another program has locked the database, without the event loop waiting with them.

SQLite lets one connection write at a time. A write that finds the database locked fails at once and changes nothing; here it
waits in a task of its own, and is tried again when the lock is gone. Whatever only reads goes on meanwhile.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TypeVar

from app.database_file.errors import StoreError

T = TypeVar("T")

PATIENCE_S = 30.0
"""Seconds that a write waits before it is refused."""
NOTICE_S = 1.0
"""Seconds after which whoever waits is told why."""
MAX_WAITING = 1_000
"""Writes that wait at a time; further ones are refused at once."""
SHORTEST_PAUSE_S, LONGEST_PAUSE_S = 0.002, 0.05

WAITS = "another program is writing the server's database: your move waits, and is made as soon as that program is done"
REFUSED = "another program is writing the server's database and has not finished: nothing has changed; try again in a moment"


class DatabaseLockedError(StoreError):
    """Another program holds the lock for writing; nothing has changed, and the same write may succeed later."""

    def __init__(self) -> None:
        super().__init__(REFUSED)


class WriteQueue:
    """The writes of one event loop that wait for a database which another program has locked.

    is_locked  says whether another program holds the lock now, without waiting
    """

    def __init__(self, is_locked: Callable[[], bool]) -> None:
        self._is_locked = is_locked
        self._waiting = 0
        self._looking: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        """Return how many writes wait."""
        return self._waiting

    async def run(self, write: Callable[[], T], notice: Callable[[str], Awaitable[None]] | None = None) -> T:
        """Return the result of `write()`, called again after each wait while it raises DatabaseLockedError.

        notice  told one sentence when the wait has lasted NOTICE_S; an error of it is the caller's

        DatabaseLockedError after PATIENCE_S, or at once while MAX_WAITING writes wait.
        """
        try:
            return write()
        except DatabaseLockedError:
            pass
        deadline = asyncio.get_running_loop().time() + PATIENCE_S
        while True:
            notice = await self._wait(deadline, notice)
            try:
                return write()
            except DatabaseLockedError:
                continue

    async def run_async(self, write: Callable[[], Awaitable[T]]) -> T:
        """Return the result of `await write()`, as `run` does for a write that is no coroutine."""
        deadline = asyncio.get_running_loop().time() + PATIENCE_S
        while True:
            try:
                return await write()
            except DatabaseLockedError:
                await self._wait(deadline, None)

    async def _wait(
        self, deadline: float, notice: Callable[[str], Awaitable[None]] | None
    ) -> Callable[[str], Awaitable[None]] | None:
        """Wait until the lock is free and return `notice` if it was not called; DatabaseLockedError at the deadline."""
        loop = asyncio.get_running_loop()
        if self._waiting >= MAX_WAITING or loop.time() >= deadline:
            raise DatabaseLockedError
        self._waiting += 1
        try:
            if self._looking is None or self._looking.done():
                self._looking = asyncio.create_task(self._look(), name="wait for the database")
            looking = self._looking
            if notice is not None:
                done, _ = await asyncio.wait([looking], timeout=NOTICE_S)
                if done:
                    return notice
                await notice(WAITS)
            done, _ = await asyncio.wait([looking], timeout=max(0.0, deadline - loop.time()))
            if not done:
                raise DatabaseLockedError
            return None
        finally:
            self._waiting -= 1

    async def _look(self) -> None:
        """Look again and again until the lock is free, or nobody waits any more."""
        pause = SHORTEST_PAUSE_S
        while self._waiting and self._is_locked():
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE_S)
