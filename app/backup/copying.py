"""A backup: one file that holds the database as it was at one moment, copied by SQLite while a server goes on writing.

The copy is made under another name, verified, and only then given its own, so whatever has a backup's name is whole.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from app.storage.chain_checks import check_chain
from app.storage.connection import reading
from app.storage.database import StoreError

Advance = Callable[[int, int], None]
"""Called with (pages copied, of how many); an exception of it ends the copy, and nothing is left behind."""

PAGES = 256
"""Pages that are copied at a time: 1 MB."""
INSTRUCTIONS = 200_000
"""Instructions of SQLite between two calls of `advance`: a few milliseconds."""
PARTIAL = ".partial"
"""What follows the name of a copy that is not verified yet."""


def back_up(database: Path, target: Path, advance: Advance | None = None) -> int:
    """Copy a database that a server may be writing into a new file, verify the copy, and return its size in bytes.

    StoreError when `target` exists, when the database cannot be read, when the disk is full, and when the copy is not whole.
    """
    if target.exists():
        raise StoreError(f"{target} exists already: give a new file's name for the backup")
    partial = target.with_name(target.name + PARTIAL)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove(partial)
        _copy(database, partial, advance)
        check_whole(partial, advance)
        partial.replace(target)
        sync_folder(target.parent)
    except OSError as error:
        raise StoreError(f"cannot write the backup {target}: {error.strerror}") from error
    finally:
        _remove(partial)
    return target.stat().st_size


def check_whole(database: Path, advance: Advance | None = None) -> None:
    """Check every page, every reference and the chain of hashes of a database; StoreError with the first that is wrong.

    advance  called now and then with (1, 1); an exception of it ends the check with a StoreError
    """
    try:
        with reading(database) as conn:
            if advance is not None:
                conn.set_progress_handler(lambda: advance(1, 1), INSTRUCTIONS)
            found = conn.execute("PRAGMA integrity_check(1)").fetchone()[0]
            if found != "ok":
                raise StoreError(
                    f"{database} is damaged ({found}): use another backup, or `marsexplorer recover {database}`"
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
            conn.execute(
                "SELECT count(*) FROM meta"
            ).fetchone()  # from here on `conn` sees one moment
            conn.backup(copy, pages=PAGES, progress=progress)
            copy.execute(
                "PRAGMA journal_mode = DELETE"
            )  # one file, which can be read where nothing can be written
    except sqlite3.Error as error:
        raise StoreError(f"cannot copy {database} to {target}: {error}") from error


def sync_folder(folder: Path) -> None:
    """Write a folder's names to the disk, so that a power cut does not undo a renaming."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _remove(path: Path) -> None:
    for name in (path, path.with_name(path.name + "-journal")):
        name.unlink(missing_ok=True)
