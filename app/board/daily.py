"""The daily terrain: one attempt a player and day, which a reload goes on with, and how a day's terrain is drawn.

An attempt is a board of its own beside the player's others: these do not end it, and it ends none of them. Like a ranked
episode it is abandoned when nobody has moved it for a time, once a move is made (`app.board.ranked`).

The key is HMAC-SHA256(secret, date). Its SHA-256, the commitment, is shown from the start of the day; the key is told once the
day (UTC) is over, and with it anybody can check the commitment and draw the terrain again. Earlier keys say nothing about later
ones, since the secret is told to nobody.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
import sqlite3
from collections.abc import Iterator
from datetime import UTC, date, datetime
from functools import partial
from typing import Any
from weakref import WeakValueDictionary

from app.board.lobby import Lobby
from app.board.session import Session
from app.db.playground import (
    DailyTerrain,
    daily_causes,
    daily_secret,
    daily_terrains,
    find_attempt,
    find_terrain,
    keep_terrain,
)
from app.db.reader import utc_day
from app.db.resimulation import Finding
from app.db.store import DAY_MS
from app.db.trial import DailyDay, Trial
from app.task import Configuration


class DailyPlayedError(Exception):
    """The player's one attempt at today's terrain is over."""


class DailyBoards:
    """The daily terrains of one server, and the boards on which players attempt them."""

    def __init__(self, lobby: Lobby) -> None:
        self._lobby = lobby
        self._today: DailyTerrain | None = None
        self._locks: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()

    def day(self) -> str:
        """Return today's date in UTC."""
        return utc_day(self._lobby.sources.clock_ms())

    async def today(self) -> DailyTerrain:
        """Return today's terrain, which is kept from the first time that somebody asks; nobody may be told its key."""
        day = self.day()
        if self._today is None or self._today.day != day:
            self._today = await self._lobby.store.write(partial(self._keep, day))
        return self._today

    async def on(self, day: str) -> DailyTerrain | None:
        """Return the terrain of a day up to today; None where the server showed none."""
        store, today = self._lobby.store, await self.today()
        if day == today.day:
            return today
        return await store.read(lambda: find_terrain(store, day)) if day < today.day else None

    async def attempt(self, player_id: str | None, day: str) -> Trial | None:
        """Return a player's attempt at a day's terrain; None before it."""
        store = self._lobby.store
        return (
            None
            if player_id is None
            else await store.read(lambda: find_attempt(store, player_id, day))
        )

    async def begin(self, player_id: str) -> tuple[Session, bool]:
        """Return the board of a player's attempt at today's terrain, and whether it was open already.

        DailyPlayedError when the attempt is over.
        """
        lock = self._locks.get(player_id)
        if lock is None:
            lock = self._locks[player_id] = asyncio.Lock()
        async with lock:
            terrain = await self.today()
            attempt = await self.attempt(player_id, terrain.day)
            if attempt is None:
                mark = DailyDay(terrain.day, terrain.commitment)
                return await self._lobby.create_daily(
                    player_id, terrain.config, seed_of(terrain.key), mark
                ), False
            if attempt.ended_ms is not None:
                raise DailyPlayedError(
                    f"you have played the terrain of {terrain.day}, and it is played once; the next one comes at midnight UTC"
                )
            return await self._lobby.get(attempt.session_id), True

    async def board(self, attempt: Trial) -> Session | None:
        """Return the board of an attempt that is running; None once it has ended."""
        return await self._lobby.get(attempt.session_id) if attempt.ended_ms is None else None

    async def check_seed(self, config: Configuration, seed: int | None) -> None:
        """Raise ValueError when a seed draws today's terrain: nobody may practise it before its day is over."""
        if seed is None:
            return
        terrain = await self.today()
        if config == terrain.config and seed == seed_of(terrain.key):
            raise ValueError(
                "this seed draws today's daily terrain, which can be practised from tomorrow (UTC) on"
            )

    def _keep(self, day: str) -> DailyTerrain:
        task = self._lobby.task
        terrain = terrain_of_day(daily_secret(self._lobby.store), day, task.name, task.daily)
        keep_terrain(self._lobby.store, terrain)
        return terrain


START_SLACK_MS = 60_000
"""How long after midnight an attempt may start that was asked for before."""


def terrain_of_day(secret: bytes, day: str, task: str, config: Configuration) -> DailyTerrain:
    """Return the terrain that a day (UTC, "2026-11-22") has on the server with this secret, played on a configuration."""
    key = hmac.new(secret, day.encode(), hashlib.sha256).digest()
    return DailyTerrain(commitment_of(key), day, key, task, config)


def commitment_of(key: bytes) -> str:
    """Return SHA-256 (hex) of a day's key: shown before the key is told."""
    return hashlib.sha256(key).hexdigest()


def seed_of(key: bytes) -> int:
    """Return the terrain's seed: the first 53 bits of SHA-256("terrain" + key), 0..2^53-1."""
    return int.from_bytes(hashlib.sha256(b"terrain" + key).digest()[:8], "big") >> 11


def day_start_ms(day: str) -> int:
    """Return when a day began (UTC), in milliseconds since 1970; ValueError unless it is a date like "2026-11-22"."""
    if len(day) != 10:
        raise ValueError(f"a day must be a date like 2026-11-22, got {day!r}")
    return (
        int(datetime.combine(date.fromisoformat(day), datetime.min.time(), UTC).timestamp()) * 1000
    )


def day_before(day: str, days: int = 1) -> str:
    """Return the day that came so many days before."""
    return utc_day(day_start_ms(day) - days * DAY_MS)


def check_daily(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield daily terrains that are not those of their commitments, and attempts that are not of their day's terrain."""
    for row in daily_terrains(conn):
        try:
            found = commitment_of(bytes.fromhex(row["key"]))
        except ValueError as error:
            found = f"a key that cannot be read: {error}"
        if found != row["commitment"]:
            yield Finding(
                f"daily terrain {row['day']}",
                "commitment",
                row["commitment"],
                f"{found} from its key",
            )
    for row in daily_causes(conn):
        yield from _check_cause(row)


def _check_cause(row: dict[str, Any]) -> Iterator[Finding]:
    where = f"episode {row['episode_id']}"
    try:
        seed, began = seed_of(bytes.fromhex(row["key"])), day_start_ms(row["day"])
    except ValueError as error:
        yield Finding(where, "day and key of its daily terrain", row["day"], str(error))
        return
    for what, stored, expected in (
        ("seed", row["seed"], seed),
        ("task", row["task"], row["terrain_task"]),
        ("config", json.loads(row["config"]), json.loads(row["terrain_config"])),
        ("seed_chosen, assisted", (row["seed_chosen"], row["assisted"]), (0, 0)),
        ("day", row["day"], row["terrain_day"]),
        ("player", row["player_id"], row["owner_id"]),
    ):
        if stored != expected:
            yield Finding(where, f"{what} of a daily attempt", stored, expected)
    if not 0 <= row["started_ms"] - began < DAY_MS + START_SLACK_MS:
        yield Finding(
            where, "start of a daily attempt", row["started_ms"], f"a time on {row['day']} (UTC)"
        )
