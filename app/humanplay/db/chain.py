"""An append-only chain of salted hashes: a changed row no longer fits its entry.

The table `chain` has an entry for each study and each daily terrain, each session with a move, each
finished episode with its steps and input events, each batch of input events that came after an
episode's end, and each state of a participant. Further entries say in words what fixes a study
(`Mark`): its freezing, an export while it is open, an operator's act, its end, the erasure of a
person, a release.

An entry's `hash` is SHA-256 over one salted hash for each table it covers. Its `head` is SHA-256
over the entry and the head before it, so a head that was printed or published stands for everything
up to it. The table `chain_salts` names what the latest entries stand for and holds their salts.
Without its salt nobody can find out what an entry was made of, not even by trying: when somebody is
forgotten their salts are deleted, and an entry of kind `forgotten` lists the entries that lost
them.

If an entry did not fit its rows on a merge, or when somebody was forgotten, it is not sound: it
keeps the hash that did not fit, and `verify` goes on reporting it.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import secrets
import sqlite3
import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

from pydantic_core import to_json

from humanplay.db.columns import TABLES
from humanplay.db.database import Row, SqlValue
from humanplay.db.rows import EventRow, MoveRow
from humanplay.db.study_rows import SeriesRow

Kind = Literal["series", "session", "episode", "events", "participant"]
"""What an entry stands for; `events` are input events that came after their episode's end."""

Mark = Literal["frozen", "exported", "acted", "closed", "erased", "released"]
"""What fixes a study or changes its estimates later; the entry says so in JSON, for anybody."""

Act = Literal["outcomes changed", "amounts listed", "unlinked"]
"""An operator's acts that are noted, without what was changed, listed or deleted."""

DAY_MS = 86_400_000
_SALT_BYTES = 32
_BEYOND = 2**62
"""Above every number of an input event."""


class Thing(NamedTuple):
    """What an entry stands for.

    Attributes:
        id: For kind `events` the episode's.
        first: For kind `events` the number of the first event.
    """

    kind: Kind
    id: str
    first: int = 0


class Head(NamedTuple):
    """The end of the chain.

    Attributes:
        entries: How many the chain has.
        head: Of the last entry (hex); empty without one.
    """

    entries: int
    head: str


class BegunHash(NamedTuple):
    """The salted hashes of an open episode's moves and input events so far.

    The entry of its end goes on with them, so a long episode is not hashed again at its end.

    Attributes:
        salt: Of the entry to come.
        until: Number of the first event that is not in it.
        events: SHA-256 of those that are.
        moves: How many moves are in it, and their SHA-256.
    """

    salt: bytes
    until: int
    events: hashlib._Hash
    moves: tuple[int, hashlib._Hash]


@dataclass(frozen=True)
class _Part:
    """The rows of a table that an entry covers, in all columns that are chained."""

    table: str
    condition: str

    @cached_property
    def columns(self) -> str:
        return ", ".join(TABLES[self.table].names("chain"))


_BETWEEN = "episode_id = :id AND number >= :first AND number < :until ORDER BY number"
_ANSWER = "block, turn, question"
_EVENTS = _Part("input_events", _BETWEEN)
_STEPS = _Part("steps", "episode_id = :id AND step >= :first_move ORDER BY step")
_PARTS: dict[Kind, tuple[_Part, ...]] = {
    "series": (_Part("series", "name = :id"),),
    "session": (
        _Part("sessions", "id = :id"),
        _Part(
            "players",
            "id IN (SELECT player_id FROM sessions WHERE id = :id UNION SELECT owner_id FROM sessions WHERE id = :id) "
            "ORDER BY id",
        ),
    ),
    "episode": (
        _Part("episodes", "id = :id"),
        _STEPS,
        _Part("series_episodes", "episode_id = :id"),
        _EVENTS,
    ),
    "events": (_EVENTS,),
    "participant": (
        _Part("participants", "id = :id"),
        _Part("stage_events", "participant_id = :id ORDER BY number"),
        _Part("identities", "participant_id = :id ORDER BY name"),
        _Part("answers", f"participant_id = :id ORDER BY {_ANSWER}, part"),
        _Part("free_texts", f"participant_id = :id ORDER BY {_ANSWER}"),
        _Part("players", "id = (SELECT player_id FROM participants WHERE id = :id)"),
    ),
}

OWNERS: dict[Kind, str] = {
    "series": "SELECT name FROM series",
    "session": "SELECT session_id FROM episodes e WHERE EXISTS (SELECT 1 FROM steps WHERE episode_id = e.id)",
    "episode": "SELECT id FROM episodes WHERE ended_ms IS NOT NULL",
    "participant": "SELECT id FROM participants",
}
"""Kind -> SQL for the ids of everything that has an entry."""


class EpisodeRows(NamedTuple):
    """The rows of an episode's moves and input events, read once for all users."""

    steps: list[MoveRow]
    events: list[EventRow]


def read_episode_rows(conn: sqlite3.Connection, episode_id: str) -> EpisodeRows:
    """Read the rows of an episode's moves and input events."""
    every: Row = {"id": episode_id, "first": 0, "until": _BEYOND, "first_move": 0}
    cursor = conn.cursor()
    cursor.row_factory = sqlite3.Row  # has names as a dictionary has, and takes a tenth of its time
    steps, events = (
        cursor.execute(_select_rows(part), every).fetchall() for part in (_STEPS, _EVENTS)
    )
    return EpisodeRows(steps, events)


def compute(
    conn: sqlite3.Connection,
    thing: Thing,
    salt: bytes,
    begun: BegunHash | None = None,
    played: EpisodeRows | None = None,
) -> dict[str, str]:
    """The salted SHA-256 (hex) of a thing's rows as they are now, by table.

    Args:
        begun: Of `begin_hash` with the same salt: the moves and input events that it covers are
            not read again.
        played: An episode's rows where they have been read.
    """
    until = _next_batch_start(conn, thing)
    first_move = 0 if begun is None else begun.moves[0]
    parts = {}
    for part in _PARTS[thing.kind]:
        if begun is not None and part is _EVENTS and until == _BEYOND:
            # it has all events: it fits only if no later batch takes some of them away
            digest, first = begun.events.copy(), begun.until
        elif begun is not None and part is _STEPS:
            digest, first = begun.moves[1].copy(), thing.first
        else:
            digest, first = _salted_hash(part, salt), thing.first
        rows: Sequence[Iterable[object]]
        if played is not None and part is _STEPS:
            rows = played.steps
        elif played is not None and part is _EVENTS:
            rows = [row for row in played.events if first <= row["number"] < until]
        else:
            bounds: Row = {"id": thing.id, "first": first, "until": until, "first_move": first_move}
            rows = select(conn, _select_rows(part), bounds).fetchall()
        digest.update(_lines(rows))
        parts[part.table] = digest.hexdigest()
    return parts


def begin_hash(conn: sqlite3.Connection, episode_id: str) -> BegunHash:
    """The hash of an open episode's moves and input events so far.

    Every connection can compute it before the episode's end.
    """
    salt, played = secrets.token_bytes(_SALT_BYTES), read_episode_rows(conn, episode_id)
    events, moves = _salted_hash(_EVENTS, salt), _salted_hash(_STEPS, salt)
    events.update(_lines(played.events))
    moves.update(_lines(played.steps))
    until = played.events[-1]["number"] + 1 if played.events else 0
    return BegunHash(salt, until, events, (len(played.steps), moves))


def _salted_hash(part: _Part, salt: bytes) -> hashlib._Hash:
    return hashlib.sha256(salt + canonical([part.table, part.columns]))


def _select_rows(part: _Part) -> str:
    return f"SELECT {part.columns} FROM {part.table} WHERE {part.condition}"


def combine(parts: Mapping[str, str]) -> str:
    """The hash of an entry: SHA-256 (hex) over its salted hashes by table."""
    return hashlib.sha256(canonical(list(parts.items()))).hexdigest()


def link(before: str, entry: Iterable[SqlValue]) -> str:
    """An entry's head: SHA-256 (hex) over the head before it and the entry.

    Args:
        entry: From its number to its note.
    """
    return hashlib.sha256(canonical([before, *entry])).hexdigest()


def head(conn: sqlite3.Connection) -> Head:
    """The end of the chain."""
    last = select(conn, "SELECT number, head FROM chain ORDER BY number DESC LIMIT 1").fetchone()
    return Head(0, "") if last is None else Head(*last)


def append(
    conn: sqlite3.Connection, kind: Kind, ident: str, first: int = 0, begun: BegunHash | None = None
) -> None:
    """Append an entry of a thing as it is now.

    Call it inside the transaction that wrote the rows. A thing that once did not fit its rows stays
    unsound: no later change makes it sound.

    Args:
        begun: Of an episode's moves and input events, if some of them were hashed before: they must
            be as they were then.
    """
    thing = Thing(kind, ident, first)
    sql = """SELECT hash FROM chain_salts s JOIN chain c USING (number)
        WHERE s.kind = ? AND s.id = ? AND s.first = ? AND NOT c.is_sound"""
    unsound = select(conn, sql, thing).fetchone()
    if unsound is not None:
        return append_unsound(conn, kind, ident, unsound[0])
    salt = secrets.token_bytes(_SALT_BYTES) if begun is None else begun.salt
    parts = compute(conn, thing, salt, begun=begun)
    return _append_entry(conn, thing, True, combine(parts), salt, parts)


def append_unsound(conn: sqlite3.Connection, kind: Kind, ident: str, stored: str) -> None:
    """Append an entry of a thing whose rows do not fit its entry.

    Args:
        stored: The hash of that entry.
    """
    _append_entry(conn, Thing(kind, ident), False, stored, secrets.token_bytes(_SALT_BYTES), {})


@contextmanager
def changing(conn: sqlite3.Connection, kind: Kind, ident: str) -> Iterator[None]:
    """Append an entry after the block, which changes a thing.

    A thing that did not fit its entry before stays unsound.
    """
    sql = "SELECT 1 FROM chain_salts WHERE kind = ? AND id = ?"
    is_known = select(conn, sql, (kind, ident)).fetchone() is not None
    stored = unsound_hash(conn, kind, ident) if is_known else None
    yield
    if stored is None:
        append(conn, kind, ident)
    else:
        append_unsound(conn, kind, ident, stored)


def append_late_events(conn: sqlite3.Connection, episode_id: str, first: int) -> None:
    """Append an entry of input events that came after their episode's end.

    While the episode runs nothing is appended: the entry of its end covers them.

    Args:
        first: Number of the first event.
    """
    sql = "SELECT 1 FROM episodes WHERE id = ? AND ended_ms IS NOT NULL"
    if select(conn, sql, [episode_id]).fetchone():
        append(conn, "events", episode_id, first)


def append_first_move(conn: sqlite3.Connection, episode_id: str) -> None:
    """Append an entry of an episode's session unless it has one.

    Call it in the transaction of an episode's first move.
    """
    sql = """SELECT session_id FROM episodes WHERE id = ?
        AND session_id NOT IN (SELECT id FROM chain_salts WHERE kind = 'session')"""
    for (session,) in select(conn, sql, [episode_id]).fetchall():
        append(conn, "session", session)


def append_note(
    conn: sqlite3.Connection, kind: Mark | Literal["forgotten", "merged"], content: object
) -> None:
    """Append an entry that stands for no rows and says something instead.

    Args:
        content: JSON-ready, and for anybody to read.
    """
    note = _note(content)
    _insert_entry(conn, kind, True, None, hashlib.sha256(note.encode()).hexdigest(), note)


def freezing_of(study: SeriesRow) -> tuple[Mark, str]:
    """The kind and the note of the entry that a study was frozen."""
    dry_run_of = json.loads(study.protocol).get("dry_run_of")
    return "frozen", _note(
        {
            **({} if dry_run_of is None else {"dry_run_of": dry_run_of}),
            "study": study.name,
            "commitment": study.commitment,
            "protocol_hash": study.protocol_hash,
            "frozen_ms": study.frozen_ms,
            "configuration": configuration_hash(study.protocol),
        }
    )


def configuration_hash(protocol: str) -> str:
    """SHA-256 (hex) over a protocol's task and configuration.

    Args:
        protocol: JSON.
    """
    parsed = json.loads(protocol)
    played = [parsed.get("task"), parsed.get("config")]
    return hashlib.sha256(json.dumps(played, sort_keys=True).encode()).hexdigest()


def export_of(study: SeriesRow) -> tuple[Mark, str]:
    """The (kind, note) of an export of an open study's episodes, made now."""
    named = {"study": study.name, "commitment": study.commitment}
    return "exported", _note({**named, "at_ms": time.time_ns() // 1_000_000})


def act_of(study: SeriesRow, act: Act, **details: int) -> tuple[Mark, str]:
    """The (kind, note) of an operator's act, made now."""
    named = {"study": study.name, "commitment": study.commitment, "act": act}
    return "acted", _note({**named, **details, "at_ms": time.time_ns() // 1_000_000})


def table_marks(conn: sqlite3.Connection) -> list[tuple[Mark, str]]:
    """(kind, note) of everything in the tables that fixed a study.

    That is the studies' rows, who was erased from them, and their releases.
    """
    studies = select(conn, "SELECT * FROM series WHERE kind = 'study' ORDER BY frozen_ms, name")
    notes: list[tuple[Mark, str]] = []
    for study in itertools.starmap(SeriesRow, studies):
        notes.append(freezing_of(study))
        if study.closed_ms is not None:
            named = {"study": study.name, "commitment": study.commitment}
            notes.append(("closed", _note({**named, "closed_ms": study.closed_ms})))
    for name, text in select(conn, "SELECT name, value FROM meta WHERE name LIKE 'erased|%'"):
        erased, row = json.loads(text), hashlib.sha256(canonical([name, text])).hexdigest()
        fields = ("stage", "after_closing", "ranked_ended", "asked_by")
        person = {field: erased[field] for field in fields}
        notes.append(("erased", _note({"study": name.split("|")[1], **person, "row": row})))
    columns = ("study", "version", "manifest_hash", "released_ms")
    for values in select(conn, f"SELECT {', '.join(columns)} FROM releases ORDER BY released_ms"):
        notes.append(("released", _note(dict(zip(columns, values, strict=True)))))
    return notes


def append_marks(conn: sqlite3.Connection, more: Iterable[tuple[Mark, str]] = ()) -> None:
    """Append an entry of everything that fixed a study and has no entry yet.

    Call it in the transaction that wrote it.

    Args:
        more: (kind, note) of what the tables do not have: freezings of studies that nobody has
            joined, exports, and operators' acts.
    """
    entries = set(select(conn, "SELECT kind, note FROM chain WHERE note IS NOT NULL"))
    for kind, note in dict.fromkeys((*more, *table_marks(conn))):
        if (kind, note) not in entries:
            append_note(conn, kind, json.loads(note))


def stored_marks(conn: sqlite3.Connection, study: str = "%") -> list[tuple[Mark, str]]:
    """Freezings, exports and operators' acts, which no table states for certain.

    Of one study: its own, and the freezings of others of its configuration.

    Args:
        study: Its name, or "%" for all studies.
    """
    sql = """SELECT kind, note FROM chain WHERE kind IN ('frozen', 'exported', 'acted')
        AND (json_extract(note, '$.study') LIKE ?1
        OR json_extract(note, '$.configuration') IN (SELECT json_extract(note, '$.configuration') FROM chain
            WHERE kind = 'frozen' AND json_extract(note, '$.study') = ?1)) ORDER BY number"""
    return select(conn, sql, [study]).fetchall()


def _note(content: object) -> str:
    return canonical(content).decode().rstrip()


def things(conn: sqlite3.Connection) -> set[Thing]:
    """Everything that must have an entry, apart from late input events."""
    return {Thing(kind, ident) for kind, sql in OWNERS.items() for (ident,) in select(conn, sql)}


def append_all(
    conn: sqlite3.Connection, wanted: Collection[Thing], unsound: Mapping[Thing, str] | None = None
) -> None:
    """Append an entry of each thing, in an order that tells nothing.

    Args:
        unsound: Thing -> stored hash, of those that do not fit their entries and stay so.
    """
    for thing in sorted(wanted):
        if unsound and thing in unsound:
            append_unsound(conn, thing.kind, thing.id, unsound[thing])
        else:
            append(conn, thing.kind, thing.id)


def unsound_hash(conn: sqlite3.Connection, kind: Kind, ident: str) -> str | None:
    """The hash of the first entry of a thing that does not fit its rows.

    An episode's entries are its own and those of the input events that came after its end.

    Returns:
        None if all fit; "missing" if there is no entry.
    """
    sql = """SELECT s.first, s.salt, c.kind, c.hash FROM chain_salts s LEFT JOIN chain c USING (number)
        WHERE s.id = ? AND s.kind IN (?, ?) ORDER BY s.kind, s.first"""
    entries = select(conn, sql, (ident, kind, _late_kind(kind))).fetchall()
    for first, salt, of, stored in entries:
        if of not in _PARTS or combine(compute(conn, Thing(of, ident, first), salt)) != stored:
            return str(stored or "missing")
    return None if any(row[2] == kind for row in entries) else "missing"


def forget(conn: sqlite3.Connection, erased: Iterable[Thing]) -> None:
    """Delete the salts of what is erased, and append an entry with their numbers.

    Late input events go with their episodes.
    """
    # without its salt a hash that stays in the chain can be tied to nobody, not even by trying
    sql = "DELETE FROM chain_salts WHERE id = ? AND kind IN (?, ?) RETURNING number"
    deleted = [
        select(conn, sql, (ident, kind, _late_kind(kind))).fetchall() for kind, ident, _ in erased
    ]
    numbers = sorted(number for rows in deleted for (number,) in rows)
    if numbers:
        append_note(conn, "forgotten", {"forgotten": numbers})


def _late_kind(kind: Kind) -> Kind:
    """The kind of entries that belong to a thing besides its own."""
    return "events" if kind == "episode" else kind


def _append_entry(
    conn: sqlite3.Connection,
    thing: Thing,
    is_sound: bool,
    hash_: str,
    salt: bytes,
    parts: Mapping[str, str],
) -> None:
    sql = "SELECT number FROM chain_salts WHERE kind = ? AND id = ? AND first = ?"
    replaces = select(conn, sql, thing).fetchone()
    number = _insert_entry(conn, thing.kind, is_sound, replaces and replaces[0], hash_, None)
    values = (*thing, number, salt, canonical(parts).decode().rstrip())
    conn.execute("INSERT OR REPLACE INTO chain_salts VALUES (?, ?, ?, ?, ?, ?)", values)


def _insert_entry(
    conn: sqlite3.Connection,
    kind: str,
    is_sound: bool,
    replaces: int | None,
    hash_: str,
    note: str | None,
) -> int:
    """Append an entry and return its number.

    Its time is the day alone, since entries outlive people who are forgotten.
    """
    last = head(conn)
    now = time.time_ns() // 1_000_000
    entry = (last.entries + 1, now - now % DAY_MS, kind, int(is_sound), replaces, hash_, note)
    values = (*entry, link(last.head, entry))
    conn.execute("INSERT INTO chain VALUES (?, ?, ?, ?, ?, ?, ?, ?)", values)
    return entry[0]


def _next_batch_start(conn: sqlite3.Connection, thing: Thing) -> int:
    """Number of the input event with which the next entry of an episode begins."""
    if thing.kind not in ("episode", "events"):
        return _BEYOND
    sql = "SELECT min(first) FROM chain_salts WHERE kind = 'events' AND id = ? AND first > ?"
    after = thing.first if thing.kind == "events" else -1
    (first,) = select(conn, sql, (thing.id, after)).fetchone()
    return _BEYOND if first is None else int(first)


def select(
    conn: sqlite3.Connection, sql: str, values: Sequence[SqlValue] | Row = ()
) -> sqlite3.Cursor:
    """A query's cursor whose rows are plain tuples, whatever the connection's factory."""
    cursor = conn.cursor()
    cursor.row_factory = None
    return cursor.execute(sql, values)


_encode = json.JSONEncoder(default=bytes.hex, separators=(",", ":")).encode


def canonical(content: object) -> bytes:
    """The one line of JSON that is hashed; bytes are hexadecimal."""
    return _encode(content).encode() + b"\n"


_EXPONENT = re.compile(rb"e[-+]?\d+[],]")


def _lines(rows: Iterable[Iterable[object]]) -> bytes:
    """The lines of JSON that are hashed of some rows.

    A quick encoder writes them wherever it writes exactly what `canonical` does.
    """
    tuples = [tuple(row) for row in rows]
    text = to_json(tuples, bytes_mode="hex", inf_nan_mode="constants")[1:-1]
    is_same = (
        text.isascii()
        and b"\x7f" not in text
        and b"0.0000" not in text  # numbers near 0 and large ones are written in another way
        and _EXPONENT.search(text) is None
        and text.count(b"],[") == len(tuples) - 1  # between two rows alone, and inside no text
    )
    if is_same:
        return text.replace(b"],[", b"]\n[") + b"\n"
    return b"".join(map(canonical, tuples))
