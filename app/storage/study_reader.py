"""Studies as the database holds them, for reports, releases, the leaderboard and the operator; nothing of identities.

Every function takes an open reader.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from app.storage.erasure import ARRIVALS, ERASED
from app.storage.reader import JOINED, TRIAL, Reader
from app.storage.study_rows import Participant, StageEventRow, StudyRow
from app.storage.trial import Trial

Row = dict[str, Any]

STUDY_TRIAL = f"{TRIAL}, x.participant_id AS participant, p.kind, x.phase, x.trial, x.terrain AS terrain_index"
"""What `Trial.of` takes of a study's episode (SQL)."""
STUDY_JOINED = f"""FROM study_episodes x JOIN participants p ON p.id = x.participant_id JOIN episodes e ON e.id = x.episode_id
    {JOINED}"""
_ACTIVITY = f"""SELECT {STUDY_TRIAL}, (SELECT max(server_ms) FROM steps WHERE episode_id = e.id) AS moved_ms {STUDY_JOINED}
    WHERE p.study = ?"""
_EVENT_SUMMARY = """SELECT v.participant_id, max(v.at_ms) AS last_ms, sum(v.kind = 'deviation') AS deviations
    FROM stage_events v JOIN participants p ON p.id = v.participant_id WHERE p.study = ? GROUP BY v.participant_id"""
_WITHDRAWALS = """SELECT v.* FROM stage_events v JOIN participants p ON p.id = v.participant_id
    WHERE p.study = ? AND v.kind = 'withdrawn'"""
_CLOSED = "SELECT * FROM studies WHERE closed_ms IS NOT NULL AND secret IS NOT NULL ORDER BY closed_ms DESC"


def find_study(reader: Reader, name: str) -> StudyRow | None:
    """Return a study; None when nobody has joined one of this name."""
    found = reader.query("SELECT * FROM studies WHERE name = ?", [name])
    return StudyRow(**found[0]) if found else None


def study_names(reader: Reader) -> list[str]:
    """Return the names of all studies that somebody has joined, sorted."""
    return [row["name"] for row in reader.query("SELECT name FROM studies ORDER BY name")]


def closed_studies(reader: Reader) -> list[StudyRow]:
    """Return the studies that are closed and whose secret is known, the latest first."""
    return [StudyRow(**row) for row in reader.query(_CLOSED)]


def participants(reader: Reader, study: str) -> list[Participant]:
    """Return a study's participants in the order of joining."""
    sql = "SELECT * FROM participants WHERE study = ? ORDER BY joined_ms, id"
    return [Participant(**row) for row in reader.query(sql, [study])]


def count_participants(reader: Reader, study: str) -> int:
    """Return how many people and scripts have joined a study."""
    return int(
        reader.query("SELECT count(*) AS n FROM participants WHERE study = ?", [study])[0]["n"]
    )


def count_erased(reader: Reader, study: str) -> int:
    """Return how many people had their rows erased from a study (`app.storage.erasure.note_erased`)."""
    sql = "SELECT count(*) AS n FROM meta WHERE name LIKE ? || '|' || ? || '|%'"
    return int(reader.query(sql, [ERASED, study])[0]["n"])


def noted_arrivals(reader: Reader, study: str) -> dict[str, Any]:
    """Return the counts of people whom a release left out, in a database that was imported from one; empty otherwise."""
    found = reader.query("SELECT value FROM meta WHERE name = ?", [f"{ARRIVALS}|{study}"])
    return dict(json.loads(found[0]["value"])) if found else {}


def stage_events(reader: Reader, study: str, kinds: Sequence[str] = ()) -> list[StageEventRow]:
    """Return the stage events of all participants of a study, each participant's in order; those of some kinds, or all."""
    sql = "SELECT v.* FROM stage_events v JOIN participants p ON p.id = v.participant_id WHERE p.study = ?"
    wanted = f" AND v.kind IN ({', '.join('?' * len(kinds))})" if kinds else ""
    return [
        StageEventRow(**row)
        for row in reader.query(f"{sql}{wanted} ORDER BY v.number", [study, *kinds])
    ]


def study_trials(reader: Reader, study: str) -> list[Trial]:
    """Return a study's episodes, finished or running, oldest first."""
    sql = f"SELECT {STUDY_TRIAL} {STUDY_JOINED} WHERE p.study = ? ORDER BY e.started_ms, e.id"
    return [Trial.of(row) for row in reader.query(sql, [study])]


def move_inputs(reader: Reader, episode_id: str) -> list[Row]:
    """Return `input`, `server_ms` and `discovered` (cells known after it) of an episode's moves in order."""
    return reader.query(
        "SELECT input, server_ms, discovered FROM steps WHERE episode_id = ? ORDER BY step",
        [episode_id],
    )


def trial_activity(reader: Reader, study: str) -> list[Trial]:
    """Return every trial of a study with the time of its newest move."""
    return [Trial.of(row) for row in reader.query(_ACTIVITY, [study])]


def event_summaries(reader: Reader, study: str) -> dict[str, Row]:
    """Return per participant with stage events the time of the last one (`last_ms`) and the number of `deviations`."""
    return {row["participant_id"]: row for row in reader.query(_EVENT_SUMMARY, [study])}


def withdrawals(reader: Reader, study: str) -> list[StageEventRow]:
    """Return the stage events by which participants of a study withdrew."""
    return [StageEventRow(**row) for row in reader.query(_WITHDRAWALS, [study])]
