"""Answers about the boards that are played on."""

from __future__ import annotations

from pydantic import Field

from humanplay.board.messages import Pace
from humanplay.board.session import SessionKind
from humanplay.db.rows import Attestation
from humanplay.web.answers.base import Answer, Frame, Problem
from humanplay.web.answers.server import Task


class Rival(Answer):
    """The policy that plays the same terrain beside you."""

    session: str
    policy: str
    pace: Pace | None
    frame: Frame


class NotCurrent(Problem):
    """An act that does not answer the current frame: nothing has changed."""

    frame: Frame = Field(description="the current one")


class Board(Answer):
    """A board with its running episode."""

    session: str = Field(description="cannot be guessed: whoever knows it can watch and drive")
    kind: SessionKind
    challenges: str | None = Field(description="the finished episode that is played against")
    player: str = Field(description='"human", or a policy')
    task: Task
    level: str
    map: str | None
    size: int | tuple[int, int] | None = Field(
        description="cells: one number for a square, or rows and columns"
    )
    daily: str | None = Field(description="the day whose terrain it is")
    counts: bool = Field(description="whether the episode counts for the volunteers' figure so far")
    attestation: Attestation | None = Field(
        description="once the episode has ended; null in a study"
    )
    not_attested: str | None = Field(description="why it is not attested")
    watch: str | None = Field(description="id of /watch/{watch}, where anybody may look on")
    frame: Frame
    rival: Rival | None


GONE_ON_WITH: dict[int | str, dict[str, object]] = {
    200: {"model": Board, "description": "the board that was begun before"}
}
"""Instead of a new board."""
