"""Which releases of a study were published, as the table `releases` holds them."""

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
    """Return a study's newest release, None before the first."""
    sql = "SELECT * FROM releases WHERE study = ? ORDER BY version DESC, released_ms DESC LIMIT 1"
    return next((ReleaseRow(**row) for row in rows(conn, sql, study)), None)


def note_release(conn: sqlite3.Connection, release: ReleaseRow) -> None:
    """Keep a release that was just published; sqlite3.IntegrityError when it is kept already."""
    conn.execute("INSERT INTO releases VALUES (?, ?, ?, ?, ?)", release)
    append_marks(conn)


def note_imported_release(conn: sqlite3.Connection, release: ReleaseRow) -> None:
    """Keep a release that came from elsewhere; a second time changes nothing."""
    conn.execute("INSERT OR IGNORE INTO releases VALUES (?, ?, ?, ?, ?)", release)
    append_marks(conn)


def mark_outdated_releases(
    conn: sqlite3.Connection, study: str, joined_ms: int, now_ms: int
) -> tuple[int, ...]:
    """Mark the releases made since `joined_ms` as outdated and return their versions: a participant
    of theirs is erased."""
    where, values = "study = ? AND released_ms >= ?", (study, joined_ms)
    sql = f"SELECT version FROM releases WHERE {where} ORDER BY version"
    found = tuple(version for (version,) in conn.execute(sql, values))
    sql = f"UPDATE releases SET outdated_ms = ? WHERE outdated_ms IS NULL AND {where}"
    conn.execute(sql, (now_ms, *values))
    return found
