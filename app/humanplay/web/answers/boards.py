"""Answers about the boards that are played on."""

from __future__ import annotations

from typing import Any

from humanplay.board.messages import Pace
from humanplay.board.session import SessionKind
from humanplay.db.rows import Attestation
from humanplay.web.answers.base import Answer, Frame, Problem, described
from humanplay.web.answers.server import Task


class Rival(Answer):
    """The policy that plays the same terrain beside you."""

    session: str
    policy: str
    pace: Pace | None
    frame: Frame


class NotCurrent(Problem):
    """An act that does not answer the current frame: nothing has changed."""

    frame: Frame = described("the current one")


class Board(Answer):
    """A board with its running episode."""

    session: str = described("cannot be guessed: whoever knows it can watch and drive")
    kind: SessionKind
    challenges: str | None = described("the finished episode that is played against")
    player: str = described('"human", or a policy')
    task: Task
    level: str
    map: str | None
    size: int | tuple[int, int] | None = described(
        "cells: one number for a square, or rows and columns"
    )
    daily: str | None = described("the day whose terrain it is")
    counts: bool = described("whether the episode counts for the volunteers' figure so far")
    attestation: Attestation | None = described("once the episode has ended; null in a study")
    not_attested: str | None = described("why it is not attested")
    watch: str | None = described("id of /watch/{watch}, where anybody may look on")
    frame: Frame
    rival: Rival | None


GONE_ON_WITH: dict[int | str, dict[str, Any]] = {
    200: {"model": Board, "description": "the board that was begun before"}
}
"""Instead of a new board."""
