"""Playing the daily terrain: one attempt a player and day, which a reload goes on with.

An attempt is a board of its own beside the player's others: these do not end it, and it ends none of them. Like a ranked
episode it is abandoned when nobody has moved it for a time, once a move is made (`app.play.ranked`).
"""

from __future__ import annotations

import asyncio
from functools import partial
from weakref import WeakValueDictionary

from app.play.daily_terrain import seed_of, terrain_of_day
from app.play.lobby import Lobby
from app.play.session import Session
from app.storage.playground import (
    DailyTerrain,
    daily_secret,
    find_attempt,
    find_terrain,
    keep_terrain,
)
from app.storage.reader import utc_day
from app.storage.trial import DailyDay, Trial
from marsexplorer.config import EnvConfig


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

    async def check_seed(self, config: EnvConfig, seed: int | None) -> None:
        """Raise ValueError when a seed draws today's terrain: nobody may practise it before its day is over."""
        if seed is None:
            return
        terrain = await self.today()
        if config == terrain.config and seed == seed_of(terrain.key):
            raise ValueError(
                "this seed draws today's daily terrain, which can be practised from tomorrow (UTC) on"
            )

    def _keep(self, day: str) -> DailyTerrain:
        terrain = terrain_of_day(daily_secret(self._lobby.store), day)
        keep_terrain(self._lobby.store, terrain)
        return terrain
