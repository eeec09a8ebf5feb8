"""The board beside a board: its path is drawn under one's own, in 3-D as on the page, once the player's episode has ended."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Self

from app.play.session import Session
from marsexplorer.episode import Episode


def player_of(session: Session) -> Session:
    """Return the player's of the two boards: the session itself unless it is the second."""
    return session.paired_with if session.is_second and session.paired_with is not None else session


def ghost_of(session: Session) -> Episode | None:
    """Return the episode whose path belongs under the board's own: the other's, once the player's has ended on that terrain."""
    other = session.paired_with
    if other is None or not player_of(session).episode.ended:
        return None
    here, there = session.current, other.current
    return other.episode if (here.config, here.terrain) == (there.config, there.terrain) else None


class Neighbour:
    """Wakes whoever shows a board when the board beside it moves, while its path is drawn; a context manager.

    `attend` hears the one that is beside now, `wake` is called without arguments.
    """

    def __init__(self, session: Session, wake: Callable[[], None]) -> None:
        self._session, self._wake = session, wake
        self._heard: Session | None = None
        self._leave: Callable[[], None] = lambda: None

    def attend(self) -> None:
        """Return with the present neighbour heard, and no other."""
        if self._session.paired_with is not self._heard:
            self._leave()
            self._heard = self._session.paired_with
            self._leave = self._heard.channel.listen(self._tell) if self._heard is not None else lambda: None

    def _tell(self) -> None:
        if player_of(self._session).episode.ended:
            self._wake()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._leave()
