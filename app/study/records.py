"""What the database keeps of studies: participants, their stages, trials and input events.

Works on the store's connection and in its transactions: `app.storage.store` stays the one writer. Whatever changes a
participant keeps the digest of the rows beside them (`app.storage.digests`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from app.play.messages import Events
from app.storage import digests
from app.storage.store import Store
from app.storage.study_rows import Participant, Phase, Stage, TrialRow
from app.study.folder import Study
from app.study.protocol import StudyError, canonical

MAX_EVENTS = 50_000
"""Most input events kept of an episode: some hours of typing."""


_TRIALS = """SELECT t.episode_id, t.phase, t.trial, t.terrain, e.ended_ms, e.outcome, e.steps, e.score
    FROM study_episodes t JOIN episodes e ON e.id = t.episode_id WHERE t.participant_id = ? ORDER BY e.number"""
_ADD_EVENT = """INSERT INTO stage_events SELECT ?1, coalesce(max(number) + 1, 0), ?2, ?3, ?4
    FROM stage_events WHERE participant_id = ?1"""
_NOTE_CLOSED = "UPDATE studies SET closed_ms = ?, secret = ? WHERE name = ? AND protocol_hash = ? AND closed_ms IS NULL"
_HIDES = """SELECT t.phase = 'ranked' AND p.stage NOT IN ('debrief', 'complete') FROM study_episodes t
    JOIN participants p ON p.id = t.participant_id WHERE t.episode_id = ?"""


_RUN = """SELECT kind, code, repeat, trusted, client_ms, step, round_trip_ms FROM input_events
    WHERE episode_id = ?1 AND number >= ?2 ORDER BY number LIMIT ?3"""


class Records:
    """The tables of studies in a store's database."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._conn = store.connection

    def note_study(self, study: Study) -> None:
        """Return with the study known to the database; StudyError when another one has its name there."""
        text = canonical(study.protocol).decode()
        values = (study.name, text, study.protocol_hash, study.commitment, study.frozen_ms)
        with self._store.transaction():
            self._conn.execute("INSERT OR IGNORE INTO studies VALUES (?, ?, ?, ?, ?, NULL, NULL)", values)
            sql = "SELECT protocol_hash, commitment FROM studies WHERE name = ?"
            known = tuple(self._conn.execute(sql, [study.name]).fetchone())
        if known != (study.protocol_hash, study.commitment):
            raise StudyError(
                f"{self._store.path} holds another study {study.name!r} (protocol hash {known[0][:12]}): "
                "serve this one on a database of its own, or give it another name"
            )

    def note_closed(self, study: Study) -> None:
        """Return with the end and the secret of a closed study noted, if anybody had joined it."""
        if study.is_open:
            return
        with self._store.transaction():
            self._conn.execute(_NOTE_CLOSED, (study.closed_ms, study.secret.hex(), study.name, study.protocol_hash))

    def was_closed(self, name: str) -> bool:
        """Return whether the database knows the study to be closed: its terrains are public then, whatever its files say."""
        found = self._conn.execute("SELECT 1 FROM studies WHERE name = ? AND closed_ms IS NOT NULL", [name]).fetchone()
        return found is not None

    def open_names(self) -> list[str]:
        """Return the names of studies that the database does not know to be closed."""
        return [row[0] for row in self._conn.execute("SELECT name FROM studies WHERE closed_ms IS NULL").fetchall()]

    def participant(self, study: str, player_id: str) -> Participant | None:
        """Return the participant with a player's cookie; None before joining."""
        return self._find("study = ? AND player_id = ?", study, player_id)

    def get(self, participant_id: str) -> Participant:
        """Return a participant as it stands."""
        found = self._find("id = ?", participant_id)
        assert found is not None
        return found

    def seated_at(self, session_id: str) -> Participant | None:
        """Return whose board a session is; None when it is no participant's."""
        return self._find("session_id = ?", session_id)

    def with_identity(self, study: str, name: str, value: str) -> str | None:
        """Return the player id of the participant who came with an outside id; None when nobody did."""
        sql = """SELECT p.player_id FROM identities i JOIN participants p ON p.id = i.participant_id
            WHERE i.name = ? AND i.value = ? AND p.study = ?"""
        found = self._conn.execute(sql, (name, value, study)).fetchone()
        return None if found is None else str(found[0])

    def identity(self, participant_id: str, name: str) -> str | None:
        """Return the outside id a participant came with."""
        sql = "SELECT value FROM identities WHERE participant_id = ? AND name = ?"
        found = self._conn.execute(sql, (participant_id, name)).fetchone()
        return None if found is None else str(found[0])

    def join(self, participant: Participant, identities: Mapping[str, str]) -> None:
        """Return with a new participant, and who they are elsewhere, kept."""
        with self._changing(participant.id):
            self._store.add_player(participant.player_id, participant.joined_ms)
            self._conn.execute(f"INSERT INTO participants VALUES ({', '.join('?' * 13)})", tuple(vars(participant).values()))
            for name, value in identities.items():
                self._conn.execute("INSERT INTO identities VALUES (?, ?, ?)", (participant.id, name, value))
            self._add(participant.id, participant.joined_ms, "joined", {"kind": participant.kind, "script": participant.script})

    def note(self, participant_id: str, at_ms: int, kind: str, detail: Mapping[str, Any]) -> None:
        """Return with an event of a participant's way kept."""
        with self._changing(participant_id):
            self._add(participant_id, at_ms, kind, detail)

    def advance(self, participant_id: str, at_ms: int, stage: Stage, **columns: Any) -> None:
        """Return with a participant at the stage, and further columns set."""
        with self._changing(participant_id):
            self._set(participant_id, {"stage": stage, **columns})
            self._add(participant_id, at_ms, "stage", {"stage": stage})

    def leave(self, participant: Participant, at_ms: int) -> None:
        """Return with a participant withdrawn; who never agreed leaves no outside id behind."""
        with self._changing(participant.id):
            if participant.consent_ms is None:
                self._conn.execute("DELETE FROM identities WHERE participant_id = ?", [participant.id])
            self._set(participant.id, {"stage": "withdrawn"})
            self._add(participant.id, at_ms, "withdrawn", {"from": participant.stage})

    def set_settings(self, participant_id: str, at_ms: int, settings: Mapping[str, Any]) -> None:
        """Return with a participant's settings kept, and the change among the events."""
        with self._changing(participant_id):
            self._set(participant_id, {"settings": json.dumps(settings, sort_keys=True)})
            self._add(participant_id, at_ms, "settings", settings)

    def participation(self, participant_id: str, session_id: str) -> None:
        """Return with a session noted as the participant's board."""
        with self._changing(participant_id):
            self._set(participant_id, {"session_id": session_id})

    def add_trial(self, participant_id: str, episode_id: str, phase: Phase, trial: int, terrain: int) -> None:
        """Return with an episode noted as the participant's trial; call it in the transaction that opens the episode."""
        with self._store.transaction():
            values = (episode_id, participant_id, phase, trial, terrain)
            self._conn.execute("INSERT INTO study_episodes VALUES (?, ?, ?, ?, ?)", values)

    def trials(self, participant_id: str) -> list[TrialRow]:
        """Return a participant's episodes in the order played."""
        return [TrialRow(*row) for row in self._conn.execute(_TRIALS, [participant_id]).fetchall()]

    def hides_scores(self, episode_id: str) -> bool:
        """Return whether an episode is a ranked one of a participant who has not come to the debrief."""
        found = self._conn.execute(_HIDES, [episode_id]).fetchone()
        return found is not None and bool(found[0])

    def owns(self, participant_id: str, episode_id: str) -> bool:
        """Return whether an episode is one of the participant's."""
        sql = "SELECT 1 FROM study_episodes WHERE episode_id = ? AND participant_id = ?"
        return self._conn.execute(sql, (episode_id, participant_id)).fetchone() is not None

    def add_input(self, events: Events, at_ms: int) -> bool:
        """Return whether input events of an episode are kept, those sent again once: False when it has MAX_EVENTS already."""
        with self._store.transaction():
            if self._has_input(events):
                return True
            sql = "SELECT coalesce(max(number) + 1, 0) FROM input_events WHERE episode_id = ?"
            first: int = self._conn.execute(sql, [events.episode]).fetchone()[0]
            if first + len(events.events) > MAX_EVENTS:
                return False
            rows = [
                (events.episode, number, each.kind, each.code, each.repeat, each.trusted, each.client_ms, each.step,
                 each.round_trip_ms, at_ms)
                for number, each in enumerate(events.events, first)
            ]  # fmt: skip
            self._conn.executemany("INSERT INTO input_events VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)
            digests.extend_events(self._conn, events.episode, first)
        return True

    def _has_input(self, events: Events) -> bool:
        """Return whether a batch is kept already: its events stand in one run, whatever came after them.

        The page sends no two batches that are the same; what was under way when a line broke can come after its repeat.
        """
        told = [tuple(each.model_dump().values()) for each in events.events]
        if not told:
            return True
        sql = "SELECT number FROM input_events WHERE episode_id = ? AND client_ms = ? AND kind = ?"
        first = events.events[0]
        starts = self._conn.execute(sql, (events.episode, first.client_ms, first.kind)).fetchall()
        values = [(events.episode, number, len(told)) for (number,) in starts]
        return any([tuple(row) for row in self._conn.execute(_RUN, each)] == told for each in values)

    @contextmanager
    def _changing(self, participant_id: str) -> Iterator[None]:
        with self._store.transaction():
            yield
            digests.write(self._conn, "participant", participant_id)

    def _set(self, participant_id: str, columns: Mapping[str, Any]) -> None:
        names = ", ".join(f"{name} = ?" for name in columns)
        self._conn.execute(f"UPDATE participants SET {names} WHERE id = ?", (*columns.values(), participant_id))

    def _add(self, participant_id: str, at_ms: int, kind: str, detail: Mapping[str, Any]) -> None:
        self._conn.execute(_ADD_EVENT, (participant_id, at_ms, kind, json.dumps(detail, sort_keys=True)))

    def _find(self, where: str, *values: str) -> Participant | None:
        row = self._conn.execute(f"SELECT * FROM participants WHERE {where}", values).fetchone()
        return None if row is None else Participant(*row)
