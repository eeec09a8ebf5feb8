"""Boards of the playground by their player, and daily terrains: what the playground asks of the database.

A ranked episode is one that a person plays alone, on the page, on a terrain that the server drew for them: if it ended now, it
would count. No query about boards sees a board of a study; those of daily terrains are seen where it says so.

The tables `daily_terrains` and `daily_attempts` hold one terrain a day, and who has played it. `app.board.daily` draws
the keys. A day is a date in UTC, "2026-11-22". Nothing here that a request may reach before the day is over holds a key, but
`DailyTerrain` itself does: it goes to nobody.
"""

from __future__ import annotations

import json
import secrets
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from app.db.database import rows
from app.db.reader import JOINED, TRIAL, Reader, utc_day
from app.db.store import DAY_MS, Store
from app.db.trial import Trial, parse_config
from app.task import Configuration

_MOVES = """(SELECT coalesce(max(step) + 1, 0) FROM steps t WHERE t.episode_id = e.id) AS moves,
    (SELECT max(server_ms) FROM steps t WHERE t.episode_id = e.id) AS moved_ms"""
_RANKED = f"""SELECT {TRIAL}, {_MOVES} FROM {{tables}} ON s.id = e.session_id
    LEFT JOIN daily_attempts d ON d.episode_id = e.id
    WHERE e.ended_ms IS NULL AND e.driver = 'human' AND NOT e.assisted AND NOT e.seed_chosen
    AND s.control = 'cookie' AND s.owner_id IS NOT NULL
    AND NOT EXISTS (SELECT 1 FROM study_episodes t WHERE t.episode_id = e.id)"""
_NOT_DAILY = " AND NOT EXISTS (SELECT 1 FROM daily_attempts d WHERE d.episode_id = e.id)"
# A CROSS JOIN reads the tables in the order written: a player's few sessions first, or the few open episodes of all.
_OF_PLAYER = (
    _RANKED.format(tables="sessions s CROSS JOIN episodes e")
    + _NOT_DAILY
    + " AND s.owner_id = :player"
)
_OF_ALL = _RANKED.format(tables="episodes e CROSS JOIN sessions s")
# A policy's board without a rival is a replay beside a board, and no board of its own.
_NEWEST = f"""SELECT s.id FROM sessions s
    CROSS JOIN episodes e ON e.session_id = s.id AND e.number = (SELECT max(number) FROM episodes WHERE session_id = s.id)
    WHERE s.owner_id = :player AND s.player_id = :player AND s.control = 'cookie'
    AND (s.driver_name = 'human' OR EXISTS (SELECT 1 FROM sessions r WHERE r.rival_of = s.id))
    AND NOT EXISTS (SELECT 1 FROM participants p WHERE p.session_id = s.id){_NOT_DAILY}
    AND (e.ended_ms IS NULL OR max(s.created_ms, e.ended_ms) > :since)
    ORDER BY e.id IN (SELECT id FROM ({_OF_PLAYER}) WHERE moves > 0) DESC, e.started_ms DESC LIMIT 1"""
_WATCHABLE = """SELECT e.session_id, e.ended_ms FROM episodes e WHERE e.id = :episode
    AND NOT EXISTS (SELECT 1 FROM study_episodes t WHERE t.episode_id = e.id)
    AND NOT EXISTS (SELECT 1 FROM daily_attempts d WHERE d.episode_id = e.id AND d.day >= :today
        AND d.player_id IS NOT :viewer)"""

# Boards with their rival's: nothing has happened on either, and neither is the newest session.
_UNPLAYED = """SELECT s.rowid, s.id, s.player_id, r.id FROM sessions s LEFT JOIN sessions r ON r.rival_of = s.id
    WHERE s.rowid > :after AND s.created_ms < :before AND s.rival_of IS NULL
    AND max(s.rowid, coalesce(r.rowid, 0)) < (SELECT max(rowid) FROM sessions)
    AND NOT EXISTS (SELECT 1 FROM participants p WHERE p.session_id = s.id)
    AND NOT EXISTS (SELECT 1 FROM episodes e WHERE e.session_id IN (s.id, r.id) AND (
        e.ended_ms IS NOT NULL OR e.started_ms >= :before
        OR EXISTS (SELECT 1 FROM steps t WHERE t.episode_id = e.id)
        OR EXISTS (SELECT 1 FROM input_events v WHERE v.episode_id = e.id)
        OR EXISTS (SELECT 1 FROM study_episodes t WHERE t.episode_id = e.id)
        OR EXISTS (SELECT 1 FROM daily_attempts d WHERE d.episode_id = e.id)))
    ORDER BY s.rowid LIMIT :most"""
_WITHOUT_ANYTHING = """DELETE FROM players WHERE id = ?1
    AND NOT EXISTS (SELECT 1 FROM sessions WHERE ?1 IN (player_id, owner_id))
    AND NOT EXISTS (SELECT 1 FROM participants WHERE player_id = ?1)
    AND NOT EXISTS (SELECT 1 FROM daily_attempts WHERE player_id = ?1)"""


def open_ranked(store: Store, player_id: str) -> list[Trial]:
    """Return a player's open ranked episodes, with the moves made."""
    return [Trial.of(row) for row in rows(store.connection, _OF_PLAYER, {"player": player_id})]


def ranked_left_since(store: Store, before_ms: int) -> list[Trial]:
    """Return every open ranked or daily episode whose last move was made before a time; none without a move is among them."""
    found = rows(store.connection, _OF_ALL + " AND moved_ms < :before", {"before": before_ms})
    return [Trial.of(row) for row in found]


def newest_session(store: Store, player_id: str, now_ms: int) -> str | None:
    """Return the id of the session that a player's page goes on with; None when there is none.

    It is that of their ranked episode with moves if one is open, else the newest of those that are open or ended within a day.
    """
    values = {"player": player_id, "since": now_ms - DAY_MS}
    found = store.connection.execute(_NEWEST, values).fetchone()
    return None if found is None else str(found[0])


def watchable_session(
    store: Store, episode_id: str, at_ms: int, viewer: str | None = None
) -> tuple[str, bool] | None:
    """Return (its session's id, whether it has ended) of an episode of the playground; None for any other id.

    at_ms   now: before the day of a daily terrain is over, only its own player may watch
    viewer  the player who asks
    """
    values = {"episode": episode_id, "today": utc_day(at_ms), "viewer": viewer}
    found = store.connection.execute(_WATCHABLE, values).fetchone()
    return None if found is None else (str(found[0]), found[1] is not None)


def newest_episode(store: Store, session_id: str) -> str | None:
    """Return the id of the episode on a session's board, running or ended; None where there is none."""
    sql = "SELECT id FROM episodes WHERE session_id = ? ORDER BY number DESC LIMIT 1"
    found = store.connection.execute(sql, [session_id]).fetchone()
    return None if found is None else str(found[0])


def sessions_after(store: Store, row: int, most: int) -> list[tuple[int, str]]:
    """Return (row number, id) of the first sessions that were stored after the one with a row number, in that order."""
    sql = "SELECT rowid, id FROM sessions WHERE rowid > ? ORDER BY rowid LIMIT ?"
    return store.connection.execute(sql, [row, most]).fetchall()


def session_of_row(store: Store, row: int) -> str | None:
    """Return the id of the session with a row number; None where it was deleted."""
    found = store.connection.execute("SELECT id FROM sessions WHERE rowid = ?", [row]).fetchone()
    return None if found is None else str(found[0])


class Deleted(NamedTuple):
    """Sessions that were deleted, and the row number after which the next look begins (None: there is nothing more)."""

    sessions: list[str]
    after: int | None


def delete_unplayed(
    store: Store, before_ms: int, in_use: Callable[[str], bool], after: int = 0, most: int = 100
) -> Deleted:
    """Delete boards that were begun before a time and on which nobody has moved, among `most` that follow a row number.

    A board goes with its rival's and with its player, if they have nothing else. Deleted are only boards whose episodes all
    run and have neither a move nor an input event: the chain has no entry of them, so nothing that `verify` looks at changes.
    A participant's board, an attempt at a daily terrain and a board that is `in_use` (asked with its id) stay, and so does the
    newest session of all: its row number must not come again.
    """
    with store.transaction():
        conn = store.connection
        found = conn.execute(
            _UNPLAYED, {"before": before_ms, "most": most, "after": after}
        ).fetchall()
        deleted, players = list[str](), set[str]()
        for _, session_id, player_id, rival_id in found:
            ids = [each for each in (rival_id, session_id) if each is not None]
            if any(in_use(each) for each in ids):
                continue
            for each in ids:
                conn.execute("DELETE FROM episodes WHERE session_id = ?", [each])
                conn.execute("DELETE FROM sessions WHERE id = ?", [each])
            deleted += ids
            players |= {player_id} - {None}
        conn.executemany(_WITHOUT_ANYTHING, [(player_id,) for player_id in players])
    return Deleted(deleted, found[-1][0] if len(found) == most else None)


_SECRET = "daily_secret"
"""The row of the table `meta` with the secret that all keys of this database's days follow from."""

_TERRAIN = """SELECT t.* FROM daily_terrains t WHERE t.day = ?1
    ORDER BY (SELECT count(*) FROM daily_attempts a WHERE a.commitment = t.commitment) DESC, t.commitment LIMIT 1"""
_ATTEMPT = f"SELECT {TRIAL}, {_MOVES} FROM episodes e {JOINED} WHERE d.player_id = ?1"
_RESULTS = """SELECT a.episode_id, a.player_id, e.outcome, e.steps, e.discovered, e.score, e.ended_ms
    FROM daily_attempts a JOIN episodes e ON e.id = a.episode_id
    WHERE a.commitment = ?1 AND e.driver = 'human' AND e.attestation IN ('attested', 'supervised') AND e.steps > 0
    AND e.ended_ms < ?2 ORDER BY e.ended_ms, e.id"""
_CAUSES = """SELECT a.episode_id, a.day, a.player_id, a.commitment, t.day AS terrain_day, t.key, t.task AS terrain_task,
    t.config AS terrain_config, e.seed, e.task, e.config, e.seed_chosen, e.assisted, e.started_ms,
    s.owner_id FROM daily_attempts a JOIN daily_terrains t ON t.commitment = a.commitment
    JOIN episodes e ON e.id = a.episode_id JOIN sessions s ON s.id = e.session_id ORDER BY a.day, a.episode_id"""


@dataclass(frozen=True)
class DailyTerrain:
    """The terrain of a day: `commitment` is SHA-256 (hex) of `key`, which stays secret until the day is over."""

    commitment: str
    day: str
    key: bytes = field(repr=False)
    task: str
    config: Configuration


def daily_secret(store: Store) -> bytes:
    """Return the secret that the keys of this database's days follow from: made once, kept in the database."""
    with store.transaction():
        store.connection.execute(
            "INSERT OR IGNORE INTO meta VALUES (?, ?)", (_SECRET, secrets.token_hex(32))
        )
    return bytes.fromhex(
        store.query("SELECT value FROM meta WHERE name = ?", [_SECRET])[0]["value"]
    )


def keep_terrain(store: Store, terrain: DailyTerrain) -> None:
    """Keep the terrain of a day, so that its key can be told when the day is over; a second time changes nothing."""
    config = json.dumps(terrain.config.to_dict(), sort_keys=True, separators=(",", ":"))
    with store.transaction():
        values = (terrain.commitment, terrain.day, terrain.key.hex(), terrain.task, config)
        store.connection.execute(
            "INSERT OR IGNORE INTO daily_terrains VALUES (?, ?, ?, ?, ?)", values
        )


def find_terrain(reader: Reader, day: str) -> DailyTerrain | None:
    """Return the terrain of a day, the most played of them in a merged database; None where none was shown on that day."""
    found = reader.query(_TERRAIN, [day])
    return _terrain_of(found[0]) if found else None


def find_attempt(reader: Reader, player_id: str, day: str) -> Trial | None:
    """Return a player's attempt at a day's terrain, with the moves made; None when they have not begun it."""
    found = reader.query(f"{_ATTEMPT} AND d.day = ?2", [player_id, day])
    return Trial.of(found[0]) if found else None


def attempts_of(reader: Reader, player_id: str) -> list[Trial]:
    """Return all daily attempts of a player, the newest day first."""
    return [Trial.of(row) for row in reader.query(f"{_ATTEMPT} ORDER BY d.day DESC", [player_id])]


def results(reader: Reader, commitment: str, before_ms: int) -> list[dict[str, Any]]:
    """Return people's attested attempts at a terrain that ended before a time and have a move, in the order of their ends."""
    return reader.query(_RESULTS, [commitment, before_ms])


def daily_terrains(conn: sqlite3.Connection) -> list[dict[str, Any]]:
    """Return every row of the table `daily_terrains`, for verification."""
    return rows(conn, "SELECT * FROM daily_terrains ORDER BY day, commitment")


def daily_causes(conn: sqlite3.Connection) -> list[dict[str, Any]]:
    """Return for every daily attempt what it follows from."""
    return rows(conn, _CAUSES)


def _terrain_of(row: dict[str, Any]) -> DailyTerrain:
    return DailyTerrain(
        row["commitment"],
        row["day"],
        bytes.fromhex(row["key"]),
        row["task"],
        parse_config(row["task"], row["config"]),
    )
