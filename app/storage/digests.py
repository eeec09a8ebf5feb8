"""SHA-256 digests of stored rows: kept beside them, so that a change to any field shows although nothing simulates it.

A digest is SHA-256 (hex) over every column of the rows, by name, in canonical JSON. There are three kinds, in the table
`digests`: `episode` (its row, steps and place in a study, written in the transaction that closes it), `events` (a chain over
an episode's input events, extended with each batch) and `participant` (the row and its stage events, written anew with
each change). A migration that changes one of these tables writes all digests anew with code of its own.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from typing import Any, Literal

DigestKind = Literal["episode", "events", "participant"]

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
_WRITE = "INSERT INTO digests VALUES (?, ?, ?) ON CONFLICT (kind, id) DO UPDATE SET digest = excluded.digest"


def compute(conn: sqlite3.Connection, kind: Literal["episode", "participant"], ident: str) -> str:
    """Return the digest of an episode or a participant as its rows are now."""
    found = hashlib.sha256()
    for table, where in _ROWS[kind]:
        cursor = _select(conn, f"SELECT * FROM {table} WHERE {where}", ident)
        found.update(_canonical([table, [column[0] for column in cursor.description]]))
        for row in cursor:
            found.update(_canonical(row))
    return found.hexdigest()


def compute_events(conn: sqlite3.Connection, episode_id: str, after: str = "", first: int = 0) -> str:
    """Return the chain over an episode's input events from number `first` on; `after` is the digest of those before."""
    sql = "SELECT * FROM input_events WHERE episode_id = ? AND number >= ? ORDER BY number"
    for row in _select(conn, sql, episode_id, first):
        after = hashlib.sha256(after.encode() + _canonical(row)).hexdigest()
    return after


def read(conn: sqlite3.Connection, kind: DigestKind, ident: str) -> str | None:
    """Return the stored digest, None when there is none."""
    found = _select(conn, "SELECT digest FROM digests WHERE kind = ? AND id = ?", kind, ident).fetchone()
    return None if found is None else str(found[0])


def write(conn: sqlite3.Connection, kind: Literal["episode", "participant"], ident: str) -> None:
    """Store the digest of an episode or a participant; call it inside the transaction that wrote the rows."""
    conn.execute(_WRITE, (kind, ident, compute(conn, kind, ident)))


def extend_events(conn: sqlite3.Connection, episode_id: str, first: int) -> None:
    """Extend the stored chain by the input events from number `first` on; call it in the transaction that wrote them."""
    after = read(conn, "events", episode_id) or ""
    conn.execute(_WRITE, ("events", episode_id, compute_events(conn, episode_id, after, first)))


def write_all(conn: sqlite3.Connection) -> None:
    """Replace every digest by one of the rows as they are now: for a database that was written anew."""
    conn.execute("DELETE FROM digests")
    for (ident,) in _select(conn, "SELECT id FROM episodes WHERE ended_ms IS NOT NULL").fetchall():
        write(conn, "episode", ident)
    for (ident,) in _select(conn, "SELECT DISTINCT episode_id FROM input_events").fetchall():
        extend_events(conn, ident, 0)
    for (ident,) in _select(conn, "SELECT id FROM participants").fetchall():
        write(conn, "participant", ident)


def _select(conn: sqlite3.Connection, sql: str, *values: Any) -> sqlite3.Cursor:
    cursor = conn.cursor()
    cursor.row_factory = None
    return cursor.execute(sql, values)


_encode = json.JSONEncoder(default=bytes.hex, separators=(",", ":")).encode


def _canonical(value: Any) -> bytes:
    return _encode(value).encode() + b"\n"
