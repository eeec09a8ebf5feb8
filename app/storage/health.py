"""What SQLite's own check says of a database file, and how far its chain has come."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from app.storage import chain
from app.storage.connection import reading
from app.storage.database import StoreError
from app.storage.reader import Reader


def quick_check(database: Path) -> str:
    """Return "ok", or what is damaged; reads the whole file, which takes milliseconds to minutes."""
    try:
        with closing(Reader.open(database)) as reader:
            rows = reader.query("PRAGMA quick_check(5)")
    except (StoreError, sqlite3.DatabaseError) as error:
        return str(error)
    return "; ".join(str(next(iter(row.values()))) for row in rows)


def chain_head(database: Path) -> chain.Head | None:
    """Return the end of the chain of a database that a server may be writing; None when it cannot be read."""
    try:
        with reading(database) as conn:
            return chain.head(conn)
    except (StoreError, sqlite3.DatabaseError):
        return None
