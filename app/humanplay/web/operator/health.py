"""The state of disk and database: writes, free space, sizes, SQLite's check."""

from __future__ import annotations

import asyncio
import logging
import shutil
import sqlite3
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from humanplay.db.checks import chain_head, quick_check, try_write
from humanplay.db.database import StoreError, damaged
from humanplay.db.file import log_path
from humanplay.web.answers.operator import ChainHead, Check, DatabaseFile, DatabaseHealth, Disk

_log = logging.getLogger(__name__)

LOW_BYTES = 1_000_000_000
"""Less free space on the disk than this is called low."""


class Health:
    """The health of a database.

    The check reads all of it, so it is made once, and again on request.
    """

    def __init__(self, database: Path) -> None:
        self._database, self._log = database, log_path(database)
        self._check: Check | None = None
        self._checking, self._is_ending = threading.Lock(), False
        self._conn: sqlite3.Connection | None = None
        self._trying = ThreadPoolExecutor(1, "readyz")  # others' work keeps no probe waiting

    def check(self) -> None:
        """Check the database and log damage; up to minutes, so call it in a thread."""
        with self._checking:
            self._check_now()

    def _check_now(self) -> None:
        if self._is_ending:
            return
        result, now_ms = quick_check(self._database, self._begin), time.time_ns() // 1_000_000
        if self._is_ending:
            return
        self._check = Check(result=result, is_whole=result == "ok", at_ms=now_ms)
        if result != "ok":
            _log.error("%s", damaged(self._database, result))

    def _begin(self, conn: sqlite3.Connection) -> None:
        self._conn = conn

    def stop(self) -> None:
        """Give up a check under way, and make no further one."""
        self._is_ending = True
        while not self._checking.acquire(timeout=0.01):
            with suppress(sqlite3.ProgrammingError):  # it is closed already
                if self._conn is not None:
                    self._conn.interrupt()
        self._checking.release()

    def check_whole(self) -> None:
        """Raise StoreError if the last check has found damage."""
        if self._check is not None and not self._check.is_whole:
            raise StoreError(
                f"the database {self._database.name} is damaged: the server's log says what to do"
            )

    async def try_write(self) -> None:
        """Write a row and commit it; StoreError with the reason when that fails."""
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(self._trying, try_write, self._database)

    def free_bytes(self) -> int:
        """Return the free space of the disk that the database is on."""
        return shutil.disk_usage(self._database.parent).free

    def log_bytes(self) -> int:
        """Size of the write-ahead log, which is moved into the database now and then."""
        return _size(self._log)

    def database_bytes(self) -> int:
        """Return the size of the database's file, without its log."""
        return _size(self._database)

    def state(self) -> DatabaseHealth:
        """Everything that is shown; the first time the database is checked as well."""
        if self._check is None and self._checking.acquire(blocking=False):
            try:
                self._check_now()
            finally:
                self._checking.release()
        space, chain = shutil.disk_usage(self._database.parent), chain_head(self._database)
        files = [path for path in (self._database, self._log) if path.exists()]
        written = max((path.stat().st_mtime for path in files), default=0.0)
        return DatabaseHealth(
            disk=Disk(free=space.free, total=space.total, is_low=space.free < LOW_BYTES),
            database=DatabaseFile(
                name=self._database.name, size=self.database_bytes(), wal_size=self.log_bytes()
            ),
            last_write_ms=round(written * 1000),
            check=self._check,
            chain=chain and ChainHead(entries=chain.entries, head=chain.head),
        )


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
