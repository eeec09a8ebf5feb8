"""Which releases of a study were published, as the table `releases` holds them."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Sequence
from typing import Any, NamedTuple

from app.storage.database import rows
from app.storage.forgotten import LOOKS


class ReleaseRow(NamedTuple):
    """A published release; `manifest_hash` is SHA-256 (hex) of its manifest."""

    study: str
    version: int
    manifest_hash: str
    released_ms: int


def latest_release(conn: sqlite3.Connection, study: str) -> dict[str, Any] | None:
    """Return the row of a study's newest release, None before the first."""
    sql = "SELECT * FROM releases WHERE study = ? ORDER BY version DESC, released_ms DESC LIMIT 1"
    found = rows(conn, sql, study)
    return found[0] if found else None


def note_release(conn: sqlite3.Connection, release: ReleaseRow) -> None:
    """Keep a release that was just published; sqlite3.IntegrityError when it is kept already."""
    conn.execute("INSERT INTO releases VALUES (?, ?, ?, ?, NULL)", release)


def note_imported_release(conn: sqlite3.Connection, release: ReleaseRow) -> None:
    """Keep a release that came from elsewhere; a second time changes nothing."""
    conn.execute("INSERT OR IGNORE INTO releases VALUES (?, ?, ?, ?, NULL)", release)


def noted_looks(conn: sqlite3.Connection, study: str) -> list[dict[str, Any]]:
    """Return the looks that an imported release says were taken at a study's figures; empty otherwise."""
    found = rows(conn, "SELECT value FROM meta WHERE name = ?", f"{LOOKS}|{study}")
    return list(json.loads(found[0]["value"])) if found else []


def note_looks(conn: sqlite3.Connection, study: str, looks: Sequence[dict[str, Any]]) -> None:
    """Keep the looks of an imported release, beside those that are kept already."""
    kept = noted_looks(conn, study)
    found = [*kept, *(look for look in looks if look not in kept)]
    if found:
        conn.execute(
            "INSERT OR REPLACE INTO meta VALUES (?, ?)",
            (f"{LOOKS}|{study}", json.dumps(found, ensure_ascii=False)),
        )


def mark_outdated_releases(
    conn: sqlite3.Connection, study: str, joined_ms: int, now_ms: int
) -> tuple[int, ...]:
    """Mark the releases made since `joined_ms` as outdated and return their versions: a participant of theirs is erased."""
    where, values = "study = ? AND released_ms >= ?", (study, joined_ms)
    found = [
        row[0]
        for row in conn.execute(
            f"SELECT version FROM releases WHERE {where} ORDER BY version", values
        )
    ]
    conn.execute(
        f"UPDATE releases SET outdated_ms = ? WHERE outdated_ms IS NULL AND {where}",
        (now_ms, *values),
    )
    return tuple(found)
