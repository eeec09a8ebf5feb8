"""Stored rows checked against what they follow from: an episode against its simulation, every row against its digest.

`app.study.verification` puts these checks together with those of the study's protocol.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from typing import Any, NamedTuple

from app.storage import digests
from app.storage.connection import rows
from app.storage.resimulation import Finding, differences
from app.storage.study_rows import ORDER_EVENT, StudyRow

_DIGEST_OWNERS = {
    "episode": "SELECT id FROM episodes WHERE ended_ms IS NOT NULL",
    "events": "SELECT episode_id FROM input_events",
    "participant": "SELECT id FROM participants",
}
"""Kind of digest -> the ids that may have one."""

_WITHOUT_OWNER = {
    "steps": "episode_id NOT IN (SELECT id FROM episodes)",
    "input_events": "episode_id NOT IN (SELECT id FROM episodes)",
    "study_episodes": "episode_id NOT IN (SELECT id FROM episodes) OR participant_id NOT IN (SELECT id FROM participants)",
    "stage_events": "participant_id NOT IN (SELECT id FROM participants)",
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
    return [row[0] for row in conn.execute("SELECT id FROM participants WHERE study = ? ORDER BY joined_ms", [study])]


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
    (count,) = conn.execute(f"SELECT count(*) FROM episodes WHERE ended_ms IS NULL{_within(study)}").fetchone()
    return int(count)


def check_episode(conn: sqlite3.Connection, ident: str) -> tuple[int, list[Finding]]:
    """Return the moves of a finished episode and what is wrong with it."""
    row = rows(conn, "SELECT * FROM episodes WHERE id = ?", ident)[0]
    steps = rows(conn, "SELECT * FROM steps WHERE episode_id = ? ORDER BY step", ident)
    return len(steps), [*differences(row, steps), *_compare(conn, "episode", ident, digests.compute(conn, "episode", ident))]


def check_input_events(conn: sqlite3.Connection, study: str | None) -> Iterator[Finding]:
    """Yield the episodes whose input events are not those of their digest."""
    sql = f"SELECT DISTINCT episode_id FROM input_events WHERE 1{_within(study, 'episode_id')}"
    for (ident,) in conn.execute(sql).fetchall():
        yield from _compare(conn, "events", ident, digests.compute_events(conn, ident))


def check_participants(conn: sqlite3.Connection, study: str | None) -> Iterator[Finding]:
    """Yield the participants whose rows are not those of their digest."""
    for (ident,) in conn.execute("SELECT id FROM participants WHERE ? IS NULL OR study = ?", (study, study)).fetchall():
        yield from _compare(conn, "participant", ident, digests.compute(conn, "participant", ident))


def check_owners(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield digests of what is no longer there, and rows that belong to nothing."""
    for kind, owners in _DIGEST_OWNERS.items():
        sql = f"SELECT id FROM digests WHERE kind = ? AND id NOT IN ({owners})"
        for (ident,) in conn.execute(sql, [kind]).fetchall():
            yield Finding(
                _place(kind, ident), f"a digest of kind {kind}", "kept", "nothing it belongs to (deleted or opened again)"
            )
    for table, condition in _WITHOUT_OWNER.items():
        for (count,) in conn.execute(f"SELECT count(*) FROM {table} WHERE {condition}").fetchall():
            if count:
                yield Finding(f"table {table}", "rows", count, "no episode or participant that they belong to")


def _compare(conn: sqlite3.Connection, kind: digests.DigestKind, ident: str, found: str) -> Iterator[Finding]:
    stored = digests.read(conn, kind, ident)
    if stored != found:
        what = "digest of its input events" if kind == "events" else "digest of its stored fields"
        yield Finding(_place(kind, ident), what, stored or "missing", found)


def _place(kind: str, ident: Any) -> str:
    return f"{'participant' if kind == 'participant' else 'episode'} {ident}"


def _within(study: str | None, column: str = "id") -> str:
    """Return SQL that keeps a study's episodes; the name has been looked up, it cannot be anything else."""
    if study is None:
        return ""
    inner = "SELECT s.episode_id FROM study_episodes s JOIN participants p ON p.id = s.participant_id"
    return f" AND {column} IN ({inner} WHERE p.study = '{study.replace(chr(39), chr(39) * 2)}')"
