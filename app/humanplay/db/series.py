"""Series in the database: studies and daily terrains.

A server writes them; reports, releases and the leaderboard read them.

`StudyStore` works on the store's connection and in its transactions: `humanplay.db.store` stays the one writer. Whatever
changes a participant or a study appends an entry to the chain in the same transaction (`humanplay.db.chain`). The functions
take an open reader; `identities_by_person` alone reads identities.
"""

from __future__ import annotations

import json
import secrets
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import NamedTuple

from humanplay.db import chain
from humanplay.db.columns import TABLES
from humanplay.db.database import rows
from humanplay.db.erasure import ANSWERS, ARRIVALS, ERASED, asks_erasure, invitation_hash
from humanplay.db.playground import DELETE_UNUSED_PLAYER, MOVES
from humanplay.db.reader import ATTESTED, TRIAL, Reader
from humanplay.db.rows import (
    ErasedPerson,
    MoveTime,
    NotedArrivals,
    Phase,
    PlayerSettings,
    StageEvent,
)
from humanplay.db.store import Store
from humanplay.db.study_rows import (
    ARM_EVENT,
    BLOCK_EVENT,
    MOVED_EVENT,
    ORDER_EVENT,
    AnswerRow,
    FreeTextRow,
    Participant,
    SeriesRow,
    Stage,
    StageEventRow,
)
from humanplay.db.trial import DAILY, Trial

STUDY_TRIAL = f"{TRIAL}, x.participant_id AS participant, p.kind, x.phase, x.trial, x.terrain AS terrain_index"
"""What `Trial.of` takes of a study's episode (SQL)."""
STUDY_JOINED = """FROM series_episodes x JOIN participants p ON p.id = x.participant_id JOIN episodes e ON e.id = x.episode_id
    JOIN sessions s ON s.id = e.session_id"""
_TRIALS = f"SELECT {STUDY_TRIAL} {STUDY_JOINED} WHERE x.participant_id = ? ORDER BY e.number"
_ADD_EVENT = """INSERT INTO stage_events SELECT ?1, coalesce(max(number) + 1, 0), ?2, ?3, ?4
    FROM stage_events WHERE participant_id = ?1"""
_ORDER_NUMBER = f"SELECT json_extract(detail, '$.number') FROM stage_events WHERE participant_id = ? AND kind = '{ORDER_EVENT}'"
_ARM = f"SELECT json_extract(a.detail, '$.arm') FROM stage_events a WHERE a.participant_id = {{}} AND a.kind = '{ARM_EVENT}'"
_NEXT_NUMBER = """SELECT coalesce(max(json_extract(v.detail, '$.number')) + 1, 0) FROM stage_events v
    JOIN participants p ON p.id = v.participant_id WHERE p.study = ? AND p.kind = ? AND v.kind = ?"""
_NEXT_ORDER_NUMBER = f"{_NEXT_NUMBER} AND ({_ARM.format('p.id')}) IS ?"
_IS_OPEN = (
    "SELECT 1 FROM series WHERE (name, protocol_hash, commitment) = (?, ?, ?) AND closed_ms IS NULL"
)
_NOTE_CLOSED = "UPDATE series SET closed_ms = ?, secret = ?, secret_kept_ms = ? WHERE name = ?"
_PHASE_AND_STAGE = """SELECT t.phase, p.stage FROM series_episodes t
    JOIN participants p ON p.id = t.participant_id WHERE t.episode_id = ?"""


def add_series(store: Store, series: SeriesRow) -> SeriesRow:
    """Add a series unless one of its name is there; return the one that is there now."""
    with store.transaction():
        conn, insert = store.connection, TABLES["series"].insert(how="INSERT OR IGNORE")
        if conn.execute(insert, series).rowcount:
            chain.append(conn, "series", series.name)
            chain.append_marks(conn)
        sql = "SELECT * FROM series WHERE name = ?"
        return SeriesRow(*conn.execute(sql, [series.name]).fetchone())


class StudyStore:
    """The tables of studies in a store's database."""

    def __init__(self, store: Store) -> None:
        self.path = store.path
        self._store = store

    @property
    def _conn(self) -> sqlite3.Connection:
        return self._store.connection

    def note_closed(self, study: SeriesRow) -> None:
        """Write that a study was closed, with its secret unless that is kept."""
        if study.closed_ms is None and study.secret_kept_ms is None:
            return
        with self._store.transaction():
            fixed = (study.name, study.protocol_hash, study.commitment)
            if self._conn.execute(_IS_OPEN, fixed).fetchone():
                with chain.changing(self._conn, "series", study.name):
                    values = (study.closed_ms, study.secret, study.secret_kept_ms, study.name)
                    self._conn.execute(_NOTE_CLOSED, values)
                chain.append_marks(self._conn)

    def note_freezing(self, study: SeriesRow) -> None:
        """Append a study's freezing to the chain; a second call changes nothing.

        Nobody need have joined it.
        """
        with self._store.transaction():
            chain.append_marks(self._conn, [chain.freezing_of(study)])

    def note_act(self, study: SeriesRow, act: chain.Act, **details: int) -> None:
        """Append an entry of an operator's act."""
        with self._store.transaction():
            chain.append_marks(self._conn, [chain.act_of(study, act, **details)])

    def is_closed(self, name: str) -> bool:
        """Whether the database says that a study is closed.

        Its terrains are public then, whatever its files say.
        """
        sql = "SELECT 1 FROM series WHERE name = ? AND closed_ms IS NOT NULL"
        row = self._conn.execute(sql, [name]).fetchone()
        return row is not None

    def unclosed_studies(self) -> dict[str, bool]:
        """Name of each study that is not closed -> whether its secret is to be kept."""
        sql = "SELECT name, secret_kept_ms IS NOT NULL FROM series WHERE closed_ms IS NULL"
        return {name: bool(is_kept) for name, is_kept in self._conn.execute(sql).fetchall()}

    def participant(self, participant_id: str) -> Participant:
        """Return a participant as the database has them now."""
        person = self._find("id = ?", participant_id)
        assert person is not None
        return person

    def is_participant(self, participant_id: str) -> bool:
        """Whether there is a participant of this id; there is none once they are erased."""
        return self._find("id = ?", participant_id) is not None

    def participant_of_player(self, study: str, player_id: str) -> Participant | None:
        """Return the participant with a player's cookie; None before joining."""
        return self._find("study = ? AND player_id = ?", study, player_id)

    def participant_of_session(self, session_id: str) -> Participant | None:
        """The participant who has, or had, a session as their board; None if nobody."""
        sql = """id = (SELECT participant_id FROM series_episodes x JOIN episodes e ON e.id = x.episode_id
            WHERE e.session_id = ? LIMIT 1)"""
        return self._find(f"session_id = ?1 OR {sql.replace('?', '?1')}", session_id)

    def people_who_agreed(self, study: str) -> list[Participant]:
        """Return who agreed to take part in a study, in the order of joining."""
        sql = """SELECT * FROM participants WHERE study = ? AND kind = 'human' AND consent_ms IS NOT NULL
            ORDER BY joined_ms, id"""
        return [Participant(*row) for row in self._conn.execute(sql, [study]).fetchall()]

    def has_left_device(self, study: str, mark: str) -> bool:
        """Whether somebody in a study went on elsewhere from the device of this mark."""
        sql = """SELECT 1 FROM stage_events v JOIN participants p ON p.id = v.participant_id
            WHERE p.study = ? AND v.kind = ? AND json_extract(v.detail, '$.left') = ?"""
        return self._conn.execute(sql, (study, MOVED_EVENT, mark)).fetchone() is not None

    def participant_with_identity(self, study: str, name: str, value: str) -> Participant | None:
        """Return the participant who came with an outside id; None when nobody did."""
        sql = """id = (SELECT p.id FROM identities i JOIN participants p ON p.id = i.participant_id
            WHERE i.name = ? AND i.value = ? AND p.study = ?)"""
        return self._find(sql, name, value, study)

    def identities(self, study: str, name: str) -> list[tuple[Participant, str]]:
        """Everybody in a study who came with an outside id of this name, and the id."""
        sql = """SELECT i.value, p.* FROM identities i JOIN participants p ON p.id = i.participant_id
            WHERE i.name = ? AND p.study = ? ORDER BY p.joined_ms, p.id"""
        people = self._conn.execute(sql, (name, study)).fetchall()
        return [(Participant(*row[1:]), str(row[0])) for row in people]

    def consented_with_invitation(self, study: str, invitation: str) -> Participant | None:
        """Who used an invitation up by agreeing to the consent text; None if nobody."""
        sql = "study = ? AND invitation = ? AND consent_ms IS NOT NULL"
        return self._find(sql, study, invitation)

    def is_invitation_forgotten(self, study: str, invitation: str) -> bool:
        """Return whether an invitation was used by somebody who was erased since."""
        sql = "SELECT 1 FROM forgotten_people WHERE id_hash = ?"
        id_hash = invitation_hash(study, invitation)
        return self._conn.execute(sql, [id_hash]).fetchone() is not None

    def count_stage_events(self, participant_id: str, kind: str) -> int:
        """Return how many events of a kind a participant has."""
        sql = "SELECT count(*) FROM stage_events WHERE participant_id = ? AND kind = ?"
        return int(self._conn.execute(sql, (participant_id, kind)).fetchone()[0])

    def identity(self, participant_id: str, name: str) -> str | None:
        """Return the outside id a participant came with; None without one."""
        sql = "SELECT value FROM identities WHERE participant_id = ? AND name = ?"
        row = self._conn.execute(sql, (participant_id, name)).fetchone()
        return None if row is None else str(row[0])

    def identities_of(self, participant_id: str) -> dict[str, str]:
        """Return the outside ids that a participant came with, by name."""
        sql = "SELECT name, value FROM identities WHERE participant_id = ? ORDER BY name"
        return dict(self._conn.execute(sql, [participant_id]).fetchall())

    def set_identity(self, participant_id: str, name: str, value: str) -> None:
        """Set an outside id of a participant."""
        with self._changing(participant_id):
            sql = "INSERT OR REPLACE INTO identities VALUES (?, ?, ?)"
            self._conn.execute(sql, (participant_id, name, value))

    def add_participant(
        self,
        participant: Participant,
        identities: Mapping[str, str],
        joined: Mapping[str, object] | None = None,
    ) -> None:
        """Add a participant and their outside ids.

        Args:
            joined: Further details of the stage event "joined".
        """
        with self._changing(participant.id):
            self._store.add_player(participant.player_id, participant.joined_ms)
            self._conn.execute(TABLES["participants"].insert(), tuple(vars(participant).values()))
            for identity in identities.items():
                self._conn.execute(TABLES["identities"].insert(), (participant.id, *identity))
            detail = {"kind": participant.kind, "script": participant.script, **(joined or {})}
            self._add(participant.id, participant.joined_ms, "joined", detail)

    def add_stage_event(
        self, participant_id: str, at_ms: int, kind: str, detail: Mapping[str, object]
    ) -> None:
        """Add an event to those of a participant."""
        with self._changing(participant_id):
            self._add(participant_id, at_ms, kind, detail)

    def note_block(
        self,
        participant_id: str,
        at_ms: int,
        detail: Mapping[str, object],
        answers: Sequence[AnswerRow] = (),
        texts: Sequence[FreeTextRow] = (),
    ) -> None:
        """Note that a block was answered or skipped, with the answers."""
        with self._changing(participant_id):
            self._conn.executemany(TABLES["answers"].insert(), answers)
            self._conn.executemany(TABLES["free_texts"].insert(), texts)
            self._add(participant_id, at_ms, BLOCK_EVENT, detail)

    def blocks_done(self, participant_id: str) -> set[tuple[str, int]]:
        """(name, turn) of each block that a participant has answered or skipped."""
        sql = """SELECT json_extract(detail, '$.block'), json_extract(detail, '$.turn') FROM stage_events
            WHERE participant_id = ? AND kind = ?"""
        return set(self._conn.execute(sql, (participant_id, BLOCK_EVENT)).fetchall())

    def has_answered(self, participant_id: str, question: str, answers: Sequence[int]) -> bool:
        """Whether a participant's last answer to a question is one of these."""
        sql = """SELECT answer FROM answers WHERE participant_id = ? AND question = ?
            ORDER BY answered_ms DESC, turn DESC LIMIT 1"""
        row = self._conn.execute(sql, (participant_id, question)).fetchone()
        return row is not None and row[0] in answers

    def set_stage(
        self, participant_id: str, at_ms: int, stage: Stage, **columns: str | int
    ) -> None:
        """Move a participant to a stage, and set further columns."""
        with self._changing(participant_id):
            self._set(participant_id, {"stage": stage, **columns})
            self._add(participant_id, at_ms, "stage", {"stage": stage})

    def withdraw(
        self, participant: Participant, at_ms: int, erase: bool = False, outcome: str | None = None
    ) -> None:
        """Withdraw a participant; one who never agreed leaves no outside id behind.

        Args:
            erase: Whether they ask that what they have played be erased.
            outcome: How taking part ends for them, if it was not their own wish.
        """
        with self._changing(participant.id):
            if participant.consent_ms is None:
                sql = "DELETE FROM identities WHERE participant_id = ?"
                self._conn.execute(sql, [participant.id])
            self._set(participant.id, {"stage": "withdrawn"})
            detail: dict[str, object] = {"from": participant.stage}
            detail |= {"erase": True} if erase else {}
            detail |= {"outcome": outcome} if outcome else {}
            self._add(participant.id, at_ms, "withdrawn", detail)

    def events(self, participant_id: str, kinds: Sequence[str]) -> list[StageEvent]:
        """The stage events of some kinds of a participant, in order."""
        sql = f"""SELECT * FROM stage_events WHERE participant_id = ?
            AND kind IN ({", ".join("?" * len(kinds))}) ORDER BY number"""
        stored = self._conn.execute(sql, [participant_id, *kinds]).fetchall()
        return [StageEventRow(*row).event() for row in stored]

    def asks_erasure(self, participant_id: str) -> bool:
        """Whether a participant withdrew and asked that what they had played be erased."""
        return asks_erasure(self._conn, participant_id)

    def set_settings(self, participant_id: str, at_ms: int, settings: Mapping[str, object]) -> None:
        """Set a participant's settings, and add the change to their events."""
        with self._changing(participant_id):
            self._set(participant_id, {"settings": json.dumps(settings, sort_keys=True)})
            self._add(participant_id, at_ms, "settings", settings)

    def set_invitation(self, participant_id: str, invitation: str) -> None:
        """Set the invitation that brought a participant."""
        with self._changing(participant_id):
            self._set(participant_id, {"invitation": invitation})

    def note_supervised(self, participant_id: str, at_ms: int) -> None:
        """Note that the operator's code was typed."""
        with self._changing(participant_id):
            self._set(participant_id, {"supervised_ms": at_ms})
            self._add(participant_id, at_ms, "supervised", {})

    def supervised_ms(self, participant_id: str) -> tuple[int, ...]:
        """Return when the operator's code was typed for a participant, each time."""
        sql = "SELECT at_ms FROM stage_events WHERE participant_id = ? AND kind = 'supervised' ORDER BY number"
        return tuple(at_ms for (at_ms,) in self._conn.execute(sql, [participant_id]).fetchall())

    def settings(self, participant_id: str) -> list[PlayerSettings]:
        """Return what a participant has chosen, every version so far."""
        sql = "SELECT detail FROM stage_events WHERE participant_id = ? AND kind = 'settings' ORDER BY number"
        versions = self._conn.execute(sql, [participant_id]).fetchall()
        return [json.loads(detail) for (detail,) in versions]

    def hand_over(
        self, participant: Participant, player_id: str, at_ms: int, detail: Mapping[str, str]
    ) -> None:
        """Give a participant's place and board to another cookie."""
        with self._store.transaction():
            self._store.add_player(player_id, at_ms)
            if participant.session_id is not None:
                self._hand_over_board(participant.session_id, player_id)
            with self._changing(participant.id):
                self._set(participant.id, {"player_id": player_id})
                self._add(participant.id, at_ms, MOVED_EVENT, detail)
            self._conn.execute(DELETE_UNUSED_PLAYER, [participant.player_id])

    def _hand_over_board(self, session_id: str, player_id: str) -> None:
        has_entry = "SELECT 1 FROM chain_salts WHERE kind = 'session' AND id = ?"
        is_chained = self._conn.execute(has_entry, [session_id]).fetchone() is not None
        changing = chain.changing(self._conn, "session", session_id)
        with changing if is_chained else nullcontext():
            sql = "UPDATE sessions SET player_id = ?1, owner_id = ?1 WHERE id = ?2"
            self._conn.execute(sql, (player_id, session_id))

    def change_cookie(self, participant_id: str, player_id: str, at_ms: int) -> None:
        """Let another cookie stand for somebody who has not agreed yet."""
        with self._changing(participant_id):
            self._store.add_player(player_id, at_ms)
            self._set(participant_id, {"player_id": player_id})

    def set_session(self, participant_id: str, session_id: str) -> None:
        """Set the session that is the participant's board."""
        with self._changing(participant_id):
            self._set(participant_id, {"session_id": session_id})

    def add_trial(
        self, participant_id: str, episode_id: str, phase: Phase, trial: int, terrain: int
    ) -> None:
        """Add an episode as a participant's trial.

        Call it in the transaction that opens the episode.
        """
        with self._store.transaction():
            sql = "INSERT INTO series_episodes SELECT ?, study, id, NULL, ?, ?, ? FROM participants WHERE id = ?"
            self._conn.execute(sql, (episode_id, phase, trial, terrain, participant_id))

    def transaction(self) -> AbstractContextManager[None]:
        """Commit what the block writes as a whole or not at all."""
        return self._store.transaction()

    def arm(self, participant_id: str) -> str | None:
        """The name of the arm that a participant is assigned to; None before."""
        row = self._conn.execute(_ARM.format("?"), [participant_id]).fetchone()
        return None if row is None else str(row[0])

    def assign_arm(self, participant: Participant, at_ms: int, draw: Callable[[int], str]) -> None:
        """Assign a participant to the arm that follows from their number; once for ever.

        The erased keep their numbers: nobody takes the place of somebody who was assigned.

        Args:
            draw: Gives the arm of a number (from 0) among those of their kind.
        """
        with self._store.transaction():
            if self.arm(participant.id) is not None:
                return
            group = (participant.study, participant.kind, ARM_EVENT)
            (number,) = self._conn.execute(_NEXT_NUMBER, group).fetchone()
            if participant.kind == "human":
                erased = erased_people(self._store, participant.study)
                gone = (person["arm_number"] for person in erased)
                number = max([number, *(n + 1 for n in gone if n is not None)])
            detail = {"number": number, "arm": draw(number)}
            self.add_stage_event(participant.id, at_ms, ARM_EVENT, detail)

    def note_operators_arm(self, participant_id: str, at_ms: int, arm: str) -> None:
        """Note the arm to which the operator assigned a participant, without a number."""
        detail = {"arm": arm, "assigned_by": "operator"}
        self.add_stage_event(participant_id, at_ms, ARM_EVENT, detail)

    def order_number(self, participant: Participant, at_ms: int) -> int:
        """The participant's place (from 0) among those of their kind and arm.

        They are counted as they begin ranked terrains. The place is fixed when first asked for and
        stored as a stage event, so it outlives a restart, and no two participants of one database
        get the same.
        """
        with self._store.transaction():
            noted = self._conn.execute(_ORDER_NUMBER, [participant.id]).fetchone()
            if noted is not None:
                return int(noted[0])
            arm = self.arm(participant.id)
            group = (participant.study, participant.kind, ORDER_EVENT, arm)
            (number,) = self._conn.execute(_NEXT_ORDER_NUMBER, group).fetchone()
            self.add_stage_event(participant.id, at_ms, ORDER_EVENT, {"number": number})
        return int(number)

    def trials(self, participant_id: str) -> list[Trial]:
        """Return a participant's episodes in the order played."""
        return [Trial.of(row) for row in rows(self._conn, _TRIALS, participant_id)]

    def count_moves(self, participant_id: str) -> int:
        """Return how many moves a participant has made in all."""
        sql = "SELECT count(*) FROM series_episodes JOIN steps USING (episode_id) WHERE participant_id = ?"
        return int(self._conn.execute(sql, [participant_id]).fetchone()[0])

    def has_trial(self, participant_id: str, episode_id: str) -> bool:
        """Return whether an episode is one of the participant's."""
        sql = "SELECT 1 FROM series_episodes WHERE episode_id = ? AND participant_id = ?"
        return self._conn.execute(sql, (episode_id, participant_id)).fetchone() is not None

    def phase_and_stage(self, episode_id: str) -> tuple[Phase, Stage] | None:
        """(phase of an episode, its participant's stage now); None outside a study."""
        row = self._conn.execute(_PHASE_AND_STAGE, [episode_id]).fetchone()
        return None if row is None else (row[0], row[1])

    @contextmanager
    def _changing(self, participant_id: str) -> Iterator[None]:
        with self._store.transaction(), chain.changing(self._conn, "participant", participant_id):
            yield

    def _set(self, participant_id: str, columns: Mapping[str, str | int]) -> None:
        names = ", ".join(f"{name} = ?" for name in columns)
        sql = f"UPDATE participants SET {names} WHERE id = ?"
        self._conn.execute(sql, (*columns.values(), participant_id))

    def _add(
        self, participant_id: str, at_ms: int, kind: str, detail: Mapping[str, object]
    ) -> None:
        values = (participant_id, at_ms, kind, json.dumps(detail, sort_keys=True))
        self._conn.execute(_ADD_EVENT, values)

    def _find(self, condition: str, *values: str) -> Participant | None:
        row = self._conn.execute(f"SELECT * FROM participants WHERE {condition}", values).fetchone()
        return None if row is None else Participant(*row)


_ACTIVITY = f"""SELECT {STUDY_TRIAL}, (SELECT max(server_ms) FROM steps WHERE episode_id = e.id) AS moved_ms {STUDY_JOINED}
    WHERE p.study = ?"""
_EVENT_SUMMARY = """SELECT v.participant_id, max(v.at_ms) AS last_ms, sum(v.kind = 'deviation') AS deviations
    FROM stage_events v JOIN participants p ON p.id = v.participant_id WHERE p.study = ? GROUP BY v.participant_id"""
_WITHDRAWALS = """SELECT v.* FROM stage_events v JOIN participants p ON p.id = v.participant_id
    WHERE p.study = ? AND v.kind = 'withdrawn'"""
OF_PEOPLE = """SELECT x.* FROM {} x JOIN participants p ON p.id = x.participant_id
    WHERE p.study = ? AND p.kind = 'human' AND p.consent_ms IS NOT NULL"""
"""The rows (SQL) of a table of answers that are of people who agreed to take part."""
_CLOSED = """SELECT * FROM series WHERE kind = 'study' AND closed_ms IS NOT NULL AND secret IS NOT NULL
    AND json_extract(protocol, '$.dry_run_of') IS NULL ORDER BY closed_ms DESC"""
DRY_RUNS = """SELECT count(DISTINCT y.name) AS dry_runs, count(*) AS dry_run_people
    FROM series y JOIN participants p ON p.study = y.name
    WHERE y.kind = 'study' AND json_extract(y.protocol, '$.dry_run_of') = ?
    AND p.kind = 'human' AND p.consent_ms IS NOT NULL"""
"""How many dry runs of a study there were, and how many people agreed to take part (SQL)."""


def find_study(reader: Reader, name: str) -> SeriesRow | None:
    """Return a study; None when nobody has joined one of this name."""
    matching = reader.query("SELECT * FROM series WHERE name = ?", [name])
    return SeriesRow(**matching[0]) if matching else None


def study_names(reader: Reader) -> list[str]:
    """Return the names of all studies that somebody has joined, sorted."""
    studies = reader.query("SELECT name FROM series WHERE kind = 'study' ORDER BY name")
    return [row["name"] for row in studies]


def closed_studies(reader: Reader) -> list[SeriesRow]:
    """Closed studies whose secret is known, the latest first; no dry runs."""
    return [SeriesRow(**row) for row in reader.query(_CLOSED)]


def participants(reader: Reader, study: str) -> list[Participant]:
    """Return a study's participants in the order of joining."""
    sql = "SELECT * FROM participants WHERE study = ? ORDER BY joined_ms, id"
    return [Participant(**row) for row in reader.query(sql, [study])]


def count_participants(reader: Reader, study: str) -> int:
    """Return how many people and scripts have joined a study."""
    sql = "SELECT count(*) AS n FROM participants WHERE study = ?"
    return int(reader.query(sql, [study])[0]["n"])


def count_places(reader: Reader, study: str, since_ms: int | None) -> int:
    """Count the people who finished, or who agreed after a time.

    An erased person counts if they had finished: when the others agreed is not stored any more.

    Args:
        since_ms: None counts all who agreed.
    """
    sql = """SELECT count(*) AS n FROM participants WHERE study = ?1 AND kind = 'human' AND consent_ms IS NOT NULL
        AND (?2 IS NULL OR completed_ms IS NOT NULL OR consent_ms > ?2)"""
    erased = sum(person["completed"] for person in erased_people(reader, study))
    return int(reader.query(sql, [study, since_ms])[0]["n"]) + erased


def count_dry_runs(reader: Reader, study: str) -> tuple[int, int]:
    """How many dry runs a study had, and how many people consented in them."""
    (row,) = reader.query(DRY_RUNS, [study])
    return row["dry_runs"], row["dry_run_people"]


def count_freezings(reader: Reader, study: str) -> int:
    """How often a study of this name was frozen, by the chain.

    So secrets that were tried out show.
    """
    sql = "SELECT count(*) AS n FROM chain WHERE kind = 'frozen' AND json_extract(note, '$.study') = ?"
    return int(reader.query(sql, [study])[0]["n"])


def of_same_configuration(reader: Reader, row: SeriesRow) -> list[tuple[str, int]]:
    """Name and frozen_ms of other studies of this configuration; no dry runs."""
    sql = """SELECT DISTINCT json_extract(note, '$.study') AS name, json_extract(note, '$.frozen_ms') AS frozen_ms FROM chain
        WHERE kind = 'frozen' AND json_extract(note, '$.study') <> ? AND json_extract(note, '$.configuration') = ?
        AND json_extract(note, '$.dry_run_of') IS NULL ORDER BY 2, 1"""
    freezings = reader.query(sql, [row.name, chain.configuration_hash(row.protocol)])
    return [(freezing["name"], freezing["frozen_ms"]) for freezing in freezings]


def exports_while_open(reader: Reader, study: str, commitment: str) -> list[int]:
    """When a study's episodes were exported while it was open, by the chain (ms)."""
    sql = """SELECT json_extract(note, '$.at_ms') AS at_ms FROM chain WHERE kind = 'exported'
        AND json_extract(note, '$.study') = ? AND json_extract(note, '$.commitment') = ? ORDER BY number"""
    return [int(row["at_ms"]) for row in reader.query(sql, [study, commitment])]


def erased_people(reader: Reader, study: str) -> list[ErasedPerson]:
    """What is noted of everybody whose rows were erased from a study."""
    sql = "SELECT value FROM meta WHERE name LIKE ? || '|' || ? || '|%'"
    return [json.loads(row["value"]) for row in reader.query(sql, [ERASED, study])]


def noted_arrivals(reader: Reader, study: str) -> NotedArrivals:
    """The counts of people whom the imported release left out; empty without one."""
    counts = NotedArrivals()
    for row in reader.query("SELECT value FROM meta WHERE name = ?", [f"{ARRIVALS}|{study}"]):
        counts = json.loads(row["value"])
    return counts


def answers_of_people(reader: Reader, study: str) -> tuple[list[AnswerRow], list[FreeTextRow]]:
    """The answers of people who agreed to take part: as numbers, and in words."""
    numbers = reader.query(OF_PEOPLE.format("answers"), [study])
    texts = reader.query(OF_PEOPLE.format("free_texts"), [study])
    return [AnswerRow(**row) for row in numbers], [FreeTextRow(**row) for row in texts]


def noted_answers(reader: Reader, study: str) -> str | None:
    """The counts of answers (JSON) that the imported release noted; None without one."""
    sql = "SELECT value FROM meta WHERE name = ?"
    noted = reader.query(sql, [f"{ANSWERS}|{study}"])
    return str(noted[0]["value"]) if noted else None


def stage_events(reader: Reader, study: str, kinds: Sequence[str] = ()) -> list[StageEventRow]:
    """The stage events of all participants of a study, in order.

    Args:
        kinds: Of these kinds alone; without any, all.
    """
    sql = "SELECT v.* FROM stage_events v JOIN participants p ON p.id = v.participant_id WHERE p.study = ?"
    wanted = f" AND v.kind IN ({', '.join('?' * len(kinds))})" if kinds else ""
    events = reader.query(f"{sql}{wanted} ORDER BY v.number", [study, *kinds])
    return [StageEventRow(**row) for row in events]


def study_trials(reader: Reader, study: str) -> list[Trial]:
    """Return a study's episodes, finished or running, oldest first."""
    sql = f"SELECT {STUDY_TRIAL} {STUDY_JOINED} WHERE p.study = ? ORDER BY e.started_ms, e.id"
    return [Trial.of(row) for row in reader.query(sql, [study])]


def move_inputs(reader: Reader, episode_id: str) -> list[MoveTime]:
    """When, by what and with what effect the moves of an episode were made, in order."""
    sql = "SELECT input, server_ms, discovered FROM steps WHERE episode_id = ? ORDER BY step"
    return reader.query(sql, [episode_id])


def arms_by_person(reader: Reader, study: str) -> dict[str, str]:
    """The arm of each participant of a study who is assigned to one."""
    assigned = stage_events(reader, study, (ARM_EVENT,))
    return {noted.participant_id: str(noted.event().detail["arm"]) for noted in assigned}


def identities_by_person(reader: Reader, study: str) -> dict[str, dict[str, str]]:
    """participant -> name -> outside id: for the list of payments alone."""
    sql = """SELECT i.* FROM identities i JOIN participants p ON p.id = i.participant_id
        WHERE p.study = ? ORDER BY i.name"""
    by_person: dict[str, dict[str, str]] = {}
    for row in reader.query(sql, [study]):
        by_person.setdefault(row["participant_id"], {})[row["name"]] = row["value"]
    return by_person


class ListedAmounts(NamedTuple):
    """When amounts that depend on play were listed although the study was open."""

    at_ms: int
    people: int


def amounts_listed(reader: Reader, study: str, commitment: str) -> list[ListedAmounts]:
    """When amounts that depend on play were listed before the closing, by the chain."""
    sql = """SELECT json_extract(note, '$.at_ms') AS at_ms, json_extract(note, '$.people') AS people FROM chain
        WHERE kind = 'acted' AND json_extract(note, '$.act') = 'amounts listed'
        AND json_extract(note, '$.study') = ? AND json_extract(note, '$.commitment') = ? ORDER BY number"""
    return [ListedAmounts(**row) for row in reader.query(sql, [study, commitment])]


def trial_activity(reader: Reader, study: str) -> list[Trial]:
    """Return every trial of a study with the time of its newest move."""
    return [Trial.of(row) for row in reader.query(_ACTIVITY, [study])]


class EventSummary(NamedTuple):
    """When a participant's last stage event was, and how many deviations they have."""

    participant_id: str
    last_ms: int
    deviations: int


def event_summaries(reader: Reader, study: str) -> dict[str, EventSummary]:
    """Sum up the stage events of each participant who has any, by their id."""
    summaries = [EventSummary(**row) for row in reader.query(_EVENT_SUMMARY, [study])]
    return {summary.participant_id: summary for summary in summaries}


def page_loads(reader: Reader, study: str) -> dict[str, int]:
    """Return how many loads of the page have sent input events, by participant."""
    sql = """SELECT x.participant_id AS participant, count(DISTINCT l.load_id) AS loads FROM series_episodes x
        JOIN page_loads l USING (episode_id) WHERE x.series = ? GROUP BY x.participant_id"""
    return {row["participant"]: row["loads"] for row in reader.query(sql, [study])}


def withdrawals(reader: Reader, study: str) -> list[StageEventRow]:
    """Return the stage events by which participants of a study withdrew."""
    return [StageEventRow(**row) for row in reader.query(_WITHDRAWALS, [study])]


_SECRET = "daily_secret"
"""The row of the table `meta` with the secret that the keys of this database's days follow from."""
_DAY = """SELECT y.* FROM series y WHERE y.name GLOB ?1
    ORDER BY (SELECT count(*) FROM series_episodes x WHERE x.series = y.name) DESC, y.commitment LIMIT 1"""
_BESIDE = """SELECT (SELECT max(name) FROM series WHERE name > ?1 AND name < ?2) AS older,
    (SELECT min(name) FROM series WHERE name > ?2 || ';' AND name < ?3) AS newer"""
_ATTEMPTS = f"""SELECT {TRIAL}, {MOVES} FROM series_episodes x JOIN episodes e ON e.id = x.episode_id
    JOIN sessions s ON s.id = e.session_id WHERE x.player_id = ? ORDER BY x.series DESC"""
_RESULTS = f"""SELECT e.id AS episode_id, x.player_id, e.outcome, e.steps, e.discovered, e.score, e.ended_ms
    FROM series_episodes x JOIN episodes e ON e.id = x.episode_id
    WHERE x.series = ?1 AND {ATTESTED} AND e.ended_ms < ?2 ORDER BY e.ended_ms, e.id"""


def daily_secret(store: Store) -> bytes:
    """The secret from which the days' keys follow; created once, in the database."""
    with store.transaction():
        values = (_SECRET, secrets.token_hex(32))
        store.connection.execute("INSERT OR IGNORE INTO meta VALUES (?, ?)", values)
    (row,) = store.query("SELECT value FROM meta WHERE name = ?", [_SECRET])
    return bytes.fromhex(row["value"])


def find_day(reader: Reader, day: str) -> SeriesRow | None:
    """The series of a day; None if there is none.

    A merged database may have several: the most played one.
    """
    days = reader.query(_DAY, [f"{DAILY}:{day}:*"])
    return SeriesRow(**days[0]) if days else None


def days_beside(reader: Reader, day: str, last: str) -> tuple[str | None, str | None]:
    """The nearest days with a terrain before and after a day; None if there is none.

    Args:
        day: Like "2026-11-22".
        last: The last day that may be named.
    """
    # a name is "daily:DAY:...", and ";" comes after ":"
    (row,) = reader.query(_BESIDE, [f"{DAILY}:", f"{DAILY}:{day}", f"{DAILY}:{last};"])
    older, newer = (name and name.split(":")[1] for name in (row["older"], row["newer"]))
    return older, newer


def add_attempt(store: Store, series: str, player_id: str, episode_id: str) -> None:
    """Add an episode as a player's attempt at a day's terrain.

    Call it in the transaction that opens the episode.

    Raises:
        StoreError: If it is the player's second attempt.
    """
    with store.transaction():
        values = (episode_id, series, player_id)
        sql = "INSERT INTO series_episodes VALUES (?, ?, NULL, ?, 'ranked', 0, 0)"
        store.connection.execute(sql, values)


def attempts_of(reader: Reader, player_id: str) -> list[Trial]:
    """Return all daily attempts of a player with the moves made, the newest day first."""
    return [Trial.of(row) for row in reader.query(_ATTEMPTS, [player_id])]


class DayResult(NamedTuple):
    """What an attempt at a day's terrain came to."""

    episode_id: str
    player_id: str
    outcome: str
    steps: int
    discovered: int
    score: float
    ended_ms: int


def results(reader: Reader, series: str, before_ms: int) -> list[DayResult]:
    """Attempts at a day's terrain that ended before a time, sorted by their ends."""
    return [DayResult(**row) for row in reader.query(_RESULTS, [series, before_ms])]
