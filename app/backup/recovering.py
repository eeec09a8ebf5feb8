"""A damaged database read out: what can be read goes into a new file, and what does not fit together is left out of it.

An ended episode stays if all its moves are there. One that was still running stays up to its first missing move. A row that
belongs to nothing any more is left out. An episode whose session was lost gets one without a player, so that it stays, and
counts for nobody. What was lost is counted.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from app.backup.salvage import Row, TableSalvage
from app.storage.database import StoreError, damaged, migrate, open_database, recognise, transaction
from app.storage.migrations import MIGRATIONS

_MAX_PASSES = 20
_STAND_IN_SESSIONS = """INSERT INTO sessions (id, driver_name, pace_mode, moves_per_second, created_ms)
    SELECT session_id, CASE WHEN driver LIKE 'policy:%' THEN substr(driver, 8) ELSE 'human' END, 'paused', 8.0, min(started_ms)
    FROM episodes WHERE session_id NOT IN (SELECT id FROM sessions) GROUP BY session_id"""
_STAND_IN_PLAYERS = """INSERT OR IGNORE INTO players (id, created_ms) SELECT id, 0 FROM (SELECT player_id AS id FROM sessions
    UNION SELECT owner_id FROM sessions UNION SELECT player_id FROM participants) WHERE id IS NOT NULL"""
_CUT = """DELETE FROM steps WHERE step >= (SELECT min(a.step) + 1 FROM steps a WHERE a.episode_id = steps.episode_id
    AND NOT EXISTS (SELECT 1 FROM steps b WHERE b.episode_id = a.episode_id AND b.step = a.step + 1))"""
_HEADLESS = "DELETE FROM steps WHERE NOT EXISTS (SELECT 1 FROM steps a WHERE a.episode_id = steps.episode_id AND a.step = 0)"
_INCOMPLETE = """DELETE FROM episodes WHERE ended_ms IS NOT NULL
    AND steps != (SELECT count(*) FROM steps s WHERE s.episode_id = episodes.id)"""


@dataclass
class Recovery:
    """What was read, and what was lost.

    read      rows in the new file by table
    left_out  rows that could be read and were left out, by table, since they belong to nothing or are not complete
    broken    tables with pages that could not be read
    stand_ins rows that stand for lost sessions and players
    """

    read: dict[str, int] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)
    stand_ins: int = 0

    def lines(self) -> list[str]:
        """Return the report as lines of text."""
        lines = [
            f"{table}: {count:,} rows in the new file" + self._lost(table)
            for table, count in self.read.items()
        ]
        whole = (
            "every page could be read"
            if not self.broken
            else f"pages could not be read of: {', '.join(self.broken)}"
        )
        if self.stand_ins:
            whole += f"; {self.stand_ins:,} lost sessions and players have a row that says nothing of them"
        return [whole, *lines]

    def _lost(self, table: str) -> str:
        out = self.left_out.get(table, 0)
        parts = ["; others could not be read"] if table in self.broken else []
        return "".join(
            [
                *parts,
                f"; {out:,} that could be read are left out, since they are not complete"
                if out
                else "",
            ]
        )


def recover(
    database: Path, out: Path, advance: Callable[[int, int], None] | None = None
) -> Recovery:
    """Read out a damaged database into a new file and return what was lost; the database stays as it is.

    advance  called with (tables read, of how many)

    StoreError when `out` exists, when the disk is full, and when the database is not one of ours or its first page is gone.
    """
    if out.exists():
        raise StoreError(f"{out} exists already: give a new file's name with --out")
    if not database.exists():
        raise StoreError(f"no database at {database}: give the path of the damaged one")
    recognise(database)
    try:
        with closing(_open_damaged(database)) as source:
            version = int(source.execute("PRAGMA user_version").fetchone()[0])
            if not 0 < version <= len(MIGRATIONS):
                raise StoreError(
                    f"{database} has schema {version}, this version knows 1 to {len(MIGRATIONS)}"
                )
            source.execute("SELECT name FROM sqlite_master").fetchall()
            with closing(open_database(out, migrations=MIGRATIONS[:version]).conn) as target:
                found = _fill(source, target, advance)
                migrate(target, out)
                target.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                target.execute("PRAGMA journal_mode = DELETE")
        return found
    except BaseException as error:
        for suffix in ("", "-wal", "-shm"):
            out.with_name(out.name + suffix).unlink(missing_ok=True)
        if isinstance(error, sqlite3.OperationalError):
            raise StoreError(f"cannot write {out}: {error}") from error
        if isinstance(error, sqlite3.DatabaseError):
            raise StoreError(
                f"{damaged(database, str(error))}; its first page cannot be read, so a backup is the way"
            ) from error
        raise


def _open_damaged(database: Path) -> sqlite3.Connection:
    conn = sqlite3.connect(database.resolve().as_uri() + "?mode=ro", uri=True, isolation_level=None)
    conn.execute("BEGIN")
    return conn


def _fill(
    source: sqlite3.Connection,
    target: sqlite3.Connection,
    advance: Callable[[int, int], None] | None,
) -> Recovery:
    """Copy what can be read, table by table, and leave out what does not fit together."""
    found = Recovery()
    target.execute("PRAGMA foreign_keys = OFF")
    tables = dict(
        target.execute(
            "SELECT name, sql FROM sqlite_master WHERE type = 'table' ORDER BY rowid"
        ).fetchall()
    )
    with transaction(target):
        for number, (table, sql) in enumerate(tables.items(), 1):
            columns = target.execute(
                f"SELECT name, pk FROM pragma_table_info('{table}')"
            ).fetchall()
            names = [name for name, _ in columns]
            key = [
                name for name, place in sorted(columns, key=lambda column: int(column[1])) if place
            ]
            salvage = TableSalvage(source, table, names)
            marks = ", ".join("?" * len(names))
            target.executemany(
                f"INSERT OR IGNORE INTO {table} VALUES ({marks})",
                _rows(salvage, target, key, "WITHOUT ROWID" not in sql),
            )
            if not salvage.is_whole:
                found.broken.append(table)
            if advance is not None:
                advance(number, len(tables))
        found.stand_ins = target.execute(_STAND_IN_SESSIONS).rowcount
        if "participants" in tables:
            found.stand_ins += target.execute(_STAND_IN_PLAYERS).rowcount
        before = _counts(target, tables)
        _leave_out(target, list(tables))
        found.read = _counts(target, tables)
        found.left_out = {
            table: before[table] - count
            for table, count in found.read.items()
            if before[table] > count
        }
    target.execute("PRAGMA foreign_keys = ON")
    return found


def _rows(
    salvage: TableSalvage, target: sqlite3.Connection, key: list[str], has_rowid: bool
) -> Iterator[Row]:
    if has_rowid:
        yield from salvage.by_rowid()
        return
    yield from salvage.from_both_ends(", ".join(key))
    if not salvage.is_whole and key[0] == "episode_id":
        episodes = [ident for (ident,) in target.execute("SELECT id FROM episodes")]
        yield from salvage.by_keys(key[0], episodes, key[1])


def _counts(conn: sqlite3.Connection, tables: dict[str, str]) -> dict[str, int]:
    return {
        table: int(conn.execute(f"SELECT count(*) FROM {table}").fetchone()[0]) for table in tables
    }


def _leave_out(conn: sqlite3.Connection, tables: list[str]) -> None:
    """Delete moves after a missing one, ended episodes without all their moves, and rows that belong to nothing."""
    for sql in (_HEADLESS, _CUT, _INCOMPLETE):
        conn.execute(sql)
    for _ in range(_MAX_PASSES):
        deleted = 0
        for table in tables:
            keys = 'SELECT "from", "table", coalesce("to", \'\') FROM pragma_foreign_key_list(?)'
            for column, parent, to in conn.execute(keys, [table]).fetchall():
                name = (
                    to
                    or conn.execute(
                        "SELECT name FROM pragma_table_info(?) WHERE pk = 1", [parent]
                    ).fetchone()[0]
                )
                stray = f"{column} IS NOT NULL AND {column} NOT IN (SELECT {name} FROM {parent})"
                deleted += conn.execute(f"DELETE FROM {table} WHERE {stray}").rowcount
        if not deleted:
            return
