"""Answers about the puzzles of a day."""

from __future__ import annotations

from humanplay.web.answers.base import Answer, Frame, described


class Puzzle(Answer):
    """A position in which one first move is clearly better than each other."""

    id: str
    frame: Frame
    trail: list[tuple[int, int]] = described("the way here, row and column after each move")
    moves: list[str] = described("those to choose from")


class Puzzles(Answer):
    """The puzzles of today (UTC), the same for everybody."""

    day: str = described("like 2026-11-22")
    now_ms: int = described("server time, milliseconds since 1970")
    next_ms: int = described("when the next day begins")
    puzzles: list[Puzzle]


class PuzzleAnswer(Answer):
    """The best first move of a puzzle, and what it saves against the next best."""

    best: str
    means: dict[str, float] = described("moves to the goal on average, by the first move")
    saves: float = described("moves on average")
    error: float = described("its standard error, moves")
    terrains: int = described("that agree with what is seen, over which it is the average")
    here: int = described("moves that it saves on the terrain itself")
