"""The lock that keeps two servers from one database, by whatever name they know it.

There are two locks of the operating system, which are gone when the process is, however that ends. One is on the file NAME-lock
beside the database, which can be taken before there is a database. On Linux the other one is on the database itself, so that
a second server is refused through a symbolic link, through a hard link, and after NAME-lock was deleted. Linux keeps such locks
(flock) apart from those of SQLite (POSIX); other systems do not, and have the first lock alone.
"""

from __future__ import annotations

import fcntl
import os
import sys
from pathlib import Path

from app.database_file import last_step
from app.database_file.errors import StoreError
from app.database_file.in_use import Identity, close_when_unused, identity_of

_locked: set[Identity] = set()
"""Databases that this process has locked."""


class DatabaseLock:
    """A hold on one database against every other server; `close` gives it back."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._database: tuple[int, Identity] | None = None
        self._lock_file: int | None = _lock_file_of(path)
        try:
            self.lock_database()
        except BaseException:
            self.close()
            raise

    def lock_database(self) -> None:
        """Lock the database itself, where there is one and it is not locked yet; StoreError while another server holds it."""
        if self._database is not None or sys.platform != "linux" or not self._path.exists():
            return
        if identity_of(self._path) in _locked:
            raise in_use_error(self._path)
        try:
            handle = os.open(self._path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            raise StoreError(
                f"cannot read the database {self._path}: {error.strerror}; give another --database"
            ) from error
        stat = os.fstat(handle)
        identity = stat.st_dev, stat.st_ino
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if identity_of(self._path) != identity:  # it was replaced since
                raise in_use_error(self._path)
        except OSError as error:
            close_when_unused(handle, identity)
            raise in_use_error(self._path) from error
        except StoreError:
            close_when_unused(handle, identity)
            raise
        self._database = handle, identity
        _locked.add(identity)

    def note_step(self, episode: str, step: int) -> None:
        """Keep the last step that was committed in the lock file (`app.database_file.last_step`)."""
        if self._lock_file is not None:
            last_step.note_step(self._lock_file, episode, step)

    def clear_step(self) -> None:
        """Expect no step of the database at the next start."""
        if self._lock_file is not None:
            last_step.clear(self._lock_file)

    def expected_step(self) -> tuple[str, int] | None:
        """Return the episode and the step that the database must hold after a server that did not end by itself, else None."""
        return None if self._lock_file is None else last_step.expected_step(self._lock_file)

    def close(self) -> None:
        """Leave the database to another server; a second call changes nothing."""
        if self._database is not None:
            handle, identity = self._database
            fcntl.flock(handle, fcntl.LOCK_UN)
            _locked.discard(identity)
            close_when_unused(handle, identity)
            self._database = None
        if self._lock_file is not None:
            os.close(self._lock_file)
            self._lock_file = None


def take_lock(path: Path) -> DatabaseLock:
    """Lock the database against other servers; StoreError while another server holds it."""
    return DatabaseLock(path)


def in_use_error(path: Path) -> StoreError:
    """Return the error of a database that another server holds."""
    return StoreError(f"{path} is in use by another server: stop it or give another --database")


def _lock_file_of(path: Path) -> int:
    """Return the handle of NAME-lock, locked."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(
            path.with_name(path.name + "-lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644
        )
    except OSError as error:
        raise StoreError(
            f"cannot write the database {path}: {error.strerror}; give another --database"
        ) from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(handle)
        raise in_use_error(path) from error
    return handle
