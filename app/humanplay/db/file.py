"""The database as a file: who holds it, where it lies, and how much it must hold.

**Who has it open.** SQLite locks a file with POSIX locks, and a process that closes any handle on
the file loses all of them. So a file that is in use here is not opened and closed by anything else,
and a handle of our own is closed when SQLite has none left.

**Where it lies.** A file that is deleted, moved or replaced while SQLite has it open still takes
every write: into nothing that anybody will read again. SQLite does not notice; a look at device and
inode does, without opening anything.

**Who may serve it.** Two locks of the operating system keep two servers from one database, by
whatever name they know it; they are gone when the process is, however that ends. One is on the file
NAME-lock beside the database, which can be taken before there is a database. On Linux the other one
is on the database itself, so that a second server is refused through a symbolic link, through a
hard link, and after NAME-lock was deleted. Linux keeps such locks (flock) apart from those of
SQLite (POSIX); other systems do not, and have the first lock alone.

**How much it must hold.** A server that is killed leaves its newest commits in the write-ahead log.
If that log is gone at the next start, the database is whole and simply older, and SQLite cannot
tell. So NAME-lock holds a note of how many commits were acknowledged (`humanplay.db.database`
counts them). It is written after each commit into the page cache, which a kill does not take away,
and emptied when a server ends by itself.
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
from typing import NamedTuple

from humanplay.task.sentences import Sentence

GONE = Sentence(
    "store.gone",
    "the database file {name} was deleted, moved or replaced while the server runs: no move is made and nothing is recorded "
    "until it is put back; else stop the server and restore a backup (humanplay restore)",
)
DIGITS = 20
"""Digits of the commits in a note: always as many, since a note is written over the former one."""
DURABLE = "durable"
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")

Identity = tuple[int, int]
"""Device and inode."""

_counting = threading.Lock()
"""Guards the counts: if a reader on another thread got lost, the file would be taken for unused."""
_in_use: Counter[Identity] = Counter()
_to_close: dict[Identity, list[int]] = {}
_locked: set[Identity] = set()
"""Databases that this process has locked."""


def studies_beside(path: Path) -> Path:
    """The folder of a database's studies: of `lab.db` it is `lab.db-studies`."""
    return _beside(path, "studies")


def recordings_beside(path: Path) -> Path:
    """The folder of a database's recordings: of `lab.db` it is `lab.db-recordings`."""
    return _beside(path, "recordings")


def _beside(path: Path, name: str) -> Path:
    # like SQLite's own companions: beside the file that a link leads to
    return Path(f"{os.path.realpath(path) if path.is_symlink() else path}-{name}")


class StoreError(Exception):
    """The database cannot be used as asked; says what came instead and the way out."""


class WriteRefusedError(StoreError):
    """A write's turn did not come.

    Nothing has changed, and the same write may succeed later.
    """


def identity_of(path: Path | str) -> Identity:
    """Device and inode of the file that a path leads to; OSError if there is none."""
    stat = Path(path).stat()
    return stat.st_dev, stat.st_ino


def is_in_use(path: Path) -> bool:
    """Whether this process has the file open; OSError if there is none."""
    return _in_use[identity_of(path)] > 0


def hold(path: Path) -> Callable[[], None]:
    """Count the file as in use by this process.

    Returns:
        The function to call when the connection to it is closed.
    """
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
    """Close a handle of our own on a database as soon as that is safe.

    That is at once, or when no connection of this process has the file open any more.
    """
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
    """A write would reach no file that anybody can read; it was not acknowledged."""


class FilePlace:
    """Where an open database and its write-ahead log were when it was opened."""

    def __init__(self, path: Path) -> None:
        self._name = path.name
        paths = (str(path), str(log_path(path)))
        self._files: list[tuple[str, Identity]] = [(p, identity_of(p)) for p in paths]

    def fault(self) -> str | None:
        """One sentence if a file is no longer where it was, else None.

        Takes about 3 microseconds.
        """
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
    """A hold on one database against every other server; `close` gives it back.

    Raises:
        StoreError: If another server has it.
    """

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
        """Lock the database itself, if there is one and it is not locked yet.

        Raises:
            StoreError: If another server holds it.
        """
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

    def begin_note(self, commits: int, durable: bool) -> None:
        """Note on the disk how many commits the database holds.

        Args:
            durable: Whether a power cut takes no further ones.
        """
        if self._lock_file is not None:
            text = f"{commits:0{DIGITS}} {DURABLE if durable else boot_id()}\n"
            with contextlib.suppress(OSError):
                os.ftruncate(self._lock_file, 0)
                os.pwrite(self._lock_file, text.encode(), 0)
                os.fsync(self._lock_file)

    def note(self, commits: int) -> None:
        """Note a commit; takes about 2 microseconds.

        If the disk is full the note stays as it is.
        """
        if self._lock_file is not None:
            with contextlib.suppress(OSError):
                os.pwrite(self._lock_file, f"{commits:0{DIGITS}}".encode(), 0)

    def clear_note(self) -> None:
        """Empty the note: all commits are in the file, which anybody may replace."""
        if self._lock_file is not None:
            with contextlib.suppress(OSError):
                os.ftruncate(self._lock_file, 0)

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


class InUseError(StoreError):
    """Another server holds the database."""


def in_use_error(path: Path) -> InUseError:
    """The error of a database that another server holds."""
    return InUseError(f"{path} is in use by another server: stop it or give another --database")


class Note(NamedTuple):
    """What a note says.

    Attributes:
        commits: That were acknowledged.
        boot: Of the system that they were made on, or DURABLE: then a power cut takes none.
    """

    commits: int
    boot: str


def note_of(path: Path) -> Note | None:
    """The note beside a database; None without one."""
    try:
        words = lock_path(path).read_text(errors="replace").split()
    except OSError:
        return None
    return Note(int(words[0]), words[1]) if len(words) == 2 and words[0].isdecimal() else None


def note_commit(path: Path, commits: int) -> None:
    """Note a commit made beside a server, unless the server has noted a later one."""
    note = note_of(path)
    if note is not None and note.commits < commits:
        with contextlib.suppress(OSError), lock_path(path).open("r+b") as file:
            file.write(f"{commits:0{DIGITS}}".encode())


def boot_id() -> str:
    """Identifies one start of the system; "unknown" if it is not Linux."""
    try:
        return _BOOT_ID.read_text().strip()
    except OSError:
        return "unknown"


def lock_path(path: Path) -> Path:
    """NAME-lock of a database, beside the file that a link leads to."""
    return Path(f"{os.path.realpath(path)}-lock")


def log_path(path: Path) -> Path:
    """SQLite's write-ahead log of a database, beside the file that a link leads to."""
    return Path(f"{os.path.realpath(path)}-wal")


def _lock_file_of(path: Path) -> int:
    """Open NAME-lock, lock it and return its handle."""
    try:
        name = lock_path(path)
        handle = os.open(name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
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
