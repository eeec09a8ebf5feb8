"""Rows of one database into another: new ones are added, equal ones let be, and two contents under one id refused."""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from app.release.errors import ReleaseError
from app.storage.connection import rows, stream

TABLES = (
    "players", "sessions", "episodes", "steps", "participants", "identities", "stage_events", "study_episodes",
    "input_events", "digests", "releases",
)  # fmt: skip
"""What is joined, besides `studies`; the key that signs cookies stays where it is."""

FORGOTTEN = ("forgotten", "forgotten_people")
CHUNK = 2_000
TRAJECTORY = "e.trajectory_hash, e.started_ms, e.ended_ms"
"""What `trajectory_hash` takes, in SQL."""


@dataclass
class Joined:
    """What a join came to: rows added and rows that were there already, by table; people left out as forgotten."""

    added: dict[str, int] = field(default_factory=dict)
    equal: dict[str, int] = field(default_factory=dict)
    forgotten: int = 0


def join(target: sqlite3.Connection, source: sqlite3.Connection, where: str) -> Joined:
    """Return what came of adding the source's rows to the target's; call it inside a transaction of the target.

    where  the source in words, for the error

    ReleaseError when both have something under one id and it is not the same. People whom either of the two has forgotten
    are left out; bring the lists of all sources into the target first (`learn_forgotten`).
    """
    joined = Joined()
    target.execute("PRAGMA defer_foreign_keys = ON")
    _join_studies(target, source, where)
    hidden = _hidden(target, source)
    joined.forgotten = len(hidden["participants"])
    for table in TABLES:
        added, equal = _join_table(target, source, table, hidden, where)
        joined.added[table], joined.equal[table] = added, equal
    return joined


def learn_forgotten(target: sqlite3.Connection, source: sqlite3.Connection) -> None:
    """Return with the target knowing whom the source has forgotten."""
    for table in FORGOTTEN:
        target.executemany(f"INSERT OR IGNORE INTO {table} VALUES (?, ?)", source.execute(f"SELECT * FROM {table}").fetchall())


def person_hashes(person: Mapping[str, Any]) -> tuple[str, str]:
    """Return what `forgotten_people` keeps of a participant's row: by the id, and by when they came, under any pseudonym."""
    came = f"{person['study']}|{person['joined_ms']}|{person['consent_ms']}"
    return _hash(person["id"]), _hash(came)


def trajectory_hash(trajectory: str, started_ms: int, ended_ms: int) -> str:
    """Return what `forgotten` keeps of an episode: its trajectory at its time, since two people may drive alike."""
    return _hash(f"{trajectory}|{started_ms}|{ended_ms}")


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def forgotten_people(target: sqlite3.Connection, source: sqlite3.Connection) -> list[dict[str, Any]]:
    """Return the source's participants whom the target has forgotten, whatever they are called there."""
    people = {row[0] for row in target.execute("SELECT id_hash FROM forgotten_people")}
    driven = {row[0] for row in target.execute("SELECT trajectory_hash FROM forgotten")}
    if not people | driven:
        return []
    played = f"""SELECT s.participant_id, {TRAJECTORY} FROM episodes e JOIN study_episodes s ON s.episode_id = e.id
        WHERE e.ended_ms IS NOT NULL"""
    known = {row[0] for row in source.execute(played) if trajectory_hash(*row[1:]) in driven}
    found = rows(source, "SELECT * FROM participants")
    return [person for person in found if person["id"] in known or people & set(person_hashes(person))]


def _hidden(target: sqlite3.Connection, source: sqlite3.Connection) -> dict[str, set[Any]]:
    """Return the source's ids that are not to be joined, by table."""
    people = forgotten_people(target, source)
    hidden: dict[str, set[Any]] = {"participants": {each["id"] for each in people}, "players": set(), "sessions": set()}
    for person in people:
        boards = "SELECT id FROM sessions WHERE ? IN (player_id, owner_id) OR id = ?"
        hidden["sessions"] |= {row[0] for row in source.execute(boards, (person["player_id"], person["session_id"]))}
        elsewhere = [
            row
            for row in source.execute("SELECT id, session_id FROM participants WHERE player_id = ?", [person["player_id"]])
            if row[0] not in hidden["participants"]
        ]
        hidden["sessions"] -= {row[1] for row in elsewhere}
        if not elsewhere:
            hidden["players"].add(person["player_id"])
    found = source.execute("SELECT id, session_id FROM episodes").fetchall() if hidden["sessions"] else []
    hidden["episodes"] = {ident for ident, session in found if session in hidden["sessions"]}
    return hidden


_OWNERS = {"id": None, "session_id": "sessions", "episode_id": "episodes", "participant_id": "participants"}


def _visible(table: str, found: Iterable[dict[str, Any]], hidden: dict[str, set[Any]]) -> Iterator[dict[str, Any]]:
    for row in found:
        if table == "digests":
            concealed = row["id"] in hidden["participants"] or row["id"] in hidden["episodes"]
        else:
            concealed = any(name in row and row[name] in hidden.get(owner or table, ()) for name, owner in _OWNERS.items())
        if not concealed:
            yield row


def _join_table(
    target: sqlite3.Connection, source: sqlite3.Connection, table: str, hidden: dict[str, set[Any]], where: str
) -> tuple[int, int]:
    columns = [row[1] for row in target.execute(f"PRAGMA table_info({table})")]
    insert = f"INSERT OR IGNORE INTO {table} ({','.join(columns)}) VALUES ({','.join('?' * len(columns))})"
    wanted = _visible(table, stream(source, f"SELECT * FROM {table}"), hidden)
    added = equal = 0
    while chunk := [tuple(row[name] for name in columns) for row in islice(wanted, CHUNK)]:
        count = target.executemany(insert, chunk).rowcount
        added += count
        if count < len(chunk):
            equal += len(chunk) - count
            _check_equal(target, table, columns, chunk, where)
    return added, equal


def _check_equal(target: sqlite3.Connection, table: str, columns: list[str], chunk: list[tuple[Any, ...]], where: str) -> None:
    """Return when every row of the chunk stands in the target exactly so; ReleaseError naming the first that does not."""
    match = " AND ".join(f"{name} IS ?" for name in columns)
    keys = [row[1] for row in target.execute(f"PRAGMA table_info({table})") if row[5]]
    for row in chunk:
        if target.execute(f"SELECT 1 FROM {table} WHERE {match}", row).fetchone() is None:
            named = ", ".join(f"{name} {value}" for name, value in zip(columns, row, strict=True) if name in keys)
            raise ReleaseError(
                f"the table {table} has {named} with another content in {where} than before: nothing was joined; one of the "
                "two was changed, or they are a copy and its original under other names"
            )


def _join_studies(target: sqlite3.Connection, source: sqlite3.Connection, where: str) -> None:
    for row in rows(source, "SELECT * FROM studies"):
        known = rows(target, "SELECT * FROM studies WHERE name = ?", row["name"])
        if not known:
            target.execute(f"INSERT INTO studies VALUES ({','.join('?' * len(row))})", list(row.values()))
            continue
        old = known[0]
        for name in ("protocol_hash", "commitment", "protocol", "frozen_ms"):
            if old[name] != row[name]:
                raise ReleaseError(
                    f"the study {row['name']!r} in {where} has another {name} than before: they are two studies of one name; "
                    "nothing was joined"
                )
        if old["secret"] is not None and row["secret"] not in (None, old["secret"]):
            raise ReleaseError(f"the study {row['name']!r} in {where} has another secret than before: nothing was joined")
        target.execute(
            "UPDATE studies SET closed_ms = coalesce(closed_ms, ?), secret = coalesce(secret, ?) WHERE name = ?",
            (row["closed_ms"], row["secret"], row["name"]),
        )
