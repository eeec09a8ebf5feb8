"""What stored rows hash to: kept beside them, so that a change to any field shows although nothing simulates it.

A digest is SHA-256 (hex) over every column of the rows, by name, in canonical JSON. There are three kinds, in the table
`digests`: `episode` (its row, steps and place in a study, made in the transaction that closes it), `events` (a chain over
an episode's input events, made longer with each batch) and `participant` (the row and its stage events, made anew with
each change). A migration that changes one of these tables calls `renew`.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from typing import Any, Literal

Kind = Literal["episode", "events", "participant"]

_ROWS: dict[str, tuple[tuple[str, str], ...]] = {
    "episode": (
        ("episodes", "id = ?"),
        ("steps", "episode_id = ? ORDER BY step"),
        ("study_episodes", "episode_id = ?"),
    ),
    "participant": (
        ("participants", "id = ?"),
        ("stage_events", "participant_id = ? ORDER BY number"),
    ),
}
_KEEP = "INSERT INTO digests VALUES (?, ?, ?) ON CONFLICT (kind, id) DO UPDATE SET digest = excluded.digest"


def of_rows(conn: sqlite3.Connection, kind: Literal["episode", "participant"], ident: str) -> str:
    """Return the digest of an episode or a participant as its rows stand."""
    found = hashlib.sha256()
    for table, where in _ROWS[kind]:
        cursor = _select(conn, f"SELECT * FROM {table} WHERE {where}", ident)
        found.update(_canonical([table, [column[0] for column in cursor.description]]))
        for row in cursor:
            found.update(_canonical(row))
    return found.hexdigest()


def of_events(conn: sqlite3.Connection, episode_id: str, after: str = "", first: int = 0) -> str:
    """Return the chain over an episode's input events from number `first` on, as it goes on from `after`."""
    sql = "SELECT * FROM input_events WHERE episode_id = ? AND number >= ? ORDER BY number"
    for row in _select(conn, sql, episode_id, first):
        after = hashlib.sha256(after.encode() + _canonical(row)).hexdigest()
    return after


def kept(conn: sqlite3.Connection, kind: Kind, ident: str) -> str | None:
    """Return the digest that was kept, None when there is none."""
    found = _select(conn, "SELECT digest FROM digests WHERE kind = ? AND id = ?", kind, ident).fetchone()
    return None if found is None else str(found[0])


def seal(conn: sqlite3.Connection, kind: Literal["episode", "participant"], ident: str) -> None:
    """Return with the digest of an episode or a participant kept; call it inside the transaction that wrote the rows."""
    conn.execute(_KEEP, (kind, ident, of_rows(conn, kind, ident)))


def extend_events(conn: sqlite3.Connection, episode_id: str, first: int) -> None:
    """Return with the chain gone on over the input events from number `first`; call it in the transaction that wrote them."""
    after = kept(conn, "events", episode_id) or ""
    conn.execute(_KEEP, ("events", episode_id, of_events(conn, episode_id, after, first)))


def renew(conn: sqlite3.Connection) -> None:
    """Return with every digest made from the rows as they stand: for migrations and for rows written afresh."""
    conn.execute("DELETE FROM digests")
    for (ident,) in _select(conn, "SELECT id FROM episodes WHERE ended_ms IS NOT NULL").fetchall():
        seal(conn, "episode", ident)
    for (ident,) in _select(conn, "SELECT DISTINCT episode_id FROM input_events").fetchall():
        extend_events(conn, ident, 0)
    for (ident,) in _select(conn, "SELECT id FROM participants").fetchall():
        seal(conn, "participant", ident)


def _select(conn: sqlite3.Connection, sql: str, *values: Any) -> sqlite3.Cursor:
    cursor = conn.cursor()
    cursor.row_factory = None
    return cursor.execute(sql, values)


_encode = json.JSONEncoder(default=bytes.hex, separators=(",", ":")).encode


def _canonical(value: Any) -> bytes:
    return _encode(value).encode() + b"\n"
