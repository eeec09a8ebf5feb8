"""The tables of a bundle as queries over its own database: `queries.sql`, which every bundle holds a copy of."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from app.release.columns import BUNDLE_COLUMNS
from app.storage.database import stream

QUERIES = Path(__file__).with_name("queries.sql")


@cache
def queries() -> dict[str, str]:
    """Return table -> its SELECT."""
    parts = re.split(r"^-- table: (\w+)$", QUERIES.read_text(encoding="utf-8"), flags=re.M)
    return {
        name: text.strip().removesuffix(";")
        for name, text in zip(parts[1::2], parts[2::2], strict=True)
    }


def select(conn: sqlite3.Connection, table: str) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table from a bundle's database, columns in their order and truth values as such."""
    columns = BUNDLE_COLUMNS[table]
    truths = [column.name for column in columns if column.type == "boolean"]
    for row in stream(conn, queries()[table]):
        for name in truths:
            row[name] = None if row[name] is None else bool(row[name])
        yield {column.name: row[column.name] for column in columns}
