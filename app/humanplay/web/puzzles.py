"""The puzzles of a day over HTTP.

Whoever answers one keeps that to themselves: nothing is sent here.
"""

from __future__ import annotations

from fastapi import APIRouter, HTTPException, Request

from humanplay.db.reader import utc_day
from humanplay.db.store import DAY_MS
from humanplay.results.puzzles import puzzles_of, puzzles_on
from humanplay.study.days import day_start_ms
from humanplay.web.access import services_of
from humanplay.web.answers.puzzles import PuzzleAnswer, Puzzles

router = APIRouter(prefix="/api/puzzles", tags=["daily"])


@router.get("", response_model=Puzzles, summary="Today's puzzles")
async def get_puzzles(request: Request) -> dict[str, object]:
    """Return today's positions, without their answers.

    404 where the environment has no puzzles.
    """
    services = services_of(request)
    task, now_ms = services.lobby.task, services.lobby.sources.clock_ms()
    day = utc_day(now_ms)
    if not (puzzles := puzzles_on(task.name, day)):
        raise HTTPException(404, f"{task.about.title} has no puzzles")
    return {
        "day": day,
        "now_ms": now_ms,
        "next_ms": day_start_ms(day) + DAY_MS,
        "puzzles": [
            {
                "id": puzzle.id,
                "frame": puzzle.frame,
                "trail": puzzle.trail,
                "moves": list(puzzle.answer.means),
            }
            for puzzle in puzzles
        ],
    }


@router.get("/{puzzle}/answer", response_model=PuzzleAnswer, summary="The answer to a puzzle")
async def get_answer(request: Request, puzzle: str) -> dict[str, object]:
    """Return the best first move, and what it saves.

    404 for a puzzle that there is not.
    """
    if (one := puzzles_of(services_of(request).lobby.task.name).get(puzzle)) is None:
        raise HTTPException(404, f"no puzzle {puzzle!r}; GET /api/puzzles has today's")
    return one.answer._asdict()
