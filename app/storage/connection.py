"""Read-only connections that see a database at one moment, and rows as dictionaries."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from app.database_file.in_use import hold
from app.storage.database import StoreError, damaged, open_read_only


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


def is_copy(conn: sqlite3.Connection) -> bool:
    """Return whether a connection reads a copy in memory: `open_read_only` makes one of a database of an earlier schema."""
    return not conn.execute("SELECT file FROM pragma_database_list WHERE name = 'main'").fetchone()[
        0
    ]


def stream(conn: sqlite3.Connection, sql: str, *values: Any) -> Iterator[dict[str, Any]]:
    """Yield a query's rows one at a time, each a dictionary by column."""
    cursor = conn.execute(sql, values)
    names = [column[0] for column in cursor.description]
    for row in cursor:
        yield dict(zip(names, row, strict=True))


def rows(conn: sqlite3.Connection, sql: str, *values: Any) -> list[dict[str, Any]]:
    """Return a query's rows, each a dictionary by column."""
    return list(stream(conn, sql, *values))
