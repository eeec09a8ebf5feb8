"""The daily terrain: a series of one terrain, which closes at midnight (UTC), and which each player plays once.

An attempt is a board of its own beside the player's others: these do not end it, it ends none of them, and a reload goes on
with it. Like a ranked episode it is abandoned when nobody has moved it for a time, once a move is made
(`humanplay.board.ranked`).

The day's secret, its key, is HMAC-SHA256(the database's secret, date). Earlier keys say nothing about later ones. Commitment
and seed follow from it as from a study's secret (`humanplay.study.seeds`): the protocol is the day, the task and the
configuration.
"""

from __future__ import annotations

import hashlib
import hmac
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from functools import partial

from humanplay.board.lobby import Lobby, Locks
from humanplay.board.session import Session
from humanplay.db.reader import Reader, utc_day
from humanplay.db.series import add_attempt, add_series, attempts_of, daily_secret, find_day
from humanplay.db.store import DAY_MS
from humanplay.db.study_rows import SeriesRow
from humanplay.db.trial import DAILY, Trial, parse_config
from humanplay.study.protocol import canonical_json
from humanplay.study.seeds import commitment, seed
from humanplay.task import Configuration

START_SLACK_MS = 60_000
"""How long after midnight an attempt may start that was asked for before."""


class DailyPlayedError(Exception):
    """The player's one attempt at today's terrain is over."""


@dataclass(frozen=True)
class DailyTerrain:
    """The terrain of a day; `series` is what the database keeps of it, and goes to nobody before the day is over."""

    series: SeriesRow = field(repr=False)
    day: str
    config: Configuration

    @classmethod
    def of(cls, series: SeriesRow) -> DailyTerrain:
        """Return the terrain of the series of a day; ValueError, TypeError or KeyError where its protocol is none."""
        protocol = json.loads(series.protocol)
        config = parse_config(protocol["task"], json.dumps(protocol["config"]))
        return cls(series, protocol["day"], config)

    @classmethod
    def drawn(cls, secret: bytes, day: str, task: str, config: Configuration) -> DailyTerrain:
        """Return the terrain that a day (UTC, "2026-11-22") has in the database with a secret, played on a configuration."""
        key = hmac.digest(secret, day.encode(), hashlib.sha256)
        protocol = canonical_json({"config": config.to_dict(), "day": day, "task": task})
        began, bound = day_start_ms(day), commitment(key)
        series = SeriesRow(
            f"{DAILY}:{day}:{bound[:12]}", protocol.decode(), hashlib.sha256(protocol).hexdigest(), bound,
            began, began + DAY_MS, key.hex(), DAILY,
        )  # fmt: skip
        return cls(series, day, config)

    @property
    def seed(self) -> int:
        """The seed that draws it, 0..2^53-1."""
        return seed(bytes.fromhex(self.series.secret or ""), self.series.protocol_hash, "ranked", 0)

    @property
    def ends_ms(self) -> int:
        """When the day is over, in milliseconds since 1970."""
        return self.series.closed_ms or 0


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

    async def attempt(self, player_id: str | None, day: str) -> Trial | None:
        """Return a player's attempt at a day's terrain; None before it."""
        if player_id is None:
            return None
        store = self._lobby.store
        attempts = await store.read(lambda: attempts_of(store, player_id))
        return next((each for each in attempts if each.day == day), None)

    async def begin(self, player_id: str) -> tuple[Session, bool]:
        """Return the board of a player's attempt at today's terrain, and whether it was open already.

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
        """Raise ValueError when a seed draws today's terrain: nobody may practise it before its day is over."""
        if seed is None:
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
        terrain = DailyTerrain.drawn(daily_secret(store), day, task.name, task.daily)
        add_series(store, terrain.series)
        return terrain


def terrain_on(reader: Reader, day: str) -> DailyTerrain | None:
    """Return the terrain of a day as the database keeps it, the most played of them in a merged one; None without one."""
    found = find_day(reader, day)
    return None if found is None else DailyTerrain.of(found)


def day_start_ms(day: str) -> int:
    """Return when a day began (UTC), in milliseconds since 1970; ValueError unless it is a date like "2026-11-22"."""
    if len(day) != 10:
        raise ValueError(f"a day must be a date like 2026-11-22, got {day!r}")
    began = datetime.combine(date.fromisoformat(day), datetime.min.time(), UTC)
    return int(began.timestamp()) * 1000


def day_before(day: str, days: int = 1) -> str:
    """Return the day that came so many days before."""
    return utc_day(day_start_ms(day) - days * DAY_MS)
