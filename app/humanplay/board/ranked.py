"""Boards that the page begins: a ranked episode cannot be dropped by leaving it.

A ranked episode is one that a person plays alone, on the page, on a terrain that the server drew
(`humanplay.db.playground`). Once a move is made it counts, however it ends:

- whoever asks for a ranked board of the same configuration gets the open one back, where it stood;
- whoever begins any other board abandons the open one, which then counts at what that outcome
  costs;
- one that nobody has moved for a time is abandoned as well.

Any other board outside studies is closed after a day on which nothing was done on it.

An episode without a move has shown its terrain and stays open as it is. The player's next ranked
episode of that configuration is this one, so that nobody can exchange a terrain for another. It
does not count until a move is made.
"""

from __future__ import annotations

import asyncio
import logging
import sqlite3
from collections.abc import Sequence
from contextlib import suppress
from functools import partial

from humanplay.board.lobby import Lobby, Locks, UnknownSessionError
from humanplay.board.participation import HUMAN, RefusedError
from humanplay.board.session import Session
from humanplay.db.playground import (
    Deletion,
    delete_unplayed,
    left_since,
    newest_session,
    open_ranked,
    ranked_left_since,
    watchable_session,
)
from humanplay.db.store import StoreError
from humanplay.db.trial import Trial
from humanplay.task import Configuration, WantedBoard, WantedEpisode

SWEEP_S = 60.0
"""Most seconds between two looks for ranked episodes that were left."""

_log = logging.getLogger(__name__)


class PageBoards:
    """Begins boards for the page's players, and ends what is left.

    Args:
        abandon_after_s: How long a ranked episode waits for its next move.
        unplayed_h: Hours after which a board that is left is closed: deleted if nothing was
            done on it, else abandoned.
    """

    def __init__(self, lobby: Lobby, abandon_after_s: float, unplayed_h: float = 24.0) -> None:
        self._lobby, self._abandon_after_s, self._unplayed_h = lobby, abandon_after_s, unplayed_h
        self._locks = Locks()

    async def begin(self, wanted: WantedBoard, player_id: str) -> tuple[Session, bool]:
        """Begin a board for a player, or hand back the one that is open.

        Returns:
            The board, and whether it was open already.

        Raises:
            ValueError: As `Lobby.create`.
        """
        async with self._locks.of(player_id):
            return await self._begin(wanted, player_id)

    async def begin_next(self, session: Session, wanted: WantedEpisode) -> tuple[Session, bool]:
        """Begin the next episode of a player.

        It is on another board if the session's terrain, or one of the player's elsewhere, waits for
        its first move.

        Returns:
            The board that has it, and whether it was open already.

        Raises:
            ValueError: As `Lobby.restart`.
        """
        player_id = session.row.player_id
        if player_id is None or not _is_alone(self._lobby, session):
            await self._lobby.restart(session, wanted)
            return session, False
        async with self._locks.of(player_id):
            open_boards = await self._open(player_id)
            terrain = self._lobby.task.next(session.current, wanted)
            if session in open_boards and not session.shown.steps:
                again = self._lobby.task.wanted_again(terrain.config, wanted)
                return await self._begin(again, player_id)
            others = [board for board in open_boards if board is not session]
            waiting = None if terrain.is_chosen else _waiting(others, terrain.config)
            played = [board for board in others if board.shown.steps and board is not waiting]
            left = [] if terrain.is_chosen else played
            if waiting is None:
                await self._lobby.restart(session, wanted, left)
                return session, False
            await _abandon([*left, *(board for board in open_boards if board is session)])
            return waiting, True

    async def newest(self, player_id: str) -> Session | None:
        """The board that a player's page goes on with.

        It is their open ranked one, else their newest; None if there is none.
        """
        store, now = self._lobby.store, self._lobby.sources.clock_ms()
        session_id = await store.read(lambda: newest_session(store, player_id, now))
        if session_id is None:
            return None
        with suppress(UnknownSessionError):
            return await self._lobby.get(session_id)
        return None

    async def with_id(self, player_id: str, session_id: str) -> Session | None:
        """The board of an id, if it is the player's own; else None.

        None as well for a study's board and one of a daily terrain: they have pages of their own.
        """
        with suppress(UnknownSessionError):
            session = await self._lobby.get(session_id)
            is_own = session.row.player_id == player_id and not session.current.series
            return session if is_own else None
        return None

    async def with_link(self, player_id: str, link: str) -> Session | None:
        """The player's own board that a link shows; else None.

        The link names the board, or the episode that is current on it. It may be that of a rival's
        board or episode, which is on its player's screen.
        """
        session_id = await self._lobby.watch_ids.session(link)
        if session_id is None:
            store, now = self._lobby.store, self._lobby.sources.clock_ms()
            watchable = await store.read(lambda: watchable_session(store, link, now, player_id))
            session_id = None if watchable is None else watchable[0]
        with suppress(UnknownSessionError):
            session = None if session_id is None else await self._lobby.get(session_id)
            watched = self._lobby.watch_ids.of
            if session is not None and link in (session.current.id, watched(session.id)):
                return await self.with_id(player_id, session.row.rival_of or session.id)
        return None

    async def sweep(self) -> None:
        """Abandon what was left, again and again until cancelled."""
        while True:
            try:
                await self.abandon_left()
                await self.delete_unplayed()
            except (StoreError, sqlite3.Error) as error:
                # a page of the file that cannot be read, say: the next time perhaps it can
                _log.warning("ranked episodes that were left stay open for now: %s", error)
            await asyncio.sleep(min(SWEEP_S, self._abandon_after_s / 4))

    async def abandon_left(self) -> None:
        """Abandon every episode outside studies that was left.

        A ranked one after `abandon_after_s`, any other after `unplayed_h` hours.
        """
        now_ms, store = self._lobby.sources.clock_ms(), self._lobby.store
        ranked_ms = now_ms - round(1000 * self._abandon_after_s)
        any_ms = now_ms - round(3_600_000 * self._unplayed_h)
        rows = await store.read(
            lambda: ranked_left_since(store, ranked_ms) + left_since(store, any_ms)
        )
        for row in {row.id: row for row in rows}.values():
            board = await self._board_of(row)
            if board is not None and board.current.id == row.id:
                with suppress(RefusedError):  # a move came meanwhile
                    await board.abandon(row.id, row.moves)

    async def delete_unplayed(self) -> int:
        """Delete boards without a move that were left for `unplayed_h` hours.

        Boards in memory stay.

        Returns:
            How many were deleted.
        """
        lobby, count = self._lobby, 0
        before_ms = lobby.sources.clock_ms() - round(self._unplayed_h * 3_600_000)

        def delete(after: int) -> Deletion:
            return delete_unplayed(
                lobby.store,
                before_ms,
                lambda session_id: lobby.in_memory(session_id) is not None,
                after,
            )

        after: int | None = 0
        while after is not None:
            deleted, _, after = await lobby.store.write(
                partial(delete, after), then=lambda answer: lobby.forget(answer[0], answer[1])
            )
            count += len(deleted)
        return count

    async def _begin(self, wanted: WantedBoard, player_id: str) -> tuple[Session, bool]:
        open_boards = await self._open(player_id)
        is_ranked = wanted.player == HUMAN and wanted.rival is None
        terrain = await self._lobby.first_terrain(wanted)
        waiting = (
            _waiting(open_boards, terrain.config) if is_ranked and not terrain.is_chosen else None
        )
        played = [board for board in open_boards if board.shown.steps and board is not waiting]
        left = played if wanted.replays is None else []
        if waiting is None:
            return await self._lobby.create(wanted, player_id, "cookie", left), False
        await _abandon(left)
        return waiting, True

    async def _open(self, player_id: str) -> list[Session]:
        """The boards of a player's open ranked episodes, resumed if need be."""
        store = self._lobby.store
        rows = await store.read(lambda: open_ranked(store, player_id))
        boards = [(row, await self._board_of(row)) for row in rows]
        return [board for row, board in boards if board is not None and board.current.id == row.id]

    async def _board_of(self, row: Trial) -> Session | None:
        """The board of an open episode; None if its rules are gone."""
        with suppress(UnknownSessionError):
            return await self._lobby.get(row.session_id)
        return None


def _waiting(boards: Sequence[Session], config: Configuration) -> Session | None:
    """The board whose open episode is of a configuration."""
    alike = (board for board in boards if board.current.config == config)
    return next((board for board in alike if not board.shown.ended), None)


async def _abandon(boards: Sequence[Session]) -> None:
    for board in boards:
        with suppress(RefusedError):  # it has ended
            await board.abandon(board.current.id, None)


def _is_alone(lobby: Lobby, session: Session) -> bool:
    return (
        not session.has_policy and session.participation is None and lobby.rival_of(session) is None
    )
