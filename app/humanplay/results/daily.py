"""Attempts at the daily terrain (`humanplay.study.days`), one for each player.

An attempt is a board of its own beside the player's others: these do not end it, it ends none of them, and a reload goes on
with it. Like a ranked episode it is abandoned when nobody has moved it for a time, once a move is made
(`humanplay.board.ranked`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from humanplay.board.lobby import Lobby, Locks
from humanplay.board.session import Session
from humanplay.db.reader import utc_day
from humanplay.db.series import add_attempt, add_series, attempts_of, daily_secret, days_beside
from humanplay.db.trial import Trial
from humanplay.results.evaluations import boards_of
from humanplay.study.days import DailyTerrain, terrain_on
from humanplay.task import Configuration


class DailyPlayedError(Exception):
    """The player's one attempt at today's terrain is over."""


class DailyBoards:
    """The daily terrains of one server, and the boards on which players attempt them."""

    def __init__(self, lobby: Lobby) -> None:
        self._lobby = lobby
        self._today: DailyTerrain | None = None
        self._locks = Locks()

    def day(self) -> str:
        """Return today's date in UTC."""
        return utc_day(self._lobby.sources.clock_ms())

    async def today(self) -> DailyTerrain:
        """Return today's terrain, which is kept from the first time that somebody asks."""
        day = self.day()
        if self._today is None or self._today.day != day:
            self._today = await self._lobby.store.write(partial(self._keep, day))
        return self._today

    async def on(self, day: str) -> DailyTerrain | None:
        """Return the terrain of a day up to today; None where the server showed none."""
        store, today = self._lobby.store, await self.today()
        if day >= today.day:
            return today if day == today.day else None
        return await store.read(lambda: terrain_on(store, day))

    async def beside(self, day: str) -> tuple[str | None, str | None]:
        """Return the nearest days with a terrain, before and after a day, up to today."""
        store, today = self._lobby.store, self.day()
        return await store.read(lambda: days_beside(store, day, today))

    async def attempt(self, player_id: str | None, day: str) -> Trial | None:
        """Return a player's attempt at a day's terrain; None before it."""
        if player_id is None:
            return None
        store = self._lobby.store
        attempts = await store.read(lambda: attempts_of(store, player_id))
        return next((attempt for attempt in attempts if attempt.day == day), None)

    async def begin(self, player_id: str) -> tuple[Session, bool]:
        """Return the board of a player's attempt today, and whether it was open already.

        DailyPlayedError when the attempt is over.
        """
        async with self._locks.of(player_id):
            terrain = await self.today()
            attempt = await self.attempt(player_id, terrain.day)
            if attempt is None:
                return await self._begin(player_id, terrain), False
            if attempt.ended_ms is not None:
                raise DailyPlayedError(
                    f"you have played the terrain of {terrain.day}, and it is played once; the next one comes at midnight UTC"
                )
            return await self._lobby.get(attempt.session_id), True

    async def check_seed(self, config: Configuration, seed: int | None) -> None:
        """Raise ValueError if a seed draws today's terrain, which nobody may practise yet."""
        if seed is None or self._lobby.task.boards is None:
            return
        terrain = await self.today()
        if config == terrain.config and seed == terrain.seed:
            when = "which can be practised from tomorrow (UTC) on"
            raise ValueError(f"this seed draws today's daily terrain, {when}")

    async def _begin(self, player_id: str, terrain: DailyTerrain) -> Session:
        lobby, store = self._lobby, self._lobby.store
        board = lobby.new_board(player_id)

        @contextmanager
        def within(row: Trial) -> Iterator[None]:
            store.add_player(player_id, row.started_ms)
            store.add_session(board.row)
            yield
            add_attempt(store, terrain.series.name, player_id, row.id)

        await lobby.begin(board, terrain.config, terrain.seed, within, terrain.series.name)
        return board

    def _keep(self, day: str) -> DailyTerrain:
        task, store = self._lobby.task, self._lobby.store
        terrain = DailyTerrain.draw(daily_secret(store), day, task.name, boards_of(task.name).daily)
        add_series(store, terrain.series)
        return terrain
