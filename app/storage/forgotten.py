"""The list of the forgotten: hashes of erased people and episodes, which stop a merge or an import from bringing them back.

The table `forgotten` holds an episode's trajectory at its time; `forgotten_people` holds a participant's id and, under any
pseudonym, the time when they came.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Mapping
from typing import Any

from app.storage.database import rows

FORGOTTEN_TABLES = ("forgotten", "forgotten_people")
ERASED = "erased"
"""Rows of the table `meta` called `erased|STUDY|HASH` count the people who were erased from each study; the value is when."""

ARRIVALS = "arrivals"
"""A row of `meta` called `arrivals|STUDY` counts the people whom a release of that study left out; the value is JSON."""

TRAJECTORY = "e.trajectory_hash, e.started_ms, e.ended_ms"
"""The arguments of `trajectory_hash`, as SQL columns of an episode `e`."""


def learn_forgotten(target: sqlite3.Connection, source: sqlite3.Connection) -> None:
    """Add the source's list of the forgotten to the target's, and the studies that they were erased from."""
    learn_counts(target, source)
    for table in FORGOTTEN_TABLES:
        target.executemany(
            f"INSERT OR IGNORE INTO {table} VALUES (?, ?)",
            source.execute(f"SELECT * FROM {table}").fetchall(),
        )


def learn_counts(target: sqlite3.Connection, source: sqlite3.Connection) -> None:
    """Add the source's counts of people who were erased, or left out of a release to the target's."""
    for name in (ERASED, ARRIVALS):
        found = source.execute("SELECT * FROM meta WHERE name LIKE ? || '|%'", [name]).fetchall()
        target.executemany("INSERT OR IGNORE INTO meta VALUES (?, ?)", found)


def note_erased(conn: sqlite3.Connection, person: Mapping[str, Any], at_ms: int) -> None:
    """Note that a participant's rows were erased from a study, without anything that leads to the person."""
    name = f"{ERASED}|{person['study']}|{person_hashes(person)[0]}"
    conn.execute("INSERT OR IGNORE INTO meta VALUES (?, ?)", (name, str(at_ms)))


def person_hashes(person: Mapping[str, Any]) -> tuple[str, str]:
    """Return what `forgotten_people` keeps of a participant's row: a hash of the id, and one of the times when they came."""
    came = f"{person['study']}|{person['joined_ms']}|{person['consent_ms']}"
    return _hash(person["id"]), _hash(came)


def invitation_hash(study: str, invitation: str) -> str:
    """Return what `forgotten_people` keeps of the invitation that a person had used: it lets nobody in again."""
    return _hash(f"invitation|{study}|{invitation}")


def trajectory_hash(trajectory: str, started_ms: int, ended_ms: int) -> str:
    """Return what `forgotten` keeps of an episode: its trajectory at its time, since two people may drive alike."""
    return _hash(f"{trajectory}|{started_ms}|{ended_ms}")


def forgotten_people(
    target: sqlite3.Connection, source: sqlite3.Connection
) -> list[dict[str, Any]]:
    """Return the source's participants whom the target has forgotten, whatever they are called there."""
    people = {row[0] for row in target.execute("SELECT id_hash FROM forgotten_people")}
    trajectories = {row[0] for row in target.execute("SELECT trajectory_hash FROM forgotten")}
    if not people | trajectories:
        return []
    played = f"""SELECT s.participant_id, {TRAJECTORY} FROM episodes e JOIN study_episodes s ON s.episode_id = e.id
        WHERE e.ended_ms IS NOT NULL"""
    known = {row[0] for row in source.execute(played) if trajectory_hash(*row[1:]) in trajectories}
    found = rows(source, "SELECT * FROM participants")
    return [
        person for person in found if person["id"] in known or people & set(person_hashes(person))
    ]


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
