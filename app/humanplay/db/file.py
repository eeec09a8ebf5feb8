"""The database as a file among files: who holds it, whether it still stands where it was opened, and what it held last.

**Who has it open.** SQLite locks a file with POSIX locks, and a process that closes any handle on the file loses all of them.
So a file that is in use here is not opened and closed by anything else, and a handle of our own is closed when SQLite has none
left.

**Where it stands.** A file that is deleted, moved or replaced while SQLite has it open still takes every write: into nothing
that anybody will read again. SQLite does not notice; a look at device and inode does, without opening anything.

**Who may serve it.** Two locks of the operating system keep two servers from one database, by whatever name they know it; they
are gone when the process is, however that ends. One is on the file NAME-lock beside the database, which can be taken before
there is a database. On Linux the other one is on the database itself, so that a second server is refused through a symbolic
link, through a hard link, and after NAME-lock was deleted. Linux keeps such locks (flock) apart from those of SQLite (POSIX);
other systems do not, and have the first lock alone.

**What it held last.** A server that is killed leaves its newest steps in the write-ahead log. If that log is gone at the next
start, the database is whole and simply older, and SQLite cannot tell; a note of the last step in the lock file can. It is
written after each step into the page cache, which a kill does not take away, and stands as long as a server has not ended by
itself.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import sys
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path

GONE = (
    "the database file {name} was deleted, moved or replaced while the server runs: no move is made and nothing is recorded "
    "until it is put back; else stop the server and restore a backup (humanplay restore)"
)
_NOTE_BYTES = 256
_ENDED, _RUNS = "-", "runs"

Identity = tuple[int, int]
"""Device and inode."""

_counting = threading.Lock()
"""A reader on a thread of its own must not be lost from the count: the file would be taken for unused."""
_in_use: Counter[Identity] = Counter()
_to_close: dict[Identity, list[int]] = {}
_locked: set[Identity] = set()
"""Databases that this process has locked."""


def studies_beside(path: Path) -> Path:
    """The folder of a database's studies: of `lab.db` it is `lab.db-studies`."""
    # like SQLite's own companions: beside the file that a link leads to
    return Path(f"{os.path.realpath(path) if path.is_symlink() else path}-studies")


class StoreError(Exception):
    """The database cannot be used as asked; the message says what was expected, what came, and the way out."""


class WriteRefusedError(StoreError):
    """A write was not made, since its turn did not come; nothing has changed, and the same write may succeed later."""


def identity_of(path: Path | str) -> Identity:
    """Return device and inode of the file that a path leads to; OSError when there is none."""
    stat = Path(path).stat()
    return stat.st_dev, stat.st_ino


def is_in_use(path: Path) -> bool:
    """Return whether this process has the file open; OSError when there is none."""
    return _in_use[identity_of(path)] > 0


def hold(path: Path) -> Callable[[], None]:
    """Count the file as in use by this process, and return the function to call when the connection to it is closed."""
    held = [identity_of(path)]
    with _counting:
        _in_use.update(held)

    def release() -> None:
        with _counting:
            _in_use.subtract(held)
            for identity in held:
                _close_unused(identity)
            held.clear()

    return release


def close_when_unused(handle: int, identity: Identity) -> None:
    """Close a handle of our own on a database: now, or once no connection of this process has the file open."""
    with _counting:
        _to_close.setdefault(identity, []).append(handle)
        _close_unused(identity)


def _close_unused(identity: Identity) -> None:
    if _in_use[identity] > 0:
        return
    del _in_use[identity]
    for handle in _to_close.pop(identity, []):
        os.close(handle)


class LostDatabaseError(StoreError):
    """What is written would reach no file that anybody can read; nothing was acknowledged."""


class FilePlace:
    """The names of an open database and of its write-ahead log, and the files that they led to when it was opened."""

    def __init__(self, path: Path) -> None:
        # SQLite keeps it beside the file that a link leads to
        log = f"{os.path.realpath(path)}-wal"
        self._name = path.name
        paths = (str(path), log)
        self._files: list[tuple[str, Identity]] = [(p, identity_of(p)) for p in paths]

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


class DatabaseLock:
    """A hold on one database against every other server; StoreError while another one has it, and `close` gives it back."""

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
            why = f"{error.strerror}; give another --database"
            raise StoreError(f"cannot read the database {self._path}: {why}") from error
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
        """Note the last step that was committed; takes about 2 microseconds. A disk that is full keeps the former note."""
        self._note(f"{episode} {step}")

    def note_begin(self) -> bool:
        """Note that a server runs, and return whether the one before it ended by itself; a noted step stays."""
        if self._lock_file is None or os.pread(self._lock_file, 2, 0) != f"{_ENDED}\n".encode():
            return False
        self._note(_RUNS)
        return True

    def clear_step(self) -> None:
        """Note that the server ended by itself, or that somebody changed the database on purpose: no step is expected."""
        self._note(_ENDED)

    def expected_step(self) -> tuple[str, int] | None:
        """Return the episode and the step that the database must hold after a server that did not end by itself, else None."""
        if self._lock_file is None:
            return None
        words = os.pread(self._lock_file, _NOTE_BYTES, 0).decode(errors="replace").split()
        return (words[0], int(words[1])) if len(words) == 2 and words[1].isdecimal() else None

    def _note(self, text: str) -> None:
        if self._lock_file is not None:
            with contextlib.suppress(OSError):
                os.pwrite(self._lock_file, f"{text}\n".ljust(_NOTE_BYTES).encode(), 0)

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


def in_use_error(path: Path) -> StoreError:
    """Return the error of a database that another server holds."""
    return StoreError(f"{path} is in use by another server: stop it or give another --database")


def _lock_file_of(path: Path) -> int:
    """Return the handle of NAME-lock, locked."""
    try:
        name = path.with_name(path.name + "-lock")
        handle = os.open(name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        why = f"{error.strerror}; give another --database"
        raise StoreError(f"cannot write the database {path}: {why}") from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(handle)
        raise in_use_error(path) from error
    return handle
