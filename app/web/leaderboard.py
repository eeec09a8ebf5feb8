"""The page /leaderboard and what it asks for."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import FileResponse

from app.leaderboard.closed_studies import ClosedStudies
from app.leaderboard.entries import LeaderboardEntry, list_entries
from app.leaderboard.evaluations import PolicyEvaluations
from app.leaderboard.human_summaries import HumanSummaries
from app.play.policy_catalogue import PolicyOffer
from app.storage.reader import Reader

NOBODY = "Nobody has played this for the human score yet."


class Leaderboard:
    """One server's: reads people from the database, has policies evaluated beside it."""

    def __init__(self, database: Path, offers: Sequence[PolicyOffer]) -> None:
        self._database, self._offers = database, offers
        self._figures = PolicyEvaluations(database.with_name(database.name + "-figures.json"))
        self._people = HumanSummaries()
        self._studies = ClosedStudies()
        self._reading = threading.Lock()

    def boards(self) -> list[LeaderboardEntry]:
        """Return every board; one thread at a time reads what has not been read before."""
        with self._reading, closing(Reader.open(self._database, public=True)) as reader:
            return list_entries(reader, self._studies)

    async def detail(self, board_id: str) -> dict[str, Any]:
        """Return everything about one board; evaluations that are missing begin. HTTPException 404 for an unknown one."""
        found = next((board for board in await asyncio.to_thread(self.boards) if board.id == board_id), None)
        if found is None:
            raise HTTPException(404, f"no board {board_id!r} on the leaderboard; GET api/leaderboard lists them")
        people = await asyncio.to_thread(self._people_of, found)
        board = (found.config.rows, found.config.cols)
        sources = {offer.name: offer.source for offer in self._offers if offer.size in (None, board)}
        jobs = found.jobs(sources)
        names = {source: name for name, source in sources.items()}
        states = self._figures.request(jobs)
        policies = [{"name": names.get(job.policy, job.policy), **state} for job, state in zip(jobs, states, strict=True)]
        return {"board": found.to_dict(), "people": people, "policies": policies, "sentence": None if people else NOBODY}

    async def close(self) -> None:
        """Return with the evaluation stopped."""
        await self._figures.close()

    def _people_of(self, board: LeaderboardEntry) -> dict[str, Any] | None:
        if board.human is None or board.study is not None:
            return board.human
        with self._reading, closing(Reader.open(self._database, public=True)) as reader:
            pictures = self._people.pictures(reader, board.config, board.human)
        plain = ("players", "episodes", "score", "steps", "completed")
        return {**{name: board.human[name] for name in plain}, **pictures}


def router(page: Path) -> APIRouter:
    """Return the routes; `page` is the HTML file."""
    routes = APIRouter()

    @routes.get("/leaderboard", include_in_schema=False)
    async def leaderboard() -> FileResponse:
        return FileResponse(page)

    @routes.get("/api/leaderboard", tags=["results"], summary="What people and policies are compared on")
    async def get_boards(request: Request) -> list[dict[str, Any]]:
        """One entry per closed study and per configuration; what people have played stands first."""
        request.app.state.progress.note_closed()
        return [board.to_dict() for board in await asyncio.to_thread(_of(request).boards)]

    @routes.get("/api/leaderboard/{board}", tags=["results"], summary="People, policies and rules on one scale")
    async def get_board(request: Request, board: str) -> dict[str, Any]:
        """Means with 95 % intervals: people's over players, policies' over held-out terrains, on which they are evaluated in
        the background when first asked for. Until then `state` says waiting or computing, and `figure` is null."""
        return await _of(request).detail(board)

    return routes


def _of(request: Request) -> Leaderboard:
    found: Leaderboard = request.app.state.leaderboard
    return found
