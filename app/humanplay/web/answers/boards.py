"""Answers about the boards that are played on."""

from __future__ import annotations

from humanplay.board.messages import Pace
from humanplay.board.session import SessionKind
from humanplay.db.rows import Attestation
from humanplay.web.answers.base import Answer, Frame, described
from humanplay.web.answers.server import Task


class Rival(Answer):
    """The policy that plays the same terrain beside you."""

    session: str
    policy: str
    pace: Pace | None
    frame: Frame


class Board(Answer):
    """A board with its running episode."""

    session: str = described("cannot be guessed: whoever knows it can watch and drive")
    kind: SessionKind
    challenges: str | None = described("the finished episode that is played against")
    player: str = described('"human", or a policy')
    task: Task
    level: str
    map: str | None
    size: int | list[int] | None = described("cells: one number for a square, or rows and columns")
    daily: str | None = described("the day whose terrain it is")
    counts: bool = described("whether the episode counts for the volunteers' figure so far")
    attestation: Attestation | None = described("once the episode has ended; null in a study")
    not_attested: str | None = described("why it is not attested")
    watch: str | None = described("id of /watch/{watch}, where anybody may look on")
    frame: Frame
    rival: Rival | None
