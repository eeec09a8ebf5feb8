"""Stored rows checked against what they follow from: an episode against its simulation, every row against the chain, and the
file by SQLite itself.

`app.study.verification` puts these checks together with those of the study's protocol.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from app.storage import chain
from app.storage.chain import Kind
from app.storage.chain_checks import check_thing, check_without_owner
from app.storage.connection import reading, rows
from app.storage.database import StoreError, check_writable, transaction
from app.storage.reader import Reader
from app.storage.resimulation import Finding, differences
from app.storage.study_rows import ORDER_EVENT, StudyRow

_MAY_HAVE_ENTRY: dict[Kind, str] = {
    "study": "SELECT name FROM studies",
    "session": "SELECT id FROM sessions",
    "episode": "SELECT id FROM episodes WHERE ended_ms IS NOT NULL",
    "participant": "SELECT id FROM participants",
}
"""Kind of entry in the chain -> the ids (SQL) that may have one."""

_MOVED_SESSIONS = """SELECT DISTINCT e.session_id FROM episodes e
    WHERE EXISTS (SELECT 1 FROM steps WHERE episode_id = e.id){within} ORDER BY e.session_id"""

_WITHOUT_OWNER = {
    "steps": "episode_id NOT IN (SELECT id FROM episodes)",
    "input_events": "episode_id NOT IN (SELECT id FROM episodes)",
    "event_batches": "episode_id NOT IN (SELECT id FROM episodes)",
    "study_episodes": "episode_id NOT IN (SELECT id FROM episodes) OR participant_id NOT IN (SELECT id FROM participants)",
    "daily_attempts": "episode_id NOT IN (SELECT id FROM episodes) OR player_id NOT IN (SELECT id FROM players) "
    "OR commitment NOT IN (SELECT commitment FROM daily_terrains)",
    "stage_events": "participant_id NOT IN (SELECT id FROM participants)",
    "identities": "participant_id NOT IN (SELECT id FROM participants)",
    "participants": "study NOT IN (SELECT name FROM studies) OR player_id NOT IN (SELECT id FROM players) "
    "OR session_id NOT IN (SELECT id FROM sessions)",
    "episodes": "session_id NOT IN (SELECT id FROM sessions)",
    "sessions": "player_id NOT IN (SELECT id FROM players) OR owner_id NOT IN (SELECT id FROM players)",
}
"""Table -> the condition that a row of it belongs to nothing."""

_STUDY_EPISODES = """SELECT s.phase, s.trial, s.terrain, e.id, e.seed, e.config_hash, e.seed_chosen, e.assisted
    FROM study_episodes s JOIN episodes e ON e.id = s.episode_id WHERE s.participant_id = ? ORDER BY s.phase, s.trial"""


class StudyEpisodeRow(NamedTuple):
    """What a participant was given to play: its place in the study, and what fixes the episode."""

    phase: str
    trial: int
    terrain: int
    episode: str
    seed: int | None
    config_hash: str
    seed_chosen: int
    assisted: int


def studies(conn: sqlite3.Connection, only: str | None = None) -> list[StudyRow]:
    """Return every study, or (only) the one of this name."""
    sql = "SELECT * FROM studies WHERE ? IS NULL OR name = ?"
    return [StudyRow(*row) for row in conn.execute(sql, (only, only))]


def participants_of(conn: sqlite3.Connection, study: str) -> list[str]:
    """Return the ids of a study's participants in the order in which they joined."""
    return [
        row[0]
        for row in conn.execute(
            "SELECT id FROM participants WHERE study = ? ORDER BY joined_ms", [study]
        )
    ]


def episodes_of(conn: sqlite3.Connection, participant: str) -> list[StudyEpisodeRow]:
    """Return what a participant was given to play, by phase and trial."""
    return [StudyEpisodeRow(*row) for row in conn.execute(_STUDY_EPISODES, [participant])]


def order_events(conn: sqlite3.Connection, participant: str) -> tuple[str, list[str]]:
    """Return a participant's kind, and the details (JSON) of the events that fix their order of terrains: one at most."""
    (kind,) = conn.execute("SELECT kind FROM participants WHERE id = ?", [participant]).fetchone()
    sql = "SELECT detail FROM stage_events WHERE participant_id = ? AND kind = ?"
    return kind, [row[0] for row in conn.execute(sql, (participant, ORDER_EVENT))]


def finished_episodes(conn: sqlite3.Connection, study: str | None) -> list[str]:
    """Return the ids of finished episodes, of one study or (None) of all, oldest first."""
    sql = f"SELECT id FROM episodes WHERE ended_ms IS NOT NULL{_within(study)} ORDER BY started_ms, id"
    return [str(row[0]) for row in conn.execute(sql)]


def count_unfinished(conn: sqlite3.Connection, study: str | None) -> int:
    """Return how many episodes have not ended, of one study or (None) of all."""
    (count,) = conn.execute(
        f"SELECT count(*) FROM episodes WHERE ended_ms IS NULL{_within(study)}"
    ).fetchone()
    return int(count)


class PlayedEpisode(NamedTuple):
    """A finished episode's row, with `control` of its session, and its moves."""

    row: dict[str, Any]
    steps: list[dict[str, Any]]


class InputOf(NamedTuple):
    """What the attestation of an episode follows from, besides its row and moves.

    events         input events that were received up to its end
    settings       (when, JSON) of what its participant had chosen, every version
    supervised_ms  when the operator's code was typed for its participant
    is_studys      whether a participant of a study played it
    """

    events: list[dict[str, Any]]
    settings: list[tuple[int, str]]
    supervised_ms: list[int]
    is_studys: bool


def check_episode(conn: sqlite3.Connection, ident: str) -> tuple[PlayedEpisode, list[Finding]]:
    """Return a finished episode and what is wrong with it."""
    row = rows(
        conn,
        "SELECT e.*, s.control FROM episodes e LEFT JOIN sessions s ON s.id = e.session_id WHERE e.id = ?",
        ident,
    )[0]
    steps = rows(conn, "SELECT * FROM steps WHERE episode_id = ? ORDER BY step", ident)
    return PlayedEpisode(row, steps), [
        *differences(row, steps),
        *check_thing(conn, "episode", ident),
    ]


def input_of(conn: sqlite3.Connection, ident: str) -> InputOf:
    """Return what the attestation of a finished episode follows from."""
    sql = """SELECT v.* FROM input_events v JOIN episodes e ON e.id = v.episode_id
        WHERE e.id = ? AND v.server_ms <= e.ended_ms ORDER BY v.number"""
    of = """SELECT v.at_ms, v.detail FROM stage_events v JOIN study_episodes t ON t.participant_id = v.participant_id
        WHERE t.episode_id = ? AND v.kind = ? ORDER BY v.number"""
    settings = [(row["at_ms"], row["detail"]) for row in rows(conn, of, ident, "settings")]
    supervised_ms = [row["at_ms"] for row in rows(conn, of, ident, "supervised")]
    is_studys = bool(rows(conn, "SELECT 1 FROM study_episodes WHERE episode_id = ?", ident))
    return InputOf(rows(conn, sql, ident), settings, supervised_ms, is_studys)


def check_entries(conn: sqlite3.Connection, study: str | None) -> Iterator[Finding]:
    """Yield the studies, sessions and participants whose rows are not those of their entries in the chain."""
    for row in studies(conn, study):
        yield from check_thing(conn, "study", row.name)
    for (ident,) in conn.execute(_MOVED_SESSIONS.format(within=_within(study, "e.id"))).fetchall():
        yield from check_thing(conn, "session", ident)
    for (ident,) in conn.execute(
        "SELECT id FROM participants WHERE ? IS NULL OR study = ?", (study, study)
    ).fetchall():
        yield from check_thing(conn, "participant", ident)


def check_owners(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield entries of the chain for what is no longer there, and rows that belong to nothing."""
    yield from check_without_owner(conn, _MAY_HAVE_ENTRY)
    for table, condition in _WITHOUT_OWNER.items():
        for (count,) in conn.execute(f"SELECT count(*) FROM {table} WHERE {condition}").fetchall():
            if count:
                yield Finding(
                    f"table {table}",
                    "rows",
                    count,
                    "no episode, participant, session, player or study that they belong to",
                )


def _within(study: str | None, column: str = "id") -> str:
    """Return SQL that keeps a study's episodes; the name has been looked up, it cannot be anything else."""
    if study is None:
        return ""
    inner = (
        "SELECT s.episode_id FROM study_episodes s JOIN participants p ON p.id = s.participant_id"
    )
    return f" AND {column} IN ({inner} WHERE p.study = '{study.replace(chr(39), chr(39) * 2)}')"


def quick_check(database: Path) -> str:
    """Return "ok", or what is damaged; reads the whole file, which takes milliseconds to minutes."""
    try:
        with closing(Reader.open(database)) as reader:
            rows = reader.query("PRAGMA quick_check(5)")
    except (StoreError, sqlite3.DatabaseError) as error:
        return str(error)
    return "; ".join(str(next(iter(row.values()))) for row in rows)


def try_write(database: Path, timeout_s: float = 1.0) -> None:
    """Write a row of the table `meta` and commit it, on a connection of its own; StoreError when that fails.

    timeout_s  seconds to wait for another program that is writing. Call it in a thread: the disk may take as long as it likes.
    """
    try:
        check_writable(database)
        # mode=rw: a file that was just deleted is not made again, as an empty one
        uri = database.resolve().as_uri() + "?mode=rw"
        with (
            closing(sqlite3.connect(uri, timeout_s, isolation_level=None, uri=True)) as conn,
            transaction(conn),
        ):
            conn.execute(
                "INSERT OR REPLACE INTO meta VALUES ('written_ms', ?)",
                [str(time.time_ns() // 1_000_000)],
            )
    except (sqlite3.Error, OSError) as error:
        raise StoreError(f"the database {database} did not take a write: {error}") from error


def chain_head(database: Path) -> chain.Head | None:
    """Return the end of the chain of a database that a server may be writing; None when it cannot be read."""
    try:
        with reading(database) as conn:
            return chain.head(conn)
    except (StoreError, sqlite3.DatabaseError):
        return None
