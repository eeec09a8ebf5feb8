"""Recordings beside a database: copied with it, deleted with its episodes."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

from humanplay.db.file import recordings_beside
from humanplay.task import recordings

UNENDED_ERASURE = "unended erasure"
"""The row of `meta` from an erasure's commit until the file is written anew.

It holds, as JSON, the recordings that the erasure deletes.
"""

Instance = tuple[str, int]
"""Level and seed."""


def recorded_episodes(conn: sqlite3.Connection, folder: Path) -> dict[Instance, set[str]]:
    """The episodes of each instance whose level has recordings in a folder."""
    episodes = defaultdict[Instance, set[str]](set)
    if folder.is_dir():
        sql = "SELECT level, seed, id FROM episodes WHERE seed IS NOT NULL"
        levels = {path.name for path in folder.iterdir()}
        for level, seed, episode in conn.execute(sql):
            if recordings.folder_of(folder, level).name in levels:
                episodes[level, seed].add(episode)
    return episodes


def copy_recordings(conn: sqlite3.Connection, source: Path, target: Path) -> None:
    """Copy what the episodes of a database need and the target lacks."""
    for level, seed in recorded_episodes(conn, source):
        recorded = recordings.of_instance(source, level, seed)
        for actions, digest in _played(conn, level, seed):
            copied = recordings.of_instance(target, level, seed)
            if recordings.holding(copied, actions, digest) is None:
                path = recordings.holding(recorded, actions, digest)
                if path is not None:
                    recordings.copy(path, recordings.folder_of(target, level))


def mark_for_deletion(
    conn: sqlite3.Connection, database: Path, before: Mapping[Instance, set[str]]
) -> None:
    """Note in an erasure's transaction which recordings no episode needs after it.

    Args:
        before: The episodes before the erasure; the recordings of other instances stay.
    """
    folder = recordings_beside(database)
    after = recorded_episodes(conn, folder)
    paths = [
        path
        for instance, episodes in before.items()
        if after.get(instance) != episodes
        for path in _unneeded(conn, folder, *instance)
    ]
    names = json.dumps([str(path.relative_to(folder)) for path in paths])
    conn.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", [UNENDED_ERASURE, names])


def delete_marked(conn: sqlite3.Connection, database: Path) -> None:
    """Delete the recordings that a committed erasure noted, also after a kill."""
    sql = "SELECT value FROM meta WHERE name = ?"
    for (names,) in conn.execute(sql, [UNENDED_ERASURE]):
        for name in json.loads(names):
            (recordings_beside(database) / name).unlink(missing_ok=True)


def move_folder(database: Path, to: Path) -> None:
    """Put the recordings beside a database, if there are any, beside another one."""
    if recordings_beside(database).is_dir():
        recordings_beside(database).replace(recordings_beside(to))


def remove_folder(database: Path) -> None:
    """Delete all recordings beside a database."""
    shutil.rmtree(recordings_beside(database), ignore_errors=True)


def _unneeded(conn: sqlite3.Connection, folder: Path, level: str, seed: int) -> set[Path]:
    recorded = recordings.of_instance(folder, level, seed)
    needed = {
        recordings.holding(recorded, actions, digest)
        for actions, digest in _played(conn, level, seed)
    }
    return recorded.keys() - needed


def _played(conn: sqlite3.Connection, level: str, seed: int) -> Iterator[tuple[bytes, str | None]]:
    """Each episode of an instance: its moves and digest, None while it runs."""
    sql = "SELECT id, trajectory_hash FROM episodes WHERE level = ? AND seed = ?"
    moves = "SELECT action FROM steps WHERE episode_id = ? ORDER BY step"
    for episode, digest in conn.execute(sql, [level, seed]).fetchall():
        yield bytes(action for (action,) in conn.execute(moves, [episode])), digest
