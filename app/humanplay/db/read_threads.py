"""Threads that read a database, each over a connection of its own.

So a read waits neither for writes nor for their lock.
"""

from __future__ import annotations

import asyncio
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, Protocol, TypeVar

from humanplay.db.file import StoreError


class Closable(Protocol):
    """A connection, as far as these threads know one."""

    def close(self) -> None:
        """Close it."""


T = TypeVar("T")
C = TypeVar("C", bound=Closable)

THREADS = 4
MAX_WAITING = 1_000
"""Reads that wait or are made at a time; further ones are refused at once."""
FULL = "more people ask for something than the server's disk can read: try again in a moment"


class ReadThreads(Generic[C]):
    """A few threads for short reads, each with a connection.

    Another thread that reads gets a connection of its own as well.
    well.

    The threads and their connections are there from the start, so that a server does not come to
    hold more of them later.

    Args:
        connect: Opens a connection that only reads; its errors are passed on.
    """

    def __init__(self, connect: Callable[[], C]) -> None:
        self._connect = connect
        self._own = threading.local()
        self._connections: list[C] = []
        self._opening = threading.Lock()
        self._pool = ThreadPoolExecutor(THREADS, "reads", self._keep_connection)
        self._waiting = 0
        try:
            for _ in range(THREADS):
                self._connections.append(connect())
        except BaseException:
            self.close()
            raise
        self._unused = self._connections.copy()
        have_started = threading.Barrier(THREADS + 1)
        for _ in range(THREADS):  # while the others wait, each of these needs a thread of its own
            self._pool.submit(have_started.wait)
        have_started.wait()

    def __len__(self) -> int:
        """How many connections are open."""
        return len(self._connections)

    async def run(self, work: Callable[[], T]) -> T:
        """Call `work()` on one of the threads.

        Raises:
            StoreError: At once, while MAX_WAITING reads wait.
        """
        if self._waiting >= MAX_WAITING:
            raise StoreError(FULL)
        self._waiting += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._pool, work)
        finally:
            self._waiting -= 1

    def connection(self) -> C:
        """This thread's connection.

        On an event loop it gives a RuntimeWarning: a loop must not wait for a disk.
        """
        if (connection := getattr(self._own, "connection", None)) is not None:
            return connection  # type: ignore[no-any-return]
        if _runs_a_loop():
            warning = "a database is read on the event loop: await Store.read or Store.write"
            warnings.warn(warning, RuntimeWarning, stacklevel=4)
        self._own.connection = connection = self._connect()
        with self._opening:
            self._connections.append(connection)
        return connection

    def close(self) -> None:
        """End the threads and close every connection."""
        self._pool.shutdown()
        for connection in self._connections:
            connection.close()
        self._connections.clear()

    def _keep_connection(self) -> None:
        """Keep one of the connections that were opened at the start for this thread."""
        self._own.connection = self._unused.pop()


def _runs_a_loop() -> bool:
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True
