"""Answers about the puzzles of a day."""

from __future__ import annotations

from pydantic import Field

from humanplay.web.answers.base import Answer, Frame


class Puzzle(Answer):
    """A position in which one first move is clearly better than each other."""

    id: str
    frame: Frame
    trail: list[tuple[int, int]] = Field(description="the way here, row and column after each move")
    moves: list[str] = Field(description="those to choose from")


class Puzzles(Answer):
    """The puzzles of today (UTC), the same for everybody."""

    day: str = Field(description="like 2026-11-22")
    now_ms: int = Field(description="server time, milliseconds since 1970")
    next_ms: int = Field(description="when the next day begins")
    puzzles: list[Puzzle]


class PuzzleAnswer(Answer):
    """The best first move of a puzzle, and what it saves against the next best."""

    best: str
    means: dict[str, float] = Field(description="moves to the goal on average, by the first move")
    saves: float = Field(description="moves on average")
    error: float = Field(description="its standard error, moves")
    terrains: int = Field(description="that agree with what is seen, over which it is the average")
    here: int = Field(description="moves that it saves on the terrain itself")
    shows: dict[str, list[tuple[int, int]]] = Field(
        description="rows and columns that come in sight there within eight moves, by the first move"
    )
