"""The chain as schema 5 begins it: its tables, and an entry of everything that is there when a database is upgraded.

It belongs to a released migration, so it never changes and calls no code outside this module; `app.storage.chain` goes on
with what it made. Where a digest of schema 4 did not fit its rows, the entry keeps that: its version is 0 and its hash is the
stored digest.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import sqlite3
import time
from collections.abc import Mapping
from typing import Any

_TABLES = (
    # salted hashes, one after the other: see app/storage/chain.py
    """CREATE TABLE chain (
        number INTEGER PRIMARY KEY,
        day_ms INTEGER NOT NULL,
        kind TEXT NOT NULL CHECK (kind IN ('study', 'session', 'episode', 'events', 'participant', 'forgotten', 'merged')),
        version INTEGER NOT NULL, -- of the columns covered; 0: found not to fit its rows
        replaces INTEGER, -- the number of the entry of the same thing before it
        hash TEXT NOT NULL,
        note TEXT, -- of kinds forgotten and merged
        head TEXT NOT NULL) STRICT""",
    # what the latest entries stand for, with their salts and salted hashes by table; gone once somebody is forgotten
    """CREATE TABLE chain_salts (
        kind TEXT NOT NULL,
        id TEXT NOT NULL,
        first INTEGER NOT NULL DEFAULT 0, -- of kind events: the number of the first event
        number INTEGER NOT NULL UNIQUE,
        salt BLOB NOT NULL,
        parts TEXT NOT NULL,
        PRIMARY KEY (kind, id, first)) STRICT, WITHOUT ROWID""",
)
_OWNERS = {
    "episode": "SELECT id FROM episodes WHERE ended_ms IS NOT NULL ORDER BY id",
    "participant": "SELECT id FROM participants ORDER BY id",
    "session": """SELECT DISTINCT session_id FROM episodes e WHERE EXISTS (SELECT 1 FROM steps WHERE episode_id = e.id)
        ORDER BY session_id""",
    "study": "SELECT name FROM studies ORDER BY name",
}
_PARTS = {
    "study": {
        "studies": (
            "name, protocol, protocol_hash, commitment, frozen_ms, closed_ms, secret",
            "name = ?1",
        ),
    },
    "session": {
        "sessions": (
            "id, player_id, owner_id, driver_name, rival_of, created_ms, control",
            "id = ?1",
        ),
        "players": (
            "id, created_ms",
            "id IN (SELECT player_id FROM sessions WHERE id = ?1 UNION SELECT owner_id FROM sessions WHERE id = ?1) "
            "ORDER BY id",
        ),
    },
    "episode": {
        "episodes": (
            "id, session_id, number, level, config, config_hash, seed, seed_chosen, terrain, terrain_hash, terrain_met_before, "
            "start_row, start_col, policy_seed, core_version, driver, assisted, started_ms, ended_ms, outcome, steps, "
            "discovered, total, score, trajectory_hash, attestation, attestation_reason",
            "id = ?1",
        ),
        "steps": (
            "step, action, reward, discovered, server_ms, client_ms, key_down_ms, key_up_ms, input, driver",
            "episode_id = ?1 ORDER BY step",
        ),
        "study_episodes": ("participant_id, phase, trial, terrain", "episode_id = ?1"),
        "input_events": (
            "number, kind, code, repeat, trusted, client_ms, step, round_trip_ms, server_ms",
            "episode_id = ?1 ORDER BY number",
        ),
    },
    "participant": {
        "participants": (
            "id, study, player_id, session_id, kind, script, stage, consent_version, consent_ms, joined_ms, completed_ms, "
            "completion_code, settings, invitation, supervised_ms",
            "id = ?1",
        ),
        "stage_events": ("number, at_ms, kind, detail", "participant_id = ?1 ORDER BY number"),
        "identities": ("name, value", "participant_id = ?1 ORDER BY name"),
        "players": ("id, created_ms", "id = (SELECT player_id FROM participants WHERE id = ?1)"),
    },
}
_DAY_MS = 86_400_000


def begin_chain(conn: sqlite3.Connection, unsound: Mapping[tuple[str, str], str]) -> None:
    """Make the tables and an entry of everything that is there; what is in `unsound` ((kind, id) -> digest) stays so."""
    for statement in _TABLES:
        conn.execute(statement)
    found = {
        (kind, ident) for kind, sql in _OWNERS.items() for (ident,) in conn.execute(sql).fetchall()
    }
    head = ""
    for number, (kind, ident) in enumerate(sorted(found | set(unsound)), 1):
        salt = secrets.token_bytes(32)
        parts = {} if (kind, ident) in unsound else _parts(conn, kind, ident, salt)
        hash_ = unsound.get((kind, ident)) or _sha256(list(parts.items()))
        now = time.time_ns() // 1_000_000
        entry = (number, now - now % _DAY_MS, kind, 1 if parts else 0, None, hash_, None)
        head = _sha256([head, *entry])
        conn.execute("INSERT INTO chain VALUES (?, ?, ?, ?, ?, ?, ?, ?)", (*entry, head))
        values = (kind, ident, number, salt, _line(parts).decode().rstrip())
        conn.execute(
            "INSERT INTO chain_salts (kind, id, number, salt, parts) VALUES (?, ?, ?, ?, ?)", values
        )


def _parts(conn: sqlite3.Connection, kind: str, ident: str, salt: bytes) -> dict[str, str]:
    parts = {}
    for table, (columns, where) in _PARTS[kind].items():
        made = hashlib.sha256(salt + _line([table, columns]))
        for row in conn.execute(f"SELECT {columns} FROM {table} WHERE {where}", [ident]):
            made.update(_line(row))
        parts[table] = made.hexdigest()
    return parts


def _sha256(value: Any) -> str:
    return hashlib.sha256(_line(value)).hexdigest()


def _line(value: Any) -> bytes:
    return json.dumps(value, default=bytes.hex, separators=(",", ":")).encode() + b"\n"
