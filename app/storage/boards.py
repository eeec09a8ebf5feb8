"""Boards of the playground by their player: which is the newest, which ranked episodes are open, which episode may be watched.

A ranked episode is one that a person plays alone, on the page, on a terrain that the server drew for them: if it ended now, it
would count. None of these queries sees a board of a study; those of daily terrains are seen where it says so.
"""

from __future__ import annotations

from dataclasses import dataclass

from app.storage.reader import utc_day
from app.storage.store import DAY_MS, Store

_RANKED = """SELECT e.id, e.session_id, s.owner_id, e.config_hash,
    (SELECT coalesce(max(step) + 1, 0) FROM steps t WHERE t.episode_id = e.id) AS moves,
    (SELECT max(server_ms) FROM steps t WHERE t.episode_id = e.id) AS moved_ms
    FROM {tables} ON s.id = e.session_id
    WHERE e.ended_ms IS NULL AND e.driver = 'human' AND NOT e.assisted AND NOT e.seed_chosen
    AND s.control = 'cookie' AND s.owner_id IS NOT NULL
    AND NOT EXISTS (SELECT 1 FROM study_episodes t WHERE t.episode_id = e.id)"""
_NOT_DAILY = " AND NOT EXISTS (SELECT 1 FROM daily_attempts d WHERE d.episode_id = e.id)"
# A CROSS JOIN reads the tables in the order written: a player's few sessions first, or the few open episodes of all.
_OF_PLAYER = _RANKED.format(tables="sessions s CROSS JOIN episodes e") + _NOT_DAILY + " AND s.owner_id = :player"
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


@dataclass(frozen=True)
class OpenRanked:
    """An open ranked episode; `moved_ms` is when its last move was made, None without a move."""

    episode_id: str
    session_id: str
    player_id: str
    config_hash: str
    moves: int
    moved_ms: int | None


def open_ranked(store: Store, player_id: str) -> list[OpenRanked]:
    """Return a player's open ranked episodes."""
    return [OpenRanked(*row) for row in store.connection.execute(_OF_PLAYER, {"player": player_id}).fetchall()]


def ranked_left_since(store: Store, before_ms: int) -> list[OpenRanked]:
    """Return every open ranked or daily episode whose last move was made before a time; none without a move is among them."""
    return [OpenRanked(*row) for row in store.connection.execute(_OF_ALL + " AND moved_ms < ?", [before_ms]).fetchall()]


def newest_session(store: Store, player_id: str, now_ms: int) -> str | None:
    """Return the id of the session that a player's page goes on with; None when there is none.

    It is that of their ranked episode with moves if one is open, else the newest of those that are open or ended within a day.
    """
    values = {"player": player_id, "since": now_ms - DAY_MS}
    found = store.connection.execute(_NEWEST, values).fetchone()
    return None if found is None else str(found[0])


def watchable_session(store: Store, episode_id: str, at_ms: int, viewer: str | None = None) -> tuple[str, bool] | None:
    """Return (its session's id, whether it has ended) of an episode of the playground; None for any other id.

    at_ms   now: before the day of a daily terrain is over, only its own player may watch
    viewer  the player who asks
    """
    values = {"episode": episode_id, "today": utc_day(at_ms), "viewer": viewer}
    found = store.connection.execute(_WATCHABLE, values).fetchone()
    return None if found is None else (str(found[0]), found[1] is not None)
