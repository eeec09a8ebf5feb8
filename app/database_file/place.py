"""Whether an open database and its log still stand under the names they were opened by.

A file that is deleted, moved or replaced while SQLite has it open still takes every write: into nothing that anybody will read
again. SQLite does not notice; a look at device and inode does, without opening anything.
"""

from __future__ import annotations

import os
from pathlib import Path

from app.database_file.errors import StoreError
from app.database_file.in_use import Identity, identity_of

GONE = (
    "the database file {name} was deleted, moved or replaced while the server runs: no move is made and nothing is recorded "
    "until it is put back; else stop the server and restore a backup (marsexplorer restore)"
)


class LostDatabaseError(StoreError):
    """What is written would reach no file that anybody can read; nothing was acknowledged."""


class FilePlace:
    """The names of an open database and of its write-ahead log, and the files that they led to when it was opened."""

    def __init__(self, path: Path) -> None:
        log = (
            f"{os.path.realpath(path)}-wal"  # SQLite keeps it beside the file that a link leads to
        )
        self._name = path.name
        self._files: list[tuple[str, Identity]] = [
            (str(path), identity_of(path)),
            (log, identity_of(log)),
        ]

    def fault(self) -> str | None:
        """Return one sentence when a file is no longer where it was, else None; takes about 3 microseconds."""
        try:
            for path, identity in self._files:
                stat = os.stat(path)  # noqa: PTH116  # twice a move: Path.stat takes three times as long
                if (stat.st_dev, stat.st_ino) != identity:
                    return GONE.format(name=self._name)
        except OSError:
            return GONE.format(name=self._name)
        return None

    def check(self) -> None:
        """Raise LostDatabaseError when a file is no longer where it was."""
        if (fault := self.fault()) is not None:
            raise LostDatabaseError(fault)
