"""The database file: recognised before a write, opened, read at one moment.

A database of ours has APPLICATION_ID in its header and the schema's number in `user_version`. The
id is written before the file turns to write-ahead logging (WAL), so that it is in the file itself
even when the server is killed a moment later.

**Commits are counted.** The row `commits` of the table `meta` counts those of the server, and of
commands beside it; the note beside the file (`humanplay.db.file`) says how many were acknowledged.
The row `runs` is there while a server has the file, and after one that was killed. Before the file
is used the two numbers are compared, as a reader sees them with the log if there is one, and
nothing is written, so that a log can still be put back.
"""

from __future__ import annotations

import logging
import os
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from humanplay.db.columns import SCHEMA, TABLES
from humanplay.db.file import (
    DURABLE,
    DatabaseLock,
    StoreError,
    boot_id,
    hold,
    is_in_use,
    lock_path,
    log_path,
    note_commit,
    note_of,
    recordings_beside,
)
from humanplay.db.recording_files import delete_marked
from humanplay.task import counted
from humanplay.task.recordings import look_in


@contextmanager
def _hidden(name: str) -> Iterator[None]:
    """Let the import of a module fail within the block, unless it is loaded."""
    is_hidden = sys.modules.setdefault(name, None) is None  # type: ignore[arg-type]
    try:
        yield
    finally:
        if is_hidden:
            del sys.modules[name]


# if pandas is installed, sqlite_utils would load it to know one more type of column: half a second
with _hidden("pandas"):
    from sqlite_utils import Database

APPLICATION_ID = 0x48504C59
"""`HPLY` in ASCII, at byte 68 of the file."""

__all__ = [
    "APPLICATION_ID",
    "COUNT_COMMIT",
    "RUNS",
    "StoreError",
    "accept_missing",
    "check_commits",
    "check_writable",
    "commits_in",
    "damaged",
    "open_database",
    "open_read_only",
    "reading",
    "recognise",
    "rows",
    "stream",
    "transaction",
]

BUSY_MS = 5_000
SqlValue = str | int | float | bytes | None
"""What a column holds."""
Row = dict[str, SqlValue]
"""A row of any table, by column."""
RUNS = "runs"
"""The row of `meta` that is there from a server's start to its clean end."""
COUNT_COMMIT = """INSERT INTO meta VALUES ('commits', '1') ON CONFLICT (name) DO UPDATE SET value = value + 1
    RETURNING CAST(value AS INTEGER)"""
"""Raises the number of commits within a transaction, and returns it."""
_log = logging.getLogger(__name__)
READ_ONLY = "the database {} is read-only: make it writable or give another --database"


@contextmanager
def transaction(conn: sqlite3.Connection) -> Iterator[None]:
    """Commit what the block writes as a whole or, on any exception, nothing of it."""
    conn.execute("BEGIN IMMEDIATE")
    try:
        yield
        conn.execute("COMMIT")
    except BaseException:
        if conn.in_transaction:
            conn.execute("ROLLBACK")
        raise


@contextmanager
def writing(path: Path, timeout_s: float = BUSY_MS / 1000) -> Iterator[sqlite3.Connection]:
    """Yield a connection of its own inside a transaction, beside a server or alone.

    Args:
        timeout_s: Seconds to wait for another program that is writing.

    Raises:
        StoreError: If the database does not take the write.
    """
    check_writable(path)
    check_commits(path)
    _look_beside(path)
    # mode=rw: a file that was just deleted must not come back as an empty one
    uri = path.resolve().as_uri() + "?mode=rw"
    try:
        with closing(sqlite3.connect(uri, timeout_s, isolation_level=None, uri=True)) as conn:
            _check_schema(conn, path)
            with transaction(conn):
                yield conn
                (commits,) = conn.execute(COUNT_COMMIT).fetchone()
            note_commit(path, commits)
    except (sqlite3.Error, OSError) as error:
        raise StoreError(f"the database {path} did not take a write: {error}") from error


def _connect(database: Path | str, is_uri: bool = False) -> sqlite3.Connection:
    return sqlite3.connect(
        database, BUSY_MS / 1000, isolation_level=None, check_same_thread=False, uri=is_uri
    )


def create_tables(conn: sqlite3.Connection) -> None:
    """Create the tables of a new database; one with a schema stays as it is."""
    with transaction(conn):
        if _schema_of(conn) == 0:
            for table in TABLES.values():
                for statement in table.statements():
                    conn.execute(statement)
            conn.execute(f"PRAGMA user_version = {SCHEMA}")


def _schema_of(conn: sqlite3.Connection) -> int:
    return int(conn.execute("PRAGMA user_version").fetchone()[0])


def _check_schema(conn: sqlite3.Connection, path: Path, *, may_be_new: bool = False) -> None:
    schema = _schema_of(conn)
    if schema != SCHEMA and not (schema == 0 and may_be_new):
        raise StoreError(
            f"{path} must have schema {SCHEMA}, got schema {schema}: open it with the version of MarsExplorer Playground that "
            "made it, or give another --database (a new path makes a new one)"
        )
    conn.execute("PRAGMA trusted_schema = OFF")
    if schema == SCHEMA and (stray := _stray(conn)):
        raise StoreError(
            f"{path} holds {stray}, which is not as MarsExplorer Playground makes it and may do harm: restore a backup "
            "(humanplay restore), or give another --database"
        )


_NEEDED = {sql for table in TABLES.values() for sql in table.statements()}
_OURS = _NEEDED | {sql for table in TABLES.values() for sql in table.statements("bundle database")}
_TABLES = "SELECT type, name, tbl_name, replace(sql, '\"', '') FROM sqlite_schema"


def _stray(conn: sqlite3.Connection) -> str | None:
    """What in a file's schema could act or is not ours word for word; None if nothing.

    Views and triggers act; so can constraints and indexes of our tables. Further tables are never
    read and may be there.
    """
    cursor, lacking = conn.cursor(), set(_NEEDED)
    cursor.row_factory = None
    for kind, name, table, sql in cursor.execute(_TABLES):
        lacking.discard(sql)
        is_changed = table in TABLES and sql is not None and sql not in _OURS
        if kind in ("view", "trigger") or is_changed:
            return f"the {kind} {name}"
    return f"no {' '.join(min(lacking).split()[1:3]).lower()}" if lacking else None


def recognise(path: Path) -> None:
    """Check that the file is absent, empty or ours.

    The header is read without SQLite, which might write a file next to it. A file that this process
    has open was recognised before and is not read again: closing any handle on it would drop
    SQLite's locks, and another program could take the log away.

    Raises:
        StoreError: If it is something else.
    """
    try:
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "none that holds data (a pipe, a device)"
            raise StoreError(
                f"the database must be a file, {path} is {kind}: give a file's path with --database"
            )
        if not path.parent.is_dir():
            raise StoreError(
                f"there is no folder {path.parent} for the database {path.name}: make it, or give another --database"
            )
        if not path.exists() or is_in_use(path):
            return
        with path.open("rb") as file:
            header = file.read(100)
    except OSError as error:
        raise StoreError(f"cannot read the database {path}: {error.strerror}") from error
    if header and not header.startswith(b"SQLite format 3\0"):
        raise StoreError(f"{path} is not a database: nothing was written; give another --database")
    if header and int.from_bytes(header[68:72], "big") != APPLICATION_ID:
        raise StoreError(
            f"{path} is a database of another program: nothing was written; "
            "give another --database (a new path makes a new one)"
        )
    # the number 1 stands for 65536 bytes
    page = int.from_bytes(header[16:18], "big") if header else 0
    # SQLite takes less than a page for an empty file
    if path.stat().st_size < (65536 if page == 1 else page):
        raise StoreError(
            f"the database {path} is damaged (cut short): restore it from a backup or give another --database"
        )


def check_writable(path: Path) -> None:
    """Check that the file is absent, empty or ours, and not read-only; writes nothing.

    Raises:
        StoreError: If not.
    """
    recognise(path)
    if path.exists() and not os.access(path, os.W_OK):
        raise StoreError(READ_ONLY.format(path))


def check_commits(path: Path) -> int:
    """Check that a database holds every commit that was acknowledged; writes nothing.

    Returns:
        How many commits a power cut took from a server that was not `--durable`, which is logged;
        else 0.

    Raises:
        StoreError: If commits are missing for any other reason.
    """
    if path.exists() and is_in_use(path):
        return 0
    # read the note first: a commit that is made meanwhile then counts as extra, not as missing
    note = note_of(path)
    commits, runs = commits_in(path)
    if note is None and runs:
        raise StoreError(
            f"cannot tell whether the database {path} is whole: a server had it open and was killed, or runs still, and "
            f"{lock_path(path).name} is gone, which says how many commits there must be. Put that file back, restore a backup "
            "(humanplay restore), or go on with what is there (`humanplay verify`, then `serve`, with --accept-loss)"
        )
    missing = 0 if note is None else note.commits - commits
    if note is None or missing <= 0:
        return 0
    has_log = log_path(path).exists()
    commits_in_words = counted(missing, "commit that was", "commits that were")
    lacks = (
        f"the database {path} lacks {commits_in_words} acknowledged before its server was killed"
    )
    if has_log and note.boot not in (DURABLE, boot_id()):
        _log.warning("%s: a power cut can do this, which --durable prevents", lacks)
        return missing
    state = "is not the one that they are in" if has_log else "is gone, and they are in it"
    raise StoreError(
        f"{lacks}: it holds {commits}. Its log {log_path(path).name} {state}: put it back beside the database before "
        "anything else opens it, restore a backup (humanplay restore), or go on without them (`humanplay verify`, then "
        "`serve`, with --accept-loss)"
    )


def accept_missing(path: Path) -> None:
    """Let a database be used as it is, although commits are or might be missing.

    Raises:
        StoreError: If a server has it.
    """
    lock = DatabaseLock(path)
    try:
        lock.begin_note(commits_in(path)[0], durable=False)
    finally:
        lock.close()


def commits_in(path: Path) -> tuple[int, bool]:
    """Count a database's commits; writes nothing.

    Returns:
        The number, 0 if it is new; and whether a server has it or was killed.
    """
    if not path.exists() or path.stat().st_size == 0:
        return 0, False
    # without a log the file is all there is to read, and reading must not create one
    uri = path.resolve().as_uri() + "?mode=ro" + ("" if log_path(path).exists() else "&immutable=1")
    try:
        with closing(_connect(uri, is_uri=True)) as conn:
            _check_schema(conn, path, may_be_new=True)
            if _schema_of(conn) == 0:
                return 0, False
            rows = dict(
                conn.execute(
                    "SELECT name, value FROM meta WHERE name IN ('commits', ?)", [RUNS]
                ).fetchall()
            )
    except sqlite3.Error as error:
        raise StoreError(_explain(path, error)) from error
    return int(rows.get("commits", 0)), RUNS in rows


def open_database(path: Path, durable: bool = False) -> Database:
    """Open the database for writing, in WAL mode; create it if it is absent.

    It is recognised and compared with its note first.
    """
    check_writable(path)
    check_commits(path)
    try:
        conn = _connect(path)
    except sqlite3.Error as error:
        raise StoreError(f"cannot open the database {path}: {error}") from error
    try:
        is_new = path.stat().st_size == 0
        if is_new:
            conn.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        _check_schema(conn, path, may_be_new=True)
        conn.execute("PRAGMA journal_mode = WAL")
        conn.execute(f"PRAGMA synchronous = {'FULL' if durable else 'NORMAL'}")
        conn.execute("PRAGMA foreign_keys = ON")
        create_tables(conn)
        with transaction(conn):
            conn.execute("SELECT count(*) FROM meta")
        delete_marked(conn, path)
        # a new file must be known as ours even if its log is lost: then commits are missing, not the database
        if is_new:
            conn.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        return Database(conn)
    except BaseException as error:
        conn.close()
        if isinstance(error, sqlite3.Error):
            raise StoreError(_explain(path, error)) from error
        raise


def open_read_only(path: Path) -> Database:
    """Open the database for reading, whether or not a server has it open.

    Raises:
        StoreError: If it is not one of ours.
    """
    if not path.exists():
        raise StoreError(f"no database at {path}: play first, or give the path with --database")
    recognise(path)
    check_commits(path)
    _look_beside(path)
    still = "" if log_path(path).exists() or os.access(path.parent, os.W_OK) else "&immutable=1"
    uri = path.resolve().as_uri() + "?mode=ro" + still
    try:
        conn = _connect(uri, is_uri=True)
    except sqlite3.Error as error:
        raise StoreError(_explain(path, error)) from error
    try:
        _check_schema(conn, path)
        return Database(conn)
    except BaseException as error:
        conn.close()
        if isinstance(error, sqlite3.Error):
            raise StoreError(_explain(path, error)) from error
        raise


def _look_beside(path: Path) -> None:
    """Let recordings be found that are beside a database, if there are any."""
    if (folder := recordings_beside(path)).is_dir():
        look_in(folder)


def damaged(path: Path, damage: str) -> str:
    """One sentence for a database that is damaged, with the ways out."""
    return (
        f"the database {path} is damaged ({damage}): restore it from a backup (humanplay restore), read out what can be read "
        f"(sqlite3 {path} .recover | sqlite3 NEW), or give another --database"
    )


def _explain(path: Path, error: sqlite3.Error) -> str:
    """One sentence for an error of SQLite on opening."""
    text = str(error)
    if "readonly" in text:
        return READ_ONLY.format(path)
    if "malformed" in text or "not a database" in text or "no such table" in text:
        return damaged(path, text)
    if "locked" in text:
        return f"{path} is in use by another program: stop it or give another --database"
    if "full" in text:
        return f"cannot open the database {path}: the disk is full: make room, or give another --database"
    return f"cannot open the database {path}: {text}; give another --database"


@contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """Yield a read-only connection that sees a database as it is at the first query.

    Raises:
        StoreError: If the file is not one of ours, or turns out to be damaged inside the block.
    """
    db = open_read_only(path)
    release = hold(path)
    try:
        conn: sqlite3.Connection = db.conn
        conn.execute("BEGIN")
        yield conn
    except sqlite3.DatabaseError as error:
        if "malformed" not in str(error) and "not a database" not in str(error):
            raise
        raise StoreError(damaged(path, str(error))) from error
    finally:
        db.close()
        release()


def stream(conn: sqlite3.Connection, sql: str, *values: SqlValue | Row) -> Iterator[Any]:
    """Yield a query's rows one at a time, each a dictionary by column.

    The query fixes the types of the columns: whoever hands its rows on gives them a type.

    Args:
        values: For its question marks, or one mapping for its names.
    """
    cursor = conn.execute(sql, values[0] if values and isinstance(values[0], dict) else values)
    names = [column[0] for column in cursor.description]
    for row in cursor:
        yield dict(zip(names, row, strict=True))


def rows(conn: sqlite3.Connection, sql: str, *values: SqlValue | Row) -> list[Any]:
    """A query's rows (`stream`)."""
    return list(stream(conn, sql, *values))
