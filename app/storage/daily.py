"""Daily terrains as the tables `daily_terrains` and `daily_attempts` hold them: one terrain a day, and who has played it.

`app.play.daily_terrain` draws the keys. A day is a date in UTC, "2026-11-22". Nothing here that a request may reach before the
day is over holds a key, but `DailyTerrain` itself does: it goes to nobody.
"""

from __future__ import annotations

import json
import secrets
import sqlite3
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from app.storage.connection import rows
from app.storage.reader import Reader
from app.storage.store import Store
from marsexplorer.config import EnvConfig

_SECRET = "daily_secret"
"""The row of the table `meta` with the secret that all keys of this database's days follow from."""

_TERRAIN = """SELECT t.* FROM daily_terrains t WHERE t.day = ?1
    ORDER BY (SELECT count(*) FROM daily_attempts a WHERE a.commitment = t.commitment) DESC, t.commitment LIMIT 1"""
_ATTEMPT = """SELECT a.episode_id, e.session_id, a.day, e.ended_ms, e.outcome, e.steps, e.discovered, e.score, e.driver,
    e.attestation, (SELECT count(*) FROM steps t WHERE t.episode_id = e.id) AS moves
    FROM daily_attempts a JOIN episodes e ON e.id = a.episode_id WHERE a.player_id = ?1"""
_RESULTS = """SELECT a.episode_id, a.player_id, e.outcome, e.steps, e.discovered, e.score, e.ended_ms
    FROM daily_attempts a JOIN episodes e ON e.id = a.episode_id
    WHERE a.commitment = ?1 AND e.driver = 'human' AND e.attestation IN ('attested', 'supervised') AND e.steps > 0
    AND e.ended_ms < ?2 ORDER BY e.ended_ms, e.id"""
_CAUSES = """SELECT a.episode_id, a.day, a.player_id, a.commitment, t.day AS terrain_day, t.key, t.config AS terrain_config,
    e.seed, e.config, e.seed_chosen, e.assisted, e.started_ms, s.owner_id,
    (SELECT c.version FROM chain_salts x JOIN chain c USING (number) WHERE x.kind = 'episode' AND x.id = e.id) AS version
    FROM daily_attempts a JOIN daily_terrains t ON t.commitment = a.commitment JOIN episodes e ON e.id = a.episode_id
    JOIN sessions s ON s.id = e.session_id ORDER BY a.day, a.episode_id"""


@dataclass(frozen=True)
class DailyTerrain:
    """The terrain of a day: `commitment` is SHA-256 (hex) of `key`, which stays secret until the day is over."""

    commitment: str
    day: str
    key: bytes = field(repr=False)
    config: EnvConfig


class DailyAttempt(NamedTuple):
    """A player's one attempt at a day's terrain; `ended_ms` to `attestation` are as in the table `episodes`."""

    episode_id: str
    session_id: str
    day: str
    ended_ms: int | None
    outcome: str | None
    steps: int | None
    discovered: int | None
    score: float | None
    driver: str
    attestation: str | None
    moves: int


def daily_secret(store: Store) -> bytes:
    """Return the secret that the keys of this database's days follow from: made once, kept in the database."""
    with store.transaction():
        store.connection.execute("INSERT OR IGNORE INTO meta VALUES (?, ?)", (_SECRET, secrets.token_hex(32)))
    return bytes.fromhex(store.query("SELECT value FROM meta WHERE name = ?", [_SECRET])[0]["value"])


def keep_terrain(store: Store, terrain: DailyTerrain) -> None:
    """Keep the terrain of a day, so that its key can be told when the day is over; a second time changes nothing."""
    config = json.dumps(terrain.config.to_dict(), sort_keys=True, separators=(",", ":"))
    with store.transaction():
        values = (terrain.commitment, terrain.day, terrain.key.hex(), config)
        store.connection.execute("INSERT OR IGNORE INTO daily_terrains VALUES (?, ?, ?, ?)", values)


def find_terrain(reader: Reader, day: str) -> DailyTerrain | None:
    """Return the terrain of a day, the most played of them in a merged database; None where none was shown on that day."""
    found = reader.query(_TERRAIN, [day])
    return _terrain_of(found[0]) if found else None


def find_attempt(reader: Reader, player_id: str, day: str) -> DailyAttempt | None:
    """Return a player's attempt at a day's terrain; None when they have not begun it."""
    found = reader.query(f"{_ATTEMPT} AND a.day = ?2", [player_id, day])
    return DailyAttempt(**found[0]) if found else None


def attempts_of(reader: Reader, player_id: str) -> list[DailyAttempt]:
    """Return all daily attempts of a player, the newest day first."""
    return [DailyAttempt(**row) for row in reader.query(f"{_ATTEMPT} ORDER BY a.day DESC", [player_id])]


def results(reader: Reader, commitment: str, before_ms: int) -> list[dict[str, Any]]:
    """Return people's attested attempts at a terrain that ended before a time and have a move, in the order of their ends."""
    return reader.query(_RESULTS, [commitment, before_ms])


def daily_terrains(conn: sqlite3.Connection) -> list[dict[str, Any]]:
    """Return every row of the table `daily_terrains`, for verification."""
    return rows(conn, "SELECT * FROM daily_terrains ORDER BY day, commitment")


def daily_causes(conn: sqlite3.Connection) -> list[dict[str, Any]]:
    """Return for every daily attempt what it follows from, and the `version` of its episode's entry in the chain."""
    return rows(conn, _CAUSES)


def _terrain_of(row: dict[str, Any]) -> DailyTerrain:
    return DailyTerrain(row["commitment"], row["day"], bytes.fromhex(row["key"]), EnvConfig(**json.loads(row["config"])))
