"""The chain checked: every head made again, every entry with what it stands for, every thing with its entries.

`app.storage.checks` says whose rows are checked; `app.storage.chain` says what an entry is.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from app.storage.chain import UNSOUND, Kind, Thing, combine, compute, head, link, select
from app.storage.connection import is_copy
from app.storage.resimulation import Finding

DIGEST = "digest of its stored fields"
"""What a finding calls the hash of an entry."""


@dataclass(frozen=True)
class ChainState:
    """What the chain is.

    entries    how many; the head is that of the last
    head       hex; empty without an entry
    forgotten  entries whose salts were deleted when somebody was forgotten
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


@dataclass
class _Walk:
    """The entries that nothing has replaced or forgotten so far: number -> kind; `forgotten` counts the latter."""

    live: dict[int, str] = field(default_factory=dict)
    forgotten: int = 0

    def take(self, row: tuple[Any, ...]) -> Iterator[str]:
        """Take the next entry, and yield what does not fit those before it."""
        number, _, kind, _, replaces, hash_, note, _ = row
        if note is not None and hashlib.sha256(note.encode()).hexdigest() != hash_:
            yield "a note that its hash does not stand for"
        if replaces is not None and self.live.pop(replaces, None) != kind:
            yield f"in place of entry {replaces}, which is not one of kind {kind} that is in force"
        gone = json.loads(note or "{}").get("forgotten", []) if kind == "forgotten" else []
        for each in gone:
            if self.live.pop(each, None) is None:
                yield f"entry {each} forgotten, which is not in force"
        self.forgotten += len(gone)
        if note is None:
            self.live[number] = kind


_ENTRIES = (
    "SELECT number, day_ms, kind, version, replaces, hash, note, head FROM chain ORDER BY number"
)


def chain_state(conn: sqlite3.Connection) -> ChainState | None:
    """Return what the chain is; None for the copy of an earlier schema, whose chain is made anew with each reading."""
    if is_copy(conn):
        return None
    notes = select(conn, "SELECT note FROM chain WHERE kind = 'forgotten' AND json_valid(note)")
    return ChainState(
        *head(conn), sum(len(json.loads(note).get("forgotten", [])) for (note,) in notes)
    )


def check_chain(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield what is wrong with the chain itself: entries changed, added or taken away, and salts that do not fit them."""
    walk, before, number = _Walk(), "", 0
    for row in select(conn, _ENTRIES):
        where = f"chain entry {row[0]}"
        if row[0] != number + 1:
            yield Finding(
                where,
                "the entry before it",
                row[0] - 1 if number else "none",
                number or "none: the first is missing",
            )
        if (made := link(before, row[:-1])) != row[-1]:
            yield Finding(where, "its head", row[-1], made)
        number, before = row[0], row[-1]
        try:
            yield from (
                Finding(where, "it", what, "what the entries before it allow")
                for what in walk.take(row)
            )
        except (ValueError, TypeError, AttributeError) as error:
            yield Finding(where, "its note", row[6], f"JSON of this version: {error}")
    yield from _check_salts(conn, walk.live)


def _check_salts(conn: sqlite3.Connection, live: dict[int, str]) -> Iterator[Finding]:
    """Yield salts of entries that are not in force, and entries in force whose salts are gone."""
    sql = "SELECT kind, id, first, number FROM chain_salts ORDER BY number"
    for kind, ident, first, number in select(conn, sql):
        if live.pop(number, None) != kind or (first and kind != "events"):
            what = f"the entry of its kind ({kind})"
            yield Finding(
                place(Thing(kind, ident, first)),
                what,
                f"number {number}",
                "no such entry in force in the chain",
            )
    for number, kind in live.items():
        what = f"what it stands for (kind {kind})"
        yield Finding(f"chain entry {number}", what, "gone", "no entry that says it was forgotten")


def check_thing(conn: sqlite3.Connection, kind: Kind, ident: str) -> Iterator[Finding]:
    """Yield the tables in which a thing's rows are not those of its entries in the chain."""
    sql = """SELECT s.kind, s.first, s.salt, s.parts, c.version, c.hash FROM chain_salts s LEFT JOIN chain c USING (number)
        WHERE s.id = ? AND s.kind IN (?, ?) ORDER BY s.kind, s.first"""
    found = select(conn, sql, (ident, kind, "events" if kind == "episode" else kind)).fetchall()
    if not any(row[0] == kind for row in found):
        yield Finding(
            place(Thing(kind, ident)),
            DIGEST,
            "missing",
            "an entry of the chain for everything that is finished",
        )
    for of, first, salt, stored, version, hash_ in found:
        yield from _compare(conn, Thing(of, ident, first), salt, stored, version, hash_)


def _compare(
    conn: sqlite3.Connection,
    thing: Thing,
    salt: bytes,
    stored: str,
    version: int | None,
    hash_: str | None,
) -> Iterator[Finding]:
    where = place(thing)
    if version == UNSOUND:
        yield Finding(
            where,
            DIGEST,
            hash_,
            "another one when the database was upgraded, merged or somebody forgotten",
        )
        return
    try:
        parts = json.loads(stored)
        found = compute(conn, thing, salt, version or 0)
        if combine(parts) != hash_:
            yield Finding(
                where,
                DIGEST,
                hash_ or "missing",
                f"{combine(parts)} from its salted hashes by table",
            )
    except (KeyError, ValueError, TypeError, AttributeError):
        yield Finding(
            where, DIGEST, f"of version {version}", "one that this version of the software knows"
        )
        return
    for table in sorted(parts.keys() | found.keys()):
        if parts.get(table) != found.get(table):
            yield Finding(
                where,
                f"{DIGEST} in the table {table}",
                parts.get(table, "missing"),
                found.get(table, "none"),
            )


def check_without_owner(conn: sqlite3.Connection, owners: Mapping[Kind, str]) -> Iterator[Finding]:
    """Yield entries of what is no longer there; `owners` is SQL for the ids of each kind that may have one."""
    for kind, sql in owners.items():
        of = (kind, "events" if kind == "episode" else kind)
        lost = f"SELECT DISTINCT id FROM chain_salts WHERE kind IN (?, ?) AND id NOT IN ({sql})"
        for (ident,) in select(conn, lost, of).fetchall():
            found = "nothing it belongs to (deleted or opened again)"
            yield Finding(place(Thing(kind, ident)), f"a digest of kind {kind}", "kept", found)


def find_head(conn: sqlite3.Connection, wanted: str) -> EarlierHead | None:
    """Return where a head stood and what came after it; None when it is not in this chain."""
    found = select(conn, "SELECT number, day_ms FROM chain WHERE head = ?", [wanted]).fetchone()
    if found is None:
        return None
    number, day_ms = found
    kinds = dict(select(conn, "SELECT number, kind FROM chain WHERE number <= ?", [number]))
    added: Counter[str] = Counter()
    replaced, forgotten = set(), set()
    for kind, replaces, note in select(
        conn, "SELECT kind, replaces, note FROM chain WHERE number > ?", [number]
    ):
        added[kind] += 1
        replaced.add(replaces)
        if kind == "forgotten":
            forgotten |= set(json.loads(note).get("forgotten", []))
    counts = [
        Counter(kinds[each] for each in which & kinds.keys()) for which in (replaced, forgotten)
    ]
    return EarlierHead(wanted, number, day_ms, added, *counts)


def place(thing: Thing) -> str:
    """Return a thing as a finding names it."""
    return f"{'episode' if thing.kind == 'events' else thing.kind} {thing.id}"
