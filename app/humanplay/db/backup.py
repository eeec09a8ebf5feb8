"""Backups: one file that holds the database as it was at one moment.

SQLite copies it while a server goes on writing. A copy is made under another name, verified, and
only then given its own, so whatever has a backup's name is whole. A server makes backups by itself
(`Backups`), and `restore` puts one in the place of a database.
"""

from __future__ import annotations

import asyncio
import logging
import os
import re
import shutil
import sqlite3
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

from humanplay.db.checks import check_chain
from humanplay.db.database import RUNS, StoreError, reading
from humanplay.db.file import DatabaseLock, lock_path, recordings_beside
from humanplay.db.recording_files import (
    UNENDED_ERASURE,
    copy_recordings,
    move_folder,
    remove_folder,
)
from humanplay.task.recordings import size_of

_log = logging.getLogger(__name__)

Advance = Callable[[int, int], None]
"""Called with (pages copied, pages in all); raises to end the copy, which leaves nothing behind."""

PAGES = 256
"""Pages that are copied at a time: 1 MB."""
INSTRUCTIONS = 200_000
"""Instructions of SQLite between two calls of `advance`: a few milliseconds."""
KEPT = {"%Y%m%dT%H": 12, "%Y%m%d": 7, "%G-%V": 4}
"""strftime format of a period (UTC) -> in how many of the newest such periods the last backup
stays."""
SPARE_BYTES = 2**28
"""Free space that a copy must leave on its disk."""
PARTIAL = ".partial"
"""What follows the name of a copy that is not verified yet."""


def back_up(database: Path, target: Path, advance: Advance | None = None) -> int:
    """Copy a database that a server may be writing into a new file, and verify it.

    Returns:
        The size of the copy in bytes.

    Raises:
        StoreError: If `target` exists, the database cannot be read, the disk has too little room,
            or the copy is not whole.
    """
    for path in (target, recordings_beside(target)):
        if path.exists():
            raise StoreError(f"{path} exists already: give a new file's name for the backup")
    partial = target.with_name(target.name + PARTIAL)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove(partial)
        _copy(database, partial, advance)
        check_whole(partial, advance)
        _copy_recordings(database, partial)
        move_folder(partial, target)
        partial.replace(target)
        sync_folder(target.parent)
    except OSError as error:
        raise StoreError(f"cannot write the backup {target}: {error.strerror}") from error
    finally:
        _remove(partial)
    return target.stat().st_size


def _copy_recordings(database: Path, copy: Path) -> None:
    """Copy the recordings that the episodes of a copied database need."""
    with reading(copy) as conn:
        copy_recordings(conn, recordings_beside(database), recordings_beside(copy))


def check_whole(database: Path, advance: Advance | None = None) -> None:
    """Check every page, every reference and the chain of hashes of a database.

    Args:
        advance: Called now and then with (1, 1); if it raises, the check ends with a StoreError.

    Raises:
        StoreError: With the first thing that is wrong.
    """
    try:
        with reading(database) as conn:
            if advance is not None:
                conn.set_progress_handler(lambda: advance(1, 1), INSTRUCTIONS)
            damage = conn.execute("PRAGMA integrity_check(1)").fetchone()[0]
            if damage != "ok":
                raise StoreError(
                    f"{database} is damaged ({damage}): use another backup, or `sqlite3 {database} .recover | sqlite3 NEW`"
                )
            if stray := conn.execute("PRAGMA foreign_key_check").fetchone():
                raise StoreError(
                    f"{database} is not whole: a row of {stray[0]} belongs to nothing; use another backup"
                )
            for finding in check_chain(conn):
                raise StoreError(f"{database} was changed: {finding}; use another backup")
    except sqlite3.Error as error:
        raise StoreError(f"cannot read {database}: {error}") from error


def _copy(database: Path, target: Path, advance: Advance | None) -> None:
    def progress(_: int, remaining: int, total: int) -> None:
        if advance is not None:
            advance(total - remaining, total)

    try:
        with reading(database) as conn, closing(sqlite3.connect(target)) as copy:
            # from here on `conn` sees one moment
            conn.execute("SELECT count(*) FROM meta").fetchone()
            recorded = size_of(recordings_beside(database))
            check_room(conn, target.parent, "make room there, or give another place", recorded)
            conn.backup(copy, pages=PAGES, progress=progress)
            # no server has the copy, and all of it is in the file
            copy.execute("DELETE FROM meta WHERE name IN (?, ?)", [RUNS, UNENDED_ERASURE])
            copy.commit()
            # one file, which can be read where nothing can be written
            copy.execute("PRAGMA journal_mode = DELETE")
    except sqlite3.Error as error:
        raise StoreError(f"cannot copy {database} to {target}: {error}") from error


def check_room(conn: sqlite3.Connection, folder: Path, way_out: str, beside_bytes: int = 0) -> None:
    """Check that a folder's disk has room for a copy of a database.

    Args:
        way_out: What the user can do about it, for the error.
        beside_bytes: What is copied with it.

    Raises:
        StoreError: If it has not.
    """
    names = ("page_count", "page_size")
    pages, page_bytes = (conn.execute(f"PRAGMA {name}").fetchone()[0] for name in names)
    needed = pages * page_bytes + beside_bytes + SPARE_BYTES
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise StoreError(
            f"a copy in {folder} needs {needed:,} bytes ({SPARE_BYTES:,} of them stay free), {free:,} are available: {way_out}"
        )


def sync_folder(folder: Path) -> None:
    """Write a folder's names to the disk: a power cut must not undo a renaming."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _remove(path: Path) -> None:
    for name in (path, path.with_name(path.name + "-journal")):
        name.unlink(missing_ok=True)
    remove_folder(path)


def restore(
    backup: Path, database: Path, stamp: str, advance: Advance | None = None
) -> Path | None:
    """Put a verified copy of a backup in the place of a database.

    Args:
        stamp: Distinguishes the name that the old file gets, NAME.before-STAMP; its log, note and
            recordings (-wal, -lock, -recordings) go with it.

    Returns:
        The new name of what stood there; None if nothing did.

    Raises:
        StoreError: If a server has the database, the backup is not whole, or the disk is full;
            nothing changes then.
    """
    check_restorable(backup, database)
    database = database.resolve()  # behind a link lie the file, its log and its note
    lock = DatabaseLock(database)
    new = database.with_name(database.name + ".restored")
    try:
        _remove(new)
        back_up(backup, new, advance)
        old = _set_aside(database, stamp)
        remove_folder(database)
        move_folder(new, database)
        new.replace(database)
        lock.clear_note()
        sync_folder(database.parent)
        return old
    except OSError as error:
        raise StoreError(f"cannot restore to {database}: {error.strerror or error}") from error
    finally:
        lock.close()
        _remove(new)
        _remove(new.with_name(new.name + PARTIAL))


def check_restorable(backup: Path, database: Path) -> None:
    """Check that a file is a backup and no server has the database.

    Raises:
        StoreError: If not.
    """
    if not backup.is_file():
        raise StoreError(f"no backup at {backup}: give a file that `humanplay backup` wrote")
    if database.exists() and backup.samefile(database):
        raise StoreError(f"{backup} is the database itself: give the path of a backup")
    with reading(backup):
        DatabaseLock(database).close()


def _set_aside(database: Path, stamp: str) -> Path | None:
    """Give the database a second name, and its log and recordings too.

    The log must not meet the restored file. There may be a log without a database, if the file was
    lost.

    Returns:
        The second name; None if there was no database.
    """
    aside = database.with_name(f"{database.name}.before-{stamp}")
    was_there = database.exists()
    for suffix in ("", "-wal"):
        path = database.with_name(database.name + suffix)
        if path.exists():
            os.link(path, aside.with_name(aside.name + suffix))
    if recordings_beside(database).is_dir():
        shutil.copytree(
            recordings_beside(database), recordings_beside(aside), copy_function=os.link
        )
    if was_there:
        shutil.copy(lock_path(database), lock_path(aside))
    sync_folder(database.parent)
    for suffix in ("-wal", "-shm"):
        database.with_name(database.name + suffix).unlink(missing_ok=True)
    return aside if was_there else None


def _backups_to_keep(backups: Sequence[Path]) -> set[Path]:
    """Which of the backups, oldest first, stay by `KEPT`."""
    paths = set()
    for period, count in KEPT.items():
        last_of = {_made_at(path).strftime(period): path for path in backups}
        paths |= set(list(last_of.values())[-count:])
    return paths


def _made_at(backup: Path) -> datetime:
    return datetime.strptime(backup.stem[-16:], "%Y%m%dT%H%M%S%z")


class StoppedError(Exception):
    """The server ends: the backup that was being made is given up."""


class Backups:
    """The backups of one database in a folder, `NAME-YYYYMMDDTHHMMSSZ.db`.

    After a new one was verified, those beyond `KEPT` are deleted: at most 21 stay. What a killed
    server left of one that it had not ended is deleted too. Other files in the folder stay as they
    are.

    Args:
        every_s: Seconds between them; the first one is made at once when the newest in the
            folder is older than that.
    """

    def __init__(self, database: Path, folder: Path, every_s: float) -> None:
        self._database, self._folder, self._every_s = database, folder, every_s
        self._pattern = re.compile(re.escape(database.stem) + r"-\d{8}T\d{6}Z\.db")
        self._stopped = threading.Event()
        self.failures = 0

    def existing(self) -> list[Path]:
        """The backups in the folder, oldest first."""
        if not self._folder.is_dir():
            return []
        return sorted(path for path in self._folder.iterdir() if self._pattern.fullmatch(path.name))

    def age_s(self) -> float:
        """Seconds since the newest backup; -1 if there is none."""
        newest = self.existing()[-1:]
        return time.time() - newest[0].stat().st_mtime if newest else -1.0

    def make(self) -> Path:
        """Make a backup now, and delete those beyond `KEPT`.

        Returns:
            Its path.

        Raises:
            StoreError: If it cannot be made.
        """
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        target = self._folder / f"{self._database.stem}-{stamp}.db"
        self._remove_unended()
        back_up(self._database, target, self._check_going_on)
        existing = self.existing()
        for path in set(existing) - _backups_to_keep(existing):
            path.unlink(missing_ok=True)
            remove_folder(path)
        return target

    def _remove_unended(self) -> None:
        """Delete what a killed server left of backups that are not there."""
        if not self._folder.is_dir():
            return
        names = {
            match[0] for path in self._folder.iterdir() if (match := self._pattern.match(path.name))
        }
        for backup in (self._folder / name for name in names):
            if not backup.exists():
                _remove(backup.with_name(backup.name + PARTIAL))
                remove_folder(backup)

    async def run(self) -> None:
        """Make one backup after the other until cancelled; log those that fail."""
        age_s = self.age_s()
        wait_s = 0.0 if age_s < 0 else max(0.0, self._every_s - age_s)
        try:
            while True:
                await asyncio.sleep(wait_s)
                wait_s = self._every_s
                try:
                    await asyncio.to_thread(self.make)
                except (StoreError, OSError) as error:
                    self.failures += 1
                    _log.error("no backup was made: %s", error)
        finally:
            self._stopped.set()

    def _check_going_on(self, done: int, total: int) -> None:
        del done, total
        if self._stopped.is_set():
            raise StoppedError
