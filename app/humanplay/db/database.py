"""The database file: recognised or refused before a byte is written, opened, and read at one moment.

A database of ours has APPLICATION_ID in its header and the schema's number in `user_version`. The id is written before the
file turns to write-ahead logging (WAL), so that it is in the file itself even when the server is killed a moment later.
"""

from __future__ import annotations

import os
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from humanplay.db.columns import SCHEMA, TABLES
from humanplay.db.file import StoreError, hold, is_in_use


@contextmanager
def _hidden(name: str) -> Iterator[None]:
    """Let an import of this module fail within the block, unless it is imported already."""
    is_hidden = sys.modules.setdefault(name, None) is None  # type: ignore[arg-type]
    try:
        yield
    finally:
        if is_hidden:
            del sys.modules[name]


with _hidden(
    "pandas"
):  # where it is installed, sqlite_utils would load it to know one more type of column: half a second
    from sqlite_utils import Database

APPLICATION_ID = 0x48504C59
"""`HPLY` in ASCII, at byte 68 of the file."""

__all__ = [
    "APPLICATION_ID",
    "StoreError",
    "check_last_step",
    "check_writable",
    "damaged",
    "holds_step",
    "lost_steps",
    "open_database",
    "open_read_only",
    "reading",
    "recognise",
    "rows",
    "stream",
    "transaction",
]

BUSY_MS = 5_000
_CONNECTION: Any = {"timeout": BUSY_MS / 1000, "isolation_level": None, "check_same_thread": False}
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
    """Yield a connection of its own inside a transaction, whoever else has the database open; StoreError for a refused write.

    timeout_s  to wait for another program that is writing
    """
    check_writable(path)
    # mode=rw: a file that was just deleted is not made again, as an empty one
    uri = path.resolve().as_uri() + "?mode=rw"
    try:
        with closing(sqlite3.connect(uri, timeout_s, isolation_level=None, uri=True)) as conn:
            _check_schema(conn, path)
            with transaction(conn):
                yield conn
    except (sqlite3.Error, OSError) as error:
        raise StoreError(f"the database {path} did not take a write: {error}") from error


def create_tables(conn: sqlite3.Connection) -> None:
    """Make the tables of a new database and give it its number; one that has a number stays as it is."""
    with transaction(conn):
        if _schema_of(conn) == 0:
            for table in TABLES.values():
                for statement in table.statements():
                    conn.execute(statement)
            conn.execute(f"PRAGMA user_version = {SCHEMA}")


def _schema_of(conn: sqlite3.Connection) -> int:
    return int(conn.execute("PRAGMA user_version").fetchone()[0])


def _check_schema(conn: sqlite3.Connection, path: Path, *, may_be_new: bool = False) -> None:
    found = _schema_of(conn)
    if found != SCHEMA and not (found == 0 and may_be_new):
        raise StoreError(
            f"{path} must have schema {SCHEMA}, got schema {found}: open it with the version of MarsExplorer Playground that "
            "made it, or give another --database (a new path makes a new one)"
        )
    conn.execute("PRAGMA trusted_schema = OFF")
    if found == SCHEMA and (stray := _stray(conn)):
        raise StoreError(
            f"{path} holds {stray}, which is not as MarsExplorer Playground makes it and may do harm: restore a backup "
            "(humanplay restore), or give another --database"
        )


_NEEDED = {sql for table in TABLES.values() for sql in table.statements()}
_OURS = _NEEDED | {sql for table in TABLES.values() for sql in table.statements("bundle database")}
_TABLES = "SELECT type, name, tbl_name, replace(sql, '\"', '') FROM sqlite_schema"


def _stray(conn: sqlite3.Connection) -> str | None:
    """Return in words what of a file's schema could act, or is not ours word for word; None for none.

    Views and triggers act; so can constraints and indexes of our tables. Further tables are never read and may be there.
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
    """Check that the file is absent, empty or ours; StoreError otherwise.

    The header is read without SQLite, which might write a file next to it. A file that this process has open was recognised
    before and is not read again: closing any handle on it would drop SQLite's locks, and another program could take the log
    away.
    """
    try:
        if path.exists() and not path.is_file():
            what = "a folder" if path.is_dir() else "none that holds data (a pipe, a device)"
            way_out = "give a file's path with --database"
            raise StoreError(f"the database must be a file, {path} is {what}: {way_out}")
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
    page = int.from_bytes(header[16:18], "big") if header else 0  # the value 1 stands for 65536
    # SQLite takes less than a page for an empty file
    if path.stat().st_size < (65536 if page == 1 else page):
        raise StoreError(
            f"the database {path} is damaged (cut short): restore it from a backup or give another --database"
        )


def check_writable(path: Path) -> None:
    """Check that the file is absent, empty or ours, and not read-only; StoreError otherwise. Writes nothing."""
    recognise(path)
    if path.exists() and not os.access(path, os.W_OK):
        raise StoreError(READ_ONLY.format(path))


def check_last_step(path: Path, expected: tuple[str, int] | None) -> None:
    """Check that a database holds the last step of a server that was killed, where its log is gone; StoreError otherwise.

    expected  episode and step; None: nothing is known. Nothing is written, so that the log can still be put back.
    """
    if expected is None or Path(f"{os.path.realpath(path)}-wal").exists():
        return
    try:
        uri = path.resolve().as_uri() + "?mode=ro&immutable=1"
        with closing(sqlite3.connect(uri, uri=True)) as conn:
            if holds_step(conn, expected):
                return
    except sqlite3.Error as error:
        if path.exists() and "no such table" not in str(error):
            return  # damaged: whoever opens it says so
    raise StoreError(
        f"{lost_steps(path, expected)}. Its log {path.name}-wal is gone, and with it what was played last: put it back beside "
        "the database before anything else opens it, restore a backup, or go on without those moves (serve --accept-loss)"
    )


def holds_step(conn: sqlite3.Connection, step: tuple[str, int]) -> bool:
    """Return whether a database holds a step, given as episode and number."""
    sql = "SELECT 1 FROM steps WHERE episode_id = ? AND step = ?"
    return conn.execute(sql, step).fetchone() is not None


def lost_steps(path: Path, step: tuple[str, int]) -> str:
    """Return in words that a database lacks the last step which was recorded in it, without a full stop."""
    episode, number = step
    return (
        f"the database {path} is older than it was when its server was killed: step {number} of the episode {episode}, the "
        "last one that was recorded, is not in it"
    )


def open_database(path: Path, durable: bool = False) -> Database:
    """Open the database for writing, recognised and in WAL mode; it is made when absent."""
    check_writable(path)
    try:
        conn: sqlite3.Connection = sqlite3.connect(path, **_CONNECTION)
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
        if is_new:  # a file whose log is lost shall be seen to be one of ours that lacks something
            conn.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        return Database(conn)
    except BaseException as error:
        conn.close()
        if isinstance(error, sqlite3.Error):
            raise StoreError(_explain(path, error)) from error
        raise


def open_read_only(path: Path) -> Database:
    """Open the database for reading, whether or not a server has it open; StoreError when it is not one of ours."""
    if not path.exists():
        raise StoreError(f"no database at {path}: play first, or give the path with --database")
    recognise(path)
    has_log = path.with_name(path.name + "-wal").exists()
    still = "" if has_log or os.access(path.parent, os.W_OK) else "&immutable=1"
    uri = path.resolve().as_uri() + "?mode=ro" + still
    try:
        conn: sqlite3.Connection = sqlite3.connect(uri, uri=True, **_CONNECTION)
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


def damaged(path: Path, found: str) -> str:
    """Return one sentence for a database that is damaged, with the ways out."""
    return (
        f"the database {path} is damaged ({found}): restore it from a backup (humanplay restore), read out what can be read "
        f"(sqlite3 {path} .recover | sqlite3 NEW), or give another --database"
    )


def _explain(path: Path, error: sqlite3.Error) -> str:
    """Return one sentence for an error of SQLite on opening."""
    text = str(error)
    if "readonly" in text:
        return READ_ONLY.format(path)
    if "malformed" in text or "not a database" in text or "no such table" in text:
        return damaged(path, text)
    if "locked" in text:
        return f"{path} is in use by another program: stop it or give another --database"
    return f"cannot open the database {path}: {text}"


@contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """Yield a read-only connection that sees a database as it is at the first query.

    StoreError when the file is not one of ours, and when it turns out to be damaged inside the block.
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


def stream(conn: sqlite3.Connection, sql: str, *values: Any) -> Iterator[dict[str, Any]]:
    """Yield a query's rows one at a time, each a dictionary by column; values are for its question marks, or one by name."""
    cursor = conn.execute(sql, values[0] if values and isinstance(values[0], dict) else values)
    names = [column[0] for column in cursor.description]
    for row in cursor:
        yield dict(zip(names, row, strict=True))


def rows(conn: sqlite3.Connection, sql: str, *values: Any) -> list[dict[str, Any]]:
    """Return a query's rows, each a dictionary by column."""
    return list(stream(conn, sql, *values))
