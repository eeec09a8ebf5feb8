"""The state of disk and database: whether a write succeeds, free space, sizes, SQLite's own check, the head of the chain."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Any

from app.db.checks import chain_head, quick_check, try_write

LOW_BYTES = 1_000_000_000
"""Less free space on the disk than this is called low."""


class Health:
    """The health of one database; the check reads all of it, so it is made once, and again only on request."""

    def __init__(self, database: Path) -> None:
        self._database, self._log = database, database.with_name(database.name + "-wal")
        self._check: dict[str, Any] | None = None

    def check(self) -> None:
        """Check the database; it takes milliseconds to minutes, so call it in a thread."""
        result, now_ms = quick_check(self._database), time.time_ns() // 1_000_000
        self._check = {"result": result, "is_whole": result == "ok", "at_ms": now_ms}

    def try_write(self) -> None:
        """Write a row and commit it; StoreError with the reason when that fails. Call it in a thread."""
        try_write(self._database)

    def free_bytes(self) -> int:
        """Return the free space of the disk that the database is on."""
        return shutil.disk_usage(self._database.parent).free

    def log_bytes(self) -> int:
        """Return the size of the write-ahead log, which is moved into the database now and then."""
        return _size(self._log)

    def database_bytes(self) -> int:
        """Return the size of the database's file, without its log."""
        return _size(self._database)

    def state(self) -> dict[str, Any]:
        """Return everything that is shown, sizes in bytes; the first time the database is checked as well."""
        if self._check is None:
            self.check()
        space, chain = shutil.disk_usage(self._database.parent), chain_head(self._database)
        files = [path for path in (self._database, self._log) if path.exists()]
        written = max((path.stat().st_mtime for path in files), default=0.0)
        return {
            "disk": {"free": space.free, "total": space.total, "is_low": space.free < LOW_BYTES},
            "database": {
                "name": self._database.name,
                "size": self.database_bytes(),
                "wal_size": self.log_bytes(),
            },
            "last_write_ms": round(written * 1000),
            "check": self._check,
            "chain": chain and {"entries": chain.entries, "head": chain.head},
        }


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
