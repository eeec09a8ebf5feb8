"""Whole databases: several joined into a new one, and a released bundle brought into one."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from app.release.dataset import verify_dataset
from app.release.errors import ReleaseError
from app.release.header import DATABASE
from app.release.join import Joined, join, learn_forgotten
from app.storage.connection import reading
from app.storage.database import StoreError, open_database, take_lock, transaction
from marsexplorer.files import replace_whole

Advance = Callable[[int, int], None]

_TWICE = """SELECT count(*) FROM (SELECT 1 FROM identities i JOIN participants p ON p.id = i.participant_id
    WHERE i.name = (SELECT json_extract(s.protocol, '$.outside_ids[0]') FROM studies s WHERE s.name = p.study)
    GROUP BY p.study, i.name, i.value HAVING count(*) > 1)"""


def merge(sources: Sequence[Path], out: Path, advance: Advance = lambda done, total: None) -> tuple[Joined, int]:
    """Return what came of joining databases into a new one, and how many people took part in a study twice.

    advance  called with (databases joined, of how many)

    ReleaseError when there is a file at `out` already, or two contents under one id; then nothing is written.
    """
    if out.exists():
        raise ReleaseError(f"{out} is there already: a merge is written into a new file; choose another --out")
    total = Joined()
    with _new_database(out) as conn, transaction(conn):
        for path in sources:
            with reading(path) as source:
                learn_forgotten(conn, source)
        for done, path in enumerate(sources, 1):
            with reading(path) as source:
                part = join(conn, source, str(path))
            for name, count in part.added.items():
                total.added[name] = total.added.get(name, 0) + count
                total.equal[name] = total.equal.get(name, 0) + part.equal[name]
            total.forgotten += part.forgotten
            advance(done, len(sources))
        (twice,) = conn.execute(_TWICE).fetchone()
    return total, twice


def import_release(folder: Path, database: Path, advance: Advance = lambda done, total: None) -> Joined:
    """Return what came of bringing a release into a database, made when absent.

    advance  called with (episodes verified, of how many)

    ReleaseError when the release does not verify, or the database holds its episodes under other names; StoreError while a
    server has the database. Nothing is changed then.
    """
    checked = verify_dataset(folder, advance)
    if checked.verified.findings:
        more = len(checked.verified.findings) - 1
        also = f" and {more} more" if more else ""
        raise ReleaseError(
            f"no import: {checked.verified.findings[0]}{also}; `marsexplorer verify --dataset {folder}` lists all"
        )
    manifest = checked.manifest
    released_ms = int(datetime.fromisoformat(manifest["released"]).timestamp() * 1000)
    lock = take_lock(database)
    try:
        with _kept_or_new(database) as conn, reading(folder / DATABASE) as source, transaction(conn):
            joined = join(conn, source, str(folder))
            values = (manifest["study"], manifest["version"], checked.manifest_hash, released_ms)
            if not manifest["interim"]:
                conn.execute("INSERT OR IGNORE INTO releases VALUES (?, ?, ?, ?, NULL)", values)
        return joined
    finally:
        lock.close()
        if not database.exists():
            database.with_name(database.name + "-lock").unlink(missing_ok=True)


@contextmanager
def _new_database(out: Path) -> Iterator[sqlite3.Connection]:
    """Return a connection to a database that takes its name when the block has ended well, and leaves nothing otherwise."""
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
def _kept_or_new(database: Path) -> Iterator[sqlite3.Connection]:
    """Return a connection to a database, which is removed again when it was made here and the block failed."""
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
            raise StoreError(f"the database {database} did not take the release, nothing changed: {error}") from error
        raise


def _remove(path: Path) -> None:
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
