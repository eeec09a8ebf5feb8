"""What the playground asks of the database: boards by their player.

A ranked episode is one that a person plays alone, on the page, on a terrain that the server drew for them: if it ended now, it
would count. No query about boards sees one of a study or of a daily terrain, but where it says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from humanplay.db.database import rows
from humanplay.db.reader import TRIAL, Reader
from humanplay.db.store import DAY_MS, Store
from humanplay.db.trial import Trial

MOVES = """(SELECT coalesce(max(step) + 1, 0) FROM steps t WHERE t.episode_id = e.id) AS moves,
    (SELECT max(server_ms) FROM steps t WHERE t.episode_id = e.id) AS moved_ms"""
_RANKED = f"""SELECT {TRIAL}, {MOVES} FROM {{tables}} ON s.id = e.session_id
    LEFT JOIN series_episodes x ON x.episode_id = e.id
    WHERE e.ended_ms IS NULL AND e.driver = 'human' AND NOT e.assisted AND NOT e.seed_chosen
    AND s.control = 'cookie' AND s.owner_id IS NOT NULL
    AND x.participant_id IS NULL"""
# A CROSS JOIN reads the tables in the order written: a player's few sessions first, or the few open episodes of all.
_OF_PLAYER = (
    _RANKED.format(tables="sessions s CROSS JOIN episodes e")
    + " AND x.series IS NULL AND s.owner_id = :player"
)
_OF_ALL = _RANKED.format(tables="episodes e CROSS JOIN sessions s")
_LEFT = f"""SELECT {TRIAL}, {MOVES},
    (SELECT server_ms FROM input_events v WHERE v.episode_id = e.id ORDER BY number DESC LIMIT 1) AS came_ms
    FROM episodes e CROSS JOIN sessions s ON s.id = e.session_id
    LEFT JOIN series_episodes x ON x.episode_id = e.id
    WHERE e.ended_ms IS NULL AND x.participant_id IS NULL AND e.started_ms < :before AND :before > coalesce(
        max(moved_ms, came_ms), moved_ms, came_ms, iif(x.series IS NULL, NULL, e.started_ms))"""
# A policy's board without a rival is a replay beside a board, and no board of its own.
_NEWEST = f"""SELECT s.id FROM sessions s
    CROSS JOIN episodes e ON e.session_id = s.id AND e.number = (SELECT max(number) FROM episodes WHERE session_id = s.id)
    WHERE s.owner_id = :player AND s.player_id = :player AND s.control = 'cookie'
    AND (s.driver_name = 'human' OR EXISTS (SELECT 1 FROM sessions r WHERE r.rival_of = s.id))
    AND NOT EXISTS (SELECT 1 FROM participants p WHERE p.session_id = s.id)
    AND NOT EXISTS (SELECT 1 FROM series_episodes x WHERE x.episode_id = e.id)
    AND (e.ended_ms IS NULL OR max(s.created_ms, e.ended_ms) > :since)
    ORDER BY e.id IN (SELECT id FROM ({_OF_PLAYER}) WHERE moves > 0) DESC, e.started_ms DESC LIMIT 1"""
_WATCHABLE = """SELECT e.session_id, e.ended_ms FROM episodes e LEFT JOIN series_episodes x ON x.episode_id = e.id
    LEFT JOIN series y ON y.name = x.series
    WHERE e.id = :episode AND (x.series IS NULL OR y.closed_ms <= :now OR x.player_id = :viewer)"""

# Boards with their rival's: nothing has happened on either, and neither is the newest session. Moves wait for this query, so
# it reads the few open episodes first, not all sessions.
_UNPLAYED = """SELECT DISTINCT s.rowid, s.id, s.player_id, r.id FROM episodes o CROSS JOIN sessions b ON b.id = o.session_id
    CROSS JOIN sessions s ON s.id = coalesce(b.rival_of, b.id) LEFT JOIN sessions r ON r.rival_of = s.id
    WHERE o.ended_ms IS NULL AND o.started_ms < :before AND s.rowid > :after AND s.created_ms < :before
    AND max(s.rowid, coalesce(r.rowid, 0)) < (SELECT max(rowid) FROM sessions)
    AND NOT EXISTS (SELECT 1 FROM participants p WHERE p.session_id = s.id)
    AND NOT EXISTS (SELECT 1 FROM episodes e WHERE e.session_id IN (s.id, r.id) AND (
        e.ended_ms IS NOT NULL OR e.started_ms >= :before
        OR EXISTS (SELECT 1 FROM steps t WHERE t.episode_id = e.id)
        OR EXISTS (SELECT 1 FROM input_events v WHERE v.episode_id = e.id)
        OR EXISTS (SELECT 1 FROM series_episodes t WHERE t.episode_id = e.id)))
    ORDER BY s.rowid LIMIT :most"""
DELETE_UNUSED_PLAYER = """DELETE FROM players WHERE id = ?1
    AND NOT EXISTS (SELECT 1 FROM sessions WHERE ?1 IN (player_id, owner_id))
    AND NOT EXISTS (SELECT 1 FROM participants WHERE player_id = ?1)
    AND NOT EXISTS (SELECT 1 FROM series_episodes WHERE player_id = ?1)
    AND NOT EXISTS (SELECT 1 FROM names WHERE player_id = ?1)"""
"""Deletes a player (SQL) of whom nothing else is stored."""


def open_ranked(store: Store, player_id: str) -> list[Trial]:
    """Return a player's open ranked episodes, with the moves made."""
    return [Trial.of(row) for row in rows(store.connection, _OF_PLAYER, {"player": player_id})]


def open_plays(reader: Reader) -> list[Trial]:
    """Open ranked episodes with a move, on instances that are new to their players."""
    sql = _OF_ALL + " AND x.series IS NULL AND NOT e.terrain_met_before"
    return [Trial.of(row) for row in reader.query(sql) if row["moves"]]


@dataclass(frozen=True)
class ExclusionCounts:
    """Ended episodes of people alone that do not count, by the reason.

    repeated    on an instance that was chosen, or met before
    by_program  a move was called no key and no touch, as in a browser that says that a program drives it
    unattested  a move fits no key or touch of the page
    unmoved     the environment failed at the first move
    """

    repeated: int
    by_program: int
    unattested: int
    unmoved: int


def left_out_plays(reader: Reader, task: str) -> ExclusionCounts:
    """Count what people alone played of a task and what does not count."""
    sql = """SELECT coalesce(sum(moved AND is_repeated), 0) AS repeated,
        coalesce(sum(moved AND NOT is_repeated AND driver = 'script'), 0) AS by_program,
        coalesce(sum(moved AND NOT is_repeated AND attestation IS 'unattested'), 0) AS unattested,
        coalesce(sum(NOT moved AND outcome = 'environment_failed'), 0) AS unmoved
        FROM (SELECT e.driver, e.attestation, e.outcome, e.steps > 0 AS moved,
            e.seed_chosen OR e.terrain_met_before AS is_repeated
            FROM episodes e JOIN sessions s ON s.id = e.session_id LEFT JOIN series_episodes x ON x.episode_id = e.id
            WHERE e.task = ? AND e.ended_ms IS NOT NULL AND e.driver IN ('human', 'script')
            AND NOT e.assisted AND s.owner_id IS NOT NULL AND x.series IS NULL)"""
    (row,) = reader.query(sql, [task])
    return ExclusionCounts(**row)


def ranked_left_since(store: Store, before_ms: int) -> list[Trial]:
    """Open ranked or daily episodes whose last move was made before a time.

    An episode without a move is never one of them.
    """
    trials = rows(store.connection, _OF_ALL + " AND moved_ms < :before", {"before": before_ms})
    return [Trial.of(row) for row in trials]


def left_since(store: Store, before_ms: int) -> list[Trial]:
    """Open episodes outside studies whose last move or event is older than a time.

    One without either is among them where it is an attempt at a daily terrain: other boards of that kind are deleted.
    """
    trials = rows(store.connection, _LEFT, {"before": before_ms})
    return [Trial.of(row) for row in trials]


def newest_session(store: Store, player_id: str, now_ms: int) -> str | None:
    """The session that a player's page resumes; None if there is none.

    It is that of their ranked episode with moves if one is open, else the newest of those that are open or ended within a day.
    """
    values = {"player": player_id, "since": now_ms - DAY_MS}
    row = store.connection.execute(_NEWEST, values).fetchone()
    return None if row is None else str(row[0])


def watchable_session(
    store: Store, episode_id: str, at_ms: int, viewer: str | None = None
) -> tuple[str, bool] | None:
    """The session of an episode that may be watched, and whether it has ended.

    None for any other id.

    at_ms   now: an episode of a series that is open may not be watched
    viewer  the player who asks, who sees their own attempt at a daily terrain
    """
    values = {"episode": episode_id, "now": at_ms, "viewer": viewer}
    row = store.connection.execute(_WATCHABLE, values).fetchone()
    return None if row is None else (str(row[0]), row[1] is not None)


def newest_episode(store: Store, session_id: str) -> str | None:
    """The newest episode of a session, running or ended; None if there is none."""
    sql = "SELECT id FROM episodes WHERE session_id = ? ORDER BY number DESC LIMIT 1"
    row = store.connection.execute(sql, [session_id]).fetchone()
    return None if row is None else str(row[0])


def sessions_after(store: Store, row: int, most: int) -> list[tuple[int, str]]:
    """Row numbers and ids of the first sessions stored after a row number, in order."""
    sql = "SELECT rowid, id FROM sessions WHERE rowid > ? ORDER BY rowid LIMIT ?"
    return store.connection.execute(sql, [row, most]).fetchall()


def session_of_row(store: Store, row: int) -> str | None:
    """Return the id of the session with a row number; None where it was deleted."""
    stored = store.connection.execute("SELECT id FROM sessions WHERE rowid = ?", [row]).fetchone()
    return None if stored is None else str(stored[0])


class Deletion(NamedTuple):
    """What was deleted, and the row number to go on after; None at the end."""

    sessions: list[str]
    episodes: list[str]
    after: int | None


def delete_unplayed(
    store: Store, before_ms: int, in_use: Callable[[str], bool], after: int = 0, most: int = 100
) -> Deletion:
    """Delete old boards on which nobody has moved.

    Only the next `most` boards after a row number are looked at.

    A board goes with its rival's and with its player, if they have nothing else. Deleted are only boards whose episodes all
    run and have neither a move nor an input event: the chain has no entry of them, so nothing that `verify` looks at changes.
    A participant's board, an attempt at a daily terrain and a board that is `in_use` (asked with its id) stay, and so does the
    newest session of all: its row number must not come again.
    """
    with store.transaction():
        conn = store.connection
        values = {"before": before_ms, "most": most, "after": after}
        unplayed = conn.execute(_UNPLAYED, values).fetchall()
        deleted, episodes, players = list[str](), list[str](), set[str]()
        for _, session_id, player_id, rival_id in unplayed:
            ids = [session for session in (rival_id, session_id) if session is not None]
            if any(in_use(session) for session in ids):
                continue
            for session in ids:
                sql = "DELETE FROM episodes WHERE session_id = ? RETURNING id"
                gone = conn.execute(sql, [session])
                episodes += [episode_id for (episode_id,) in gone]
                conn.execute("DELETE FROM sessions WHERE id = ?", [session])
            deleted += ids
            players |= {player_id} - {None}
        conn.executemany(DELETE_UNUSED_PLAYER, [(player_id,) for player_id in players])
    return Deletion(deleted, episodes, unplayed[-1][0] if len(unplayed) == most else None)
