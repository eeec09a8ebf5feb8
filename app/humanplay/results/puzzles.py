"""Puzzles: shipped positions, three a day, the same for everybody.

Nothing of them is stored here: which move somebody chose stays in their browser, and no figure reads it.
"""

from __future__ import annotations

import json
from datetime import date
from functools import lru_cache
from typing import NamedTuple

from humanplay import SHIPPED_DATA

A_DAY = 3
"""Puzzles a day."""
FOLDER = SHIPPED_DATA / "puzzles"


class Answer(NamedTuple):
    """The first move that is best, and what it saves against the next best.

    means     moves to the goal on average, by the first move
    saves     moves on average over `terrains`, with the standard error
    here      moves on the terrain itself
    shows     cells that come in sight there within the next eight moves, by the first move
    """

    best: str
    means: dict[str, float]
    saves: float
    error: float
    terrains: int
    here: int
    shows: dict[str, list[tuple[int, int]]]


class Puzzle(NamedTuple):
    """A position: its frame, and the marks of the way so far."""

    id: str
    frame: dict[str, object]
    trail: list[tuple[int, int]]
    answer: Answer


@lru_cache
def puzzles_of(task: str) -> dict[str, Puzzle]:
    """The puzzles of a task by their ids; none if it has no file."""
    # a name may be a whole description: too long for a path, and with slashes in it
    paths = {path.stem: path for path in FOLDER.glob("*.json")}
    if task not in paths:
        return {}
    rows = json.loads(paths[task].read_text())["puzzles"]
    return {
        row["id"]: Puzzle(row["id"], row["frame"], row["trail"], Answer(**row["answer"]))
        for row in rows
    }


def puzzles_on(task: str, day: str) -> list[Puzzle]:
    """The three puzzles of a day (UTC, "2026-11-22"); they repeat after the last."""
    puzzles = list(puzzles_of(task).values())
    first = A_DAY * date.fromisoformat(day).toordinal()
    count = min(A_DAY, len(puzzles))
    return [puzzles[(first + number) % len(puzzles)] for number in range(count)]
