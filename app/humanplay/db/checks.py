"""Stored rows checked against what they follow from.

An episode is checked against its simulation, every row against the chain, the chain against itself,
and the file by SQLite. `humanplay.study.verification` puts these checks together with those of the
study's protocol; `humanplay.db.chain` says what an entry is.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from humanplay.db.chain import (
    OWNERS,
    EpisodeRows,
    Head,
    Kind,
    Thing,
    combine,
    compute,
    head,
    link,
    read_episode_rows,
    select,
    table_marks,
)
from humanplay.db.database import StoreError, reading, rows, writing
from humanplay.db.reader import now_ms
from humanplay.db.resimulation import Finding, simulate
from humanplay.db.rows import EndedEpisode, EventRow, MoveRow, PlacedEpisode
from humanplay.db.study_rows import SeriesRow
from humanplay.task import Allowed

_MAY_HAVE_ENTRY: dict[Kind, str] = {**OWNERS, "session": "SELECT id FROM sessions"}
"""Kind of entry in the chain -> SQL for the ids that may have one."""

_PLACED = """SELECT e.*, x.series, x.phase, x.trial, x.terrain AS terrain_index, x.player_id, s.owner_id FROM series_episodes x
    JOIN episodes e ON e.id = x.episode_id JOIN sessions s ON s.id = e.session_id"""
_MOVED_SESSIONS = """SELECT DISTINCT e.session_id FROM episodes e
    WHERE EXISTS (SELECT 1 FROM steps WHERE episode_id = e.id){within} ORDER BY e.session_id"""


def series(conn: sqlite3.Connection, only: str | None = None) -> list[SeriesRow]:
    """Every series, or the one of a name."""
    sql = "SELECT * FROM series WHERE ? IS NULL OR name = ?"
    return [SeriesRow(*row) for row in conn.execute(sql, (only, only))]


def participants_of(conn: sqlite3.Connection, study: str) -> list[tuple[str, int]]:
    """(id, when they joined) of each participant of a study, in that order."""
    sql = "SELECT id, joined_ms FROM participants WHERE study = ? ORDER BY joined_ms"
    return conn.execute(sql, [study]).fetchall()


def episodes_of(conn: sqlite3.Connection, participant: str) -> list[PlacedEpisode]:
    """The rows of a participant's episodes, with their place in the study.

    They are ordered by phase and trial.
    """
    sql = f"{_PLACED} WHERE x.participant_id = ? ORDER BY x.phase, x.trial"
    return rows(conn, sql, participant)


def attempts_at(conn: sqlite3.Connection, day: str) -> list[PlacedEpisode]:
    """The attempts at the terrain of a day, with their players' (`episodes_of`)."""
    return rows(conn, f"{_PLACED} WHERE x.series = ? ORDER BY e.id", day)


def kind_of(conn: sqlite3.Connection, participant: str) -> str:
    """A participant's kind: human or script."""
    (kind,) = conn.execute("SELECT kind FROM participants WHERE id = ?", [participant]).fetchone()
    return str(kind)


def event_details(conn: sqlite3.Connection, participant: str, kind: str) -> list[str]:
    """The details (JSON) of a participant's events of a kind."""
    sql = "SELECT detail FROM stage_events WHERE participant_id = ? AND kind = ?"
    return [row[0] for row in conn.execute(sql, (participant, kind))]


def stages_of(conn: sqlite3.Connection, participant: str) -> set[str]:
    """Every stage that a participant came to, by their row and their events."""
    sql = """SELECT stage FROM participants WHERE id = ?1 UNION SELECT json_extract(detail, '$.stage') FROM stage_events
        WHERE participant_id = ?1 AND kind = 'stage' AND json_valid(detail)"""
    return {str(stage) for (stage,) in conn.execute(sql, [participant])}


def tasks(conn: sqlite3.Connection) -> list[str]:
    """The names of the tasks that episodes are of."""
    return [str(row["task"]) for row in rows(conn, "SELECT DISTINCT task FROM episodes")]


def finished_episodes(conn: sqlite3.Connection, study: str | None) -> list[str]:
    """The ids of finished episodes, of one study or (None) of all, oldest first."""
    sql = f"SELECT id FROM episodes WHERE ended_ms IS NOT NULL{_within(study)} ORDER BY started_ms, id"
    return [str(row[0]) for row in conn.execute(sql)]


def count_unfinished(conn: sqlite3.Connection, study: str | None) -> int:
    """How many episodes have not ended, of one study or (None) of all."""
    sql = f"SELECT count(*) FROM episodes WHERE ended_ms IS NULL{_within(study)}"
    (count,) = conn.execute(sql).fetchone()
    return int(count)


class InputOf(NamedTuple):
    """What the attestation of an episode follows from, besides its own rows.

    Attributes:
        settings: (when, JSON) of what its participant had chosen, every version.
        supervised_ms: When the operator's code was typed for its participant.
        is_studys: Whether a participant of a study played it.
    """

    settings: list[tuple[int, str]]
    supervised_ms: list[int]
    is_studys: bool


@dataclass(frozen=True)
class CheckedEpisode:
    """A finished episode's rows, as they were read once, and what is wrong with them.

    They are rows and no `Trial`: what was tampered with need not be one.

    Attributes:
        row: With `control` of its session.
        steps: Its moves.
        events: Input events that were received up to its end.
        allowed: What could be chosen before each move (`humanplay.task.Run.allowed`); None
            where it was not simulated.
    """

    row: EndedEpisode
    steps: list[MoveRow]
    events: list[EventRow]
    findings: list[Finding]
    allowed: Sequence[Allowed] | None


def check_episode(conn: sqlite3.Connection, ident: str) -> CheckedEpisode:
    """Simulate a finished episode again, and compare its rows with the chain's."""
    sql = "SELECT e.*, s.control FROM episodes e LEFT JOIN sessions s ON s.id = e.session_id WHERE e.id = ?"
    (row,) = rows(conn, sql, ident)
    played = read_episode_rows(conn, ident)
    run, differences = simulate(row, played.steps)
    findings = [*differences, *check_thing(conn, "episode", ident, played)]
    received = [event for event in played.events if event["server_ms"] <= row["ended_ms"]]
    allowed = None if run is None else run.allowed()
    return CheckedEpisode(row, played.steps, received, findings, allowed)


def input_of(conn: sqlite3.Connection, ident: str) -> InputOf:
    """What else the attestation of a finished episode follows from."""
    of = """SELECT v.at_ms, v.detail, v.kind FROM stage_events v
        JOIN series_episodes t ON t.participant_id = v.participant_id
        WHERE t.episode_id = ? AND v.kind IN ('settings', 'supervised') ORDER BY v.number"""
    events = rows(conn, of, ident)
    settings = [(row["at_ms"], row["detail"]) for row in events if row["kind"] == "settings"]
    supervised_ms = [row["at_ms"] for row in events if row["kind"] == "supervised"]
    within = "SELECT 1 FROM series_episodes WHERE episode_id = ? AND participant_id IS NOT NULL"
    return InputOf(settings, supervised_ms, bool(rows(conn, within, ident)))


def check_entries(conn: sqlite3.Connection, study: str | None) -> Iterator[Finding]:
    """Yield series, sessions and participants whose rows do not fit their entries."""
    for row in series(conn, study):
        yield from check_thing(conn, "series", row.name)
    for (ident,) in conn.execute(_MOVED_SESSIONS.format(within=_within(study, "e.id"))).fetchall():
        yield from check_thing(conn, "session", ident)
    people = "SELECT id FROM participants WHERE ? IS NULL OR study = ?"
    for (ident,) in conn.execute(people, (study, study)).fetchall():
        yield from check_thing(conn, "participant", ident)


def check_owners(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield entries of the chain for what is gone, and rows that belong to nothing."""
    yield from check_without_owner(conn, _MAY_HAVE_ENTRY)
    strays = conn.execute("PRAGMA foreign_key_check").fetchall()
    without_owner = Counter(table for table, *_ in strays)
    for table, count in sorted(without_owner.items()):
        owner = "no episode, participant, session, player or series that they belong to"
        yield Finding(f"table {table}", "keys", count, owner)


def _within(study: str | None, column: str = "id") -> str:
    """SQL that keeps a study's episodes.

    The name was looked up in the database before: it is a study's.
    """
    if study is None:
        return ""
    inner = "SELECT episode_id FROM series_episodes JOIN participants p ON p.id = participant_id"
    return f" AND {column} IN ({inner} WHERE p.study = '{study.replace(chr(39), chr(39) * 2)}')"


def quick_check(
    database: Path, begins: Callable[[sqlite3.Connection], None] = lambda _: None
) -> str:
    """ "ok", or what SQLite finds damaged.

    It reads the whole file, which takes milliseconds to minutes.

    Args:
        begins: Is called with the connection, on which another thread may interrupt the check.
    """
    try:
        with reading(database) as conn:
            begins(conn)
            try:
                return "; ".join(text for (text,) in conn.execute("PRAGMA quick_check(5)"))
            except sqlite3.DatabaseError as error:
                return str(error)
    except StoreError as error:
        return str(error)


def try_write(database: Path, timeout_s: float = 1.0) -> None:
    """Write a row of the table `meta` and commit it, on a connection of its own.

    Call it in a thread: the disk may take as long as it likes.

    Args:
        timeout_s: Seconds to wait for another program that is writing.

    Raises:
        StoreError: If that fails.
    """
    with writing(database, timeout_s) as conn:
        conn.execute("INSERT OR REPLACE INTO meta VALUES ('written_ms', ?)", [str(now_ms())])


def chain_head(database: Path) -> Head | None:
    """The end of the chain of a database in use; None if it cannot be read."""
    try:
        with reading(database) as conn:
            return head(conn)
    except (StoreError, sqlite3.DatabaseError):
        return None


DIGEST = "digest of its stored fields"
"""What a finding calls the hash of an entry."""


@dataclass(frozen=True)
class ChainState:
    """How long the chain is, and where it ends.

    Attributes:
        entries: How many; the head is that of the last.
        head: Hex; empty without an entry.
        forgotten: Entries whose salts were deleted when somebody was forgotten.
    """

    entries: int
    head: str
    forgotten: int = 0


@dataclass(frozen=True)
class EarlierHead:
    """Where an earlier head stood, and what came after it.

    added     entries since, by kind
    replaced  of the entries up to it those that later ones replace, by kind: what was changed since
    forgotten of the entries up to it those of somebody who was forgotten since, by kind
    """

    head: str
    entry: int
    day_ms: int
    added: Mapping[str, int]
    replaced: Mapping[str, int]
    forgotten: Mapping[str, int]


ChainRow = tuple[int, int, str, int, int | None, str, str | None, str]
"""number, day_ms, kind, is_sound, replaces, hash, note, head"""


@dataclass
class _Walk:
    """The entries that nothing has replaced or forgotten so far.

    Attributes:
        live: Number -> kind.
        forgotten: How many were forgotten.
    """

    live: dict[int, str] = field(default_factory=dict)
    forgotten: int = 0

    def take(self, row: ChainRow) -> Iterator[str]:
        """Take the next entry, and yield what does not fit those before it."""
        number, _, kind, _, replaces, hash_, note, _ = row
        if note is not None and hashlib.sha256(note.encode()).hexdigest() != hash_:
            yield "a note that its hash does not stand for"
        if replaces is not None and self.live.pop(replaces, None) != kind:
            yield f"in place of entry {replaces}, which is not one of kind {kind} that is in force"
        gone = json.loads(note or "{}").get("forgotten", []) if kind == "forgotten" else []
        for entry in gone:
            if self.live.pop(entry, None) is None:
                yield f"entry {entry} forgotten, which is not in force"
        self.forgotten += len(gone)
        if note is None:
            self.live[number] = kind


_COLUMNS = "number, day_ms, kind, is_sound, replaces, hash, note, head"
_ENTRIES = f"SELECT {_COLUMNS} FROM chain ORDER BY number"


def chain_state(conn: sqlite3.Connection) -> ChainState:
    """How long the chain is, and where it ends."""
    notes = select(conn, "SELECT note FROM chain WHERE kind = 'forgotten' AND json_valid(note)")
    gone = sum(len(json.loads(note).get("forgotten", [])) for (note,) in notes)
    return ChainState(*head(conn), gone)


def check_chain(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield what is wrong with the chain itself.

    That is entries changed, added or taken away, and salts that do not fit them.
    """
    walk, before, number = _Walk(), "", 0
    for row in select(conn, _ENTRIES):
        entry = f"chain entry {row[0]}"
        if row[0] != number + 1:
            missing = row[0] - 1 if number else "none"
            last = number or "none: the first is missing"
            yield Finding(entry, "the entry before it", missing, last)
        if (computed := link(before, row[:-1])) != row[-1]:
            yield Finding(entry, "its head", row[-1], computed)
        number, before = row[0], row[-1]
        try:
            allowed = "what the entries before it allow"
            yield from (Finding(entry, "it", misfit, allowed) for misfit in walk.take(row))
        except (ValueError, TypeError, AttributeError) as error:
            yield Finding(entry, "its note", row[6], f"JSON: {error}")
    yield from _check_salts(conn, walk.live)


def _check_salts(conn: sqlite3.Connection, live: dict[int, str]) -> Iterator[Finding]:
    """Yield salts of entries not in force, and entries in force without salts."""
    sql = "SELECT kind, id, first, number FROM chain_salts ORDER BY number"
    for kind, ident, first, number in select(conn, sql):
        if live.pop(number, None) != kind or (first and kind != "events"):
            yield Finding(
                place(Thing(kind, ident, first)),
                f"the entry of its kind ({kind})",
                f"number {number}",
                "no such entry in force in the chain",
            )
    for number, kind in live.items():
        yield Finding(
            f"chain entry {number}",
            f"what it stands for (kind {kind})",
            "gone",
            "no entry that says it was forgotten",
        )


def answers_of(
    conn: sqlite3.Connection, participant: str
) -> dict[tuple[str, int, str], float | None]:
    """A participant's answers, without texts, by block, turn and question."""
    sql = "SELECT block, turn, question, answer FROM answers WHERE participant_id = ? AND part = 0"
    return {tuple(key): answer for *key, answer in select(conn, sql, [participant])}


def check_marks(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield where the chain and the tables disagree on what fixed the studies.

    That is their freezing, end, erasures and releases.
    """
    sql = "SELECT kind, note FROM chain WHERE kind IN ('frozen', 'closed', 'erased', 'released') AND json_valid(note)"
    in_chain = set(select(conn, sql))
    try:
        in_tables = set(table_marks(conn))
    except (ValueError, KeyError, TypeError) as error:
        yield Finding("table meta", "who was erased", "something unreadable", str(error))
        return
    for kind, note in sorted(in_tables - in_chain):
        study = json.loads(note)["study"]
        yield Finding(f"series {study}", f"an entry of the chain that it was {kind}", note, "none")
    frozen = [json.loads(note) for kind, note in in_tables if kind == "frozen"]
    joined = {(study["study"], study["commitment"]) for study in frozen}
    for kind, note in sorted(in_chain - in_tables):
        content = json.loads(note)
        if kind != "frozen" or (content["study"], content["commitment"]) in joined:
            mark = f"what the chain says was {kind}"
            yield Finding(f"series {content['study']}", mark, note, "not so in the tables")


def check_thing(
    conn: sqlite3.Connection, kind: Kind, ident: str, played: EpisodeRows | None = None
) -> Iterator[Finding]:
    """Yield the tables in which a thing's rows do not fit its entries in the chain.

    Args:
        played: An episode's rows where they have been read.
    """
    sql = """SELECT s.kind, s.first, s.salt, s.parts, c.is_sound, c.hash FROM chain_salts s LEFT JOIN chain c USING (number)
        WHERE s.id = ? AND s.kind IN (?, ?) ORDER BY s.kind, s.first"""
    entries = select(conn, sql, (ident, kind, "events" if kind == "episode" else kind)).fetchall()
    if not any(row[0] == kind for row in entries):
        wanted = "an entry of the chain for everything that is finished"
        yield Finding(place(Thing(kind, ident)), DIGEST, "missing", wanted)
    for of, first, salt, stored, is_sound, hash_ in entries:
        yield from _compare(conn, Thing(of, ident, first), salt, stored, is_sound, hash_, played)


def _compare(
    conn: sqlite3.Connection,
    thing: Thing,
    salt: bytes,
    stored: str,
    is_sound: int | None,
    hash_: str | None,
    played: EpisodeRows | None,
) -> Iterator[Finding]:
    name = place(thing)
    if is_sound == 0:
        reason = "another one when databases were merged or somebody was forgotten"
        yield Finding(name, DIGEST, hash_, reason)
        return
    try:
        parts = json.loads(stored)
        computed = combine(parts)
    except (ValueError, TypeError, AttributeError):
        yield Finding(name, DIGEST, stored, "the salted hashes by table, as JSON")
        return
    if computed != hash_:
        yield Finding(
            name, DIGEST, hash_ or "missing", f"{computed} from its salted hashes by table"
        )
    digest = compute(conn, thing, salt, played=played)
    for table in sorted(parts.keys() | digest.keys()):
        if parts.get(table) != digest.get(table):
            field = f"{DIGEST} in the table {table}"
            yield Finding(name, field, parts.get(table, "missing"), digest.get(table, "none"))


def check_without_owner(conn: sqlite3.Connection, owners: Mapping[Kind, str]) -> Iterator[Finding]:
    """Yield entries of what is no longer there.

    Args:
        owners: Kind -> SQL for the ids that may have an entry.
    """
    for kind, sql in owners.items():
        of = (kind, "events" if kind == "episode" else kind)
        lost = f"SELECT DISTINCT id FROM chain_salts WHERE kind IN (?, ?) AND id NOT IN ({sql})"
        for (ident,) in select(conn, lost, of).fetchall():
            owner = "nothing it belongs to (deleted or opened again)"
            yield Finding(place(Thing(kind, ident)), f"a digest of kind {kind}", "kept", owner)


def find_head(conn: sqlite3.Connection, wanted: str) -> EarlierHead | None:
    """Where a head stood and what came after it; None if it is not in this chain."""
    entry = select(conn, "SELECT number, day_ms FROM chain WHERE head = ?", [wanted]).fetchone()
    if entry is None:
        return None
    number, day_ms = entry
    kinds = dict(select(conn, "SELECT number, kind FROM chain WHERE number <= ?", [number]))
    added: Counter[str] = Counter()
    replaced, forgotten = set(), set()
    sql = "SELECT kind, replaces, note FROM chain WHERE number > ?"
    for kind, replaces, note in select(conn, sql, [number]):
        added[kind] += 1
        replaced.add(replaces)
        if kind == "forgotten":
            forgotten |= set(json.loads(note).get("forgotten", []))
    both = (replaced, forgotten)
    counts = [Counter(kinds[number_] for number_ in entries & kinds.keys()) for entries in both]
    return EarlierHead(wanted, number, day_ms, added, *counts)


def place(thing: Thing) -> str:
    """A thing as a finding names it."""
    return f"{'episode' if thing.kind == 'events' else thing.kind} {thing.id}"
