"""Boards that belong together: a player's and its rival's, and the board that is shown with another on the same terrain.

Its path is drawn under the board's own, in 3-D and on the page, once the player's episode has ended.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from app.play.agent import Agent
from app.play.session import Session
from app.tasks.mars.view import View


@dataclass
class BoardGroup:
    """A player's board and its rival's, if there is one: they begin together and are unloaded together."""

    player: Session
    rival: Session | None
    lock: asyncio.Lock
    agents: dict[str, Agent]

    @property
    def boards(self) -> list[Session]:
        """Return the player's board, then the rival's if there is one."""
        return [self.player] if self.rival is None else [self.player, self.rival]

    def board(self, session_id: str) -> Session:
        """Return the one of the boards that has this session's id."""
        return next(board for board in self.boards if board.id == session_id)


def player_board(session: Session) -> Session:
    """Return the player's of the two boards: the session itself unless it is the second."""
    return session.paired_with if session.is_second and session.paired_with is not None else session


def paired_episode(session: Session) -> View | None:
    """Return the episode whose path is drawn under the board's own; None until the player's episode has ended.

    None also where no board is paired, or where the two are on different terrains.
    """
    other = session.paired_with
    if other is None or not player_board(session).shown.ended:
        return None
    here, there = session.current, other.current
    return other.shown if (here.config, here.terrain) == (there.config, there.terrain) else None


class PairedBoardListener:
    """Wakes whoever shows a board when the paired board moves, while that board's path is drawn; a context manager.

    Call `update` before each drawing: the paired board may be another one by then. `wake` is called without arguments.
    """

    def __init__(self, session: Session, wake: Callable[[], None]) -> None:
        self._session, self._wake = session, wake
        self._listened_to: Session | None = None
        self._remove: Callable[[], None] | None = None

    def update(self) -> None:
        """Listen to the board that is paired now, and to no other."""
        if self._session.paired_with is self._listened_to:
            return
        self._stop()
        self._listened_to = self._session.paired_with
        if self._listened_to is not None:
            self._remove = self._listened_to.channel.add_listener(self._on_change)

    def _on_change(self) -> None:
        if player_board(self._session).shown.ended:
            self._wake()

    def _stop(self) -> None:
        if self._remove is not None:
            self._remove()
            self._remove = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop()
