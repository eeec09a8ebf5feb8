"""The board that is shown with another on the same terrain: a rival's, its player's, or a replay's.

Its path is drawn under the board's own, in 3-D and on the page, once the player's episode has ended.
"""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Self

from app.play.session import Session
from marsexplorer.episode import Episode


def player_board(session: Session) -> Session:
    """Return the player's of the two boards: the session itself unless it is the second."""
    return session.paired_with if session.is_second and session.paired_with is not None else session


def paired_episode(session: Session) -> Episode | None:
    """Return the episode whose path is drawn under the board's own; None until the player's episode has ended.

    None also where no board is paired, or where the two are on different terrains.
    """
    other = session.paired_with
    if other is None or not player_board(session).episode.ended:
        return None
    here, there = session.current, other.current
    return other.episode if (here.config, here.terrain) == (there.config, there.terrain) else None


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
        if player_board(self._session).episode.ended:
            self._wake()

    def _stop(self) -> None:
        if self._remove is not None:
            self._remove()
            self._remove = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stop()
