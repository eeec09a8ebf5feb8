"""Rows of one database merged into another.

New rows are added, equal ones are left as they are, and two contents under one id are refused.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from humanplay.db import chain, volunteers
from humanplay.db.chain import Kind, Thing
from humanplay.db.columns import TABLES
from humanplay.db.database import (
    Row,
    SqlValue,
    StoreError,
    open_database,
    reading,
    rows,
    stream,
    transaction,
)
from humanplay.db.erasure import forgotten_people, learn_forgotten
from humanplay.db.file import recordings_beside
from humanplay.db.recording_files import copy_recordings
from marsexplorer.files import replace_whole

NOT_MERGED = (
    *("meta", "series", "event_batches", "page_loads", "forgotten", "forgotten_people", "chain"),
    *("chain_salts", "volunteers", "volunteer_figures", "names"),
)
"""Series and the forgotten are merged by themselves. The key that signs cookies and the secret of
daily terrains stay where they are. So do names: without that key nobody could change a name in the
new file, and two servers may have one name twice. So does the chain: two of them cannot be one, so
the target's own goes on, with an entry that holds the heads of the sources."""

MERGED = {name: table for name, table in TABLES.items() if table.names() and name not in NOT_MERGED}
ROWS_AT_A_TIME = 2_000
_OWNED: dict[str, Kind] = {"episodes": "episode", "participants": "participant"}
"""Table -> the kind of the thing in the chain whose parts are the rows that refer to it first."""

_TAKEN_PART_TWICE = """SELECT count(*) FROM (SELECT 1 FROM identities i JOIN participants p ON p.id = i.participant_id
    WHERE i.name = (SELECT json_extract(s.protocol, '$.outside_ids[0]') FROM series s WHERE s.name = p.study)
    GROUP BY p.study, i.name, i.value HAVING count(*) > 1
    UNION ALL SELECT 1 FROM participants WHERE invitation IS NOT NULL AND consent_ms IS NOT NULL
    GROUP BY study, invitation HAVING count(*) > 1)"""


class MergeError(StoreError):
    """Two contents stand under one id, or the new file is there already."""


@dataclass
class MergeCounts:
    """Rows that were added and rows that were there already, by table.

    Attributes:
        forgotten: People who were left out because they were forgotten.
    """

    added: dict[str, int] = field(default_factory=dict)
    equal: dict[str, int] = field(default_factory=dict)
    forgotten: int = 0

    def add(self, other: MergeCounts) -> None:
        """Add the counts of a further source."""
        for name, count in other.added.items():
            self.added[name] = self.added.get(name, 0) + count
            self.equal[name] = self.equal.get(name, 0) + other.equal[name]
        self.forgotten += other.forgotten


def merge(
    sources: Sequence[Path],
    out: Path,
    advance: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[MergeCounts, int]:
    """Merge databases into a new one.

    Args:
        advance: Called with (databases merged, databases in all).

    Returns:
        The counts, and how many people took part in a study twice.

    Raises:
        MergeError: If there is a file at `out` already, or two contents under one id; nothing is
            written then.
    """
    recorded = recordings_beside(out)
    for path in (out, recorded):
        if path.exists():
            raise MergeError(
                f"{path} is there already: a merge is written into a new file; choose another --out"
            )
    total = MergeCounts()
    with _new_database(out) as conn, replace_whole(recorded) as unfinished, transaction(conn):
        unfinished.mkdir(parents=True)
        for path in sources:
            with reading(path) as source:
                learn_forgotten(conn, source)
        for done, path in enumerate(sources, 1):
            with reading(path) as source:
                total.add(merge_rows(conn, source, str(path)))
            copy_recordings(conn, recordings_beside(path), unfinished)
            advance(done, len(sources))
        (twice,) = conn.execute(_TAKEN_PART_TWICE).fetchone()
    with suppress(OSError):  # unless there is a recording in it
        recorded.rmdir()
    return total, twice


def merge_rows(
    target: sqlite3.Connection, source: sqlite3.Connection, source_name: str
) -> MergeCounts:
    """Add the source's rows to the target's, inside a transaction of the target.

    People whom either of the two has forgotten are left out; bring the lists of all sources into
    the target first (`learn_forgotten`).

    Args:
        source_name: The source in words, for the error.

    Raises:
        MergeError: If both have something under one id and it is not the same.
    """
    counts = MergeCounts()
    target.execute("PRAGMA defer_foreign_keys = ON")
    before = chain.things(target)
    counted = _parts_of(target, before)
    _merge_series(target, source, source_name)
    hidden = _hidden_ids(target, source)
    counts.forgotten = len(hidden["participants"])
    for table in MERGED:
        wanted = _visible(table, stream(source, f"SELECT * FROM {table}"), hidden)
        if table == "releases":
            wanted = _mark_outdated(target, wanted)
        counts.added[table], counts.equal[table] = _merge_table(target, table, wanted, source_name)
    in_source = chain.things(source)
    merged = {thing for thing in in_source if thing.id not in hidden.get(f"{thing.kind}s", ())}
    _check_same_parts(counted, _parts_of(source, merged & before), source_name)
    volunteers.renew(target)
    _extend_chain(target, source, chain.things(target) - before, merged)
    return counts


def _extend_chain(
    target: sqlite3.Connection, source: sqlite3.Connection, added: set[Thing], merged: set[Thing]
) -> None:
    """Append the source's head and an entry of everything added.

    What did not fit its entry in the source stays so.

    Args:
        added: What is new in the target.
        merged: Everything of the source that was merged, new or not.
    """
    entries, head = chain.head(source)
    chain.append_note(target, "merged", {"merged": {"head": head, "entries": entries}})
    stored = {thing: chain.unsound_hash(source, thing.kind, thing.id) for thing in merged}
    unsound = {thing: hash_ for thing, hash_ in stored.items() if hash_ is not None}
    chain.append_all(target, added | unsound.keys(), unsound)
    chain.append_marks(target)


def _parts_of(conn: sqlite3.Connection, wanted: set[Thing]) -> dict[Thing, dict[str, int]]:
    """Count the rows that finished episodes and participants have in other tables.

    Returns:
        Thing -> table -> number of rows.
    """
    wholes = [thing for thing in wanted if thing.kind in ("episode", "participant")]
    parts: dict[Thing, dict[str, int]] = {thing: {} for thing in wholes}
    for table in MERGED.values() if parts else ():
        column, (of, _) = next(iter(table.references().items()), ("", ("", "")))
        if of in _OWNED:
            counted = f"SELECT {column}, count(*) FROM {table.name} GROUP BY {column}"
            for ident, count in conn.execute(counted):
                if (thing := Thing(_OWNED[of], ident)) in parts:
                    parts[thing][table.name] = count
    return parts


def _check_same_parts(
    old: dict[Thing, dict[str, int]], new: dict[Thing, dict[str, int]], source_name: str
) -> None:
    """Raise MergeError if a thing's rows differ in number from the target's."""
    for thing, counts in new.items():
        if old[thing] != counts:
            raise MergeError(
                f"the {thing.kind} {thing.id} has other rows in {source_name} than before "
                f"({counts}, not {old[thing]}): nothing was joined; one of the two was changed, or is an "
                "older copy"
            )


def _hidden_ids(target: sqlite3.Connection, source: sqlite3.Connection) -> dict[str, set[SqlValue]]:
    """The source's ids that are not to be merged, by table."""
    people = forgotten_people(target, source)
    hidden: dict[str, set[SqlValue]] = {"players": set(), "sessions": set()}
    hidden["participants"] = {person.id for person in people}
    for person in people:
        sessions = "SELECT id FROM sessions WHERE ? IN (player_id, owner_id) OR id = ?"
        played = source.execute(sessions, (person.player_id, person.session_id))
        hidden["sessions"] |= {row[0] for row in played}
        sql = "SELECT id, session_id FROM participants WHERE player_id = ?"
        in_studies = source.execute(sql, [person.player_id])
        elsewhere = [row for row in in_studies if row[0] not in hidden["participants"]]
        hidden["sessions"] -= {row[1] for row in elsewhere}
        if not elsewhere:
            hidden["players"].add(person.player_id)
    sql = "SELECT id, session_id FROM episodes"
    every = source.execute(sql).fetchall() if hidden["sessions"] else []
    hidden["episodes"] = {ident for ident, session in every if session in hidden["sessions"]}
    return hidden


def _visible(
    table: str, rows_of_table: Iterable[Row], hidden: dict[str, set[SqlValue]]
) -> Iterator[Row]:
    names = {name: of for name, (of, _) in MERGED[table].references().items()}
    if "id" in MERGED[table].names():
        names["id"] = table
    for row in rows_of_table:
        if row.get("challenges") in hidden["episodes"]:
            row["challenges"] = None
        if not any(row[name] in hidden.get(of, ()) for name, of in names.items()):
            yield row


def _mark_outdated(target: sqlite3.Connection, releases: Iterator[Row]) -> Iterator[Row]:
    """Yield releases, outdated since the earlier of both databases' times.

    The target's rows are changed as well.
    """
    match = "study = ? AND version = ? AND manifest_hash = ? AND released_ms = ?"
    for row in releases:
        key = row["study"], row["version"], row["manifest_hash"], row["released_ms"]
        for stored in rows(target, f"SELECT outdated_ms FROM releases WHERE {match}", *key):
            times: set[int] = {stored["outdated_ms"], row["outdated_ms"]} - {None}
            row["outdated_ms"] = min(times, default=None)
            sql = f"UPDATE releases SET outdated_ms = ? WHERE {match}"
            target.execute(sql, (row["outdated_ms"], *key))
        yield row


def _merge_table(
    target: sqlite3.Connection, table: str, wanted: Iterator[Row], source_name: str
) -> tuple[int, int]:
    """How many rows were added, and how many were there already."""
    columns, insert = MERGED[table].names(), MERGED[table].insert(how="INSERT OR IGNORE")
    added = equal = 0
    while chunk := [tuple(row[name] for name in columns) for row in islice(wanted, ROWS_AT_A_TIME)]:
        count = target.executemany(insert, chunk).rowcount
        added += count
        if count < len(chunk):
            equal += len(chunk) - count
            _check_equal(target, table, chunk, source_name)
    return added, equal


def _check_equal(
    target: sqlite3.Connection, table: str, chunk: list[tuple[SqlValue, ...]], source_name: str
) -> None:
    """Raise MergeError if a row of the chunk is not in the target exactly so."""
    columns = MERGED[table].names()
    match = " AND ".join(f"{name} IS ?" for name in columns)
    keys = [row[1] for row in target.execute(f"PRAGMA table_info({table})") if row[5]]
    for row in chunk:
        if target.execute(f"SELECT 1 FROM {table} WHERE {match}", row).fetchone() is None:
            pairs = zip(columns, row, strict=True)
            named = ", ".join(
                f"{name} {content}"
                for name, content in pairs
                if name in keys and not isinstance(content, bytes)
            )
            raise MergeError(
                f"the table {table} has {named} with another content in {source_name} than before: "
                "nothing was joined; one of the two was changed, or they are a copy and its original "
                "under other names"
            )


ENDS = ("closed_ms", "secret", "secret_kept_ms")
"""What the end of a study writes into its row."""


def _merge_series(target: sqlite3.Connection, source: sqlite3.Connection, source_name: str) -> None:
    for row in rows(source, "SELECT * FROM series"):
        present = rows(target, "SELECT * FROM series WHERE name = ?", row["name"])
        if not present:
            target.execute(TABLES["series"].insert(), list(row.values()))
            continue
        _check_same_series(present[0], row, source_name)
        if all(present[0][name] is not None or row[name] is None for name in ENDS):
            continue
        with chain.changing(target, "series", row["name"]):
            target.execute(
                f"UPDATE series SET {', '.join(f'{name} = coalesce({name}, ?)' for name in ENDS)} WHERE name = ?",
                (*(row[name] for name in ENDS), row["name"]),
            )


def _check_same_series(old: Row, row: Row, source_name: str) -> None:
    """Raise MergeError if two studies of one name are not one study."""
    fixed = ("protocol_hash", "commitment", "protocol", "frozen_ms")
    for name in fixed:
        if old[name] != row[name]:
            raise MergeError(
                f"the study {row['name']!r} in {source_name} has another {name} than before: they are two studies of one name; "
                "nothing was joined"
            )
    if old["secret"] is not None and row["secret"] not in (None, old["secret"]):
        raise MergeError(
            f"the study {row['name']!r} in {source_name} has another secret than before: nothing was joined"
        )


@contextmanager
def _new_database(out: Path) -> Iterator[sqlite3.Connection]:
    """Open a database that gets its name when the block ends well; else it is gone."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with replace_whole(out) as unfinished:
            conn: sqlite3.Connection = open_database(unfinished).conn
            try:
                yield conn
            finally:
                conn.close()
    except sqlite3.Error as error:
        raise StoreError(f"cannot write {out}: {error}; choose another --out") from error


@contextmanager
def kept_or_new_database(database: Path) -> Iterator[sqlite3.Connection]:
    """Open a database for a merge; create it if need be.

    If the block fails, a database that was created here is removed again.
    """
    was_there = database.exists()
    try:
        conn: sqlite3.Connection = open_database(database).conn
        try:
            yield conn
        finally:
            conn.close()
    except BaseException as error:
        if not was_there:
            _remove(database)
        if isinstance(error, sqlite3.Error):
            raise StoreError(
                f"the database {database} did not take the release, nothing changed: {error}"
            ) from error
        raise


def _remove(path: Path) -> None:
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
