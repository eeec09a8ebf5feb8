"""Which releases of a study were published: the table `releases`."""

from __future__ import annotations

import sqlite3
from typing import NamedTuple

from humanplay.db.chain import append_marks
from humanplay.db.database import rows


class ReleaseRow(NamedTuple):
    """A published release.

    Attributes:
        manifest_hash: SHA-256 (hex) of its manifest.
        outdated_ms: Since when it holds somebody who was erased; None while it does not.
    """

    study: str
    version: int
    manifest_hash: str
    released_ms: int
    outdated_ms: int | None = None


def latest_release(conn: sqlite3.Connection, study: str) -> ReleaseRow | None:
    """A study's newest release; None before the first."""
    sql = "SELECT * FROM releases WHERE study = ? ORDER BY version DESC, released_ms DESC LIMIT 1"
    return next((ReleaseRow(**row) for row in rows(conn, sql, study)), None)


def note_release(conn: sqlite3.Connection, release: ReleaseRow) -> None:
    """Record a release that was just published.

    Raises:
        sqlite3.IntegrityError: If it is recorded already.
    """
    conn.execute("INSERT INTO releases VALUES (?, ?, ?, ?, ?)", release)
    append_marks(conn)


def note_imported_release(conn: sqlite3.Connection, release: ReleaseRow) -> None:
    """Record a release that came from elsewhere; a second time changes nothing."""
    conn.execute("INSERT OR IGNORE INTO releases VALUES (?, ?, ?, ?, ?)", release)
    append_marks(conn)


def mark_outdated_releases(
    conn: sqlite3.Connection, study: str, joined_ms: int, now_ms: int
) -> tuple[int, ...]:
    """Mark the releases that hold an erased participant as outdated.

    Args:
        joined_ms: When the participant joined: releases made since then hold them.

    Returns:
        Their versions.
    """
    condition, values = "study = ? AND released_ms >= ?", (study, joined_ms)
    sql = f"SELECT version FROM releases WHERE {condition} ORDER BY version"
    versions = tuple(version for (version,) in conn.execute(sql, values))
    sql = f"UPDATE releases SET outdated_ms = ? WHERE outdated_ms IS NULL AND {condition}"
    conn.execute(sql, (now_ms, *values))
    return versions
