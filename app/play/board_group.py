"""The boards that begin together and leave memory together."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from app.play.agent import Agent
from app.play.session import Session


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
