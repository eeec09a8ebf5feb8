"""The leaderboard of one server: people from the database, policies evaluated in the background."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from app.leaderboard.closed_studies import ClosedStudies
from app.leaderboard.entries import LeaderboardEntry, list_entries
from app.leaderboard.evaluations import PolicyEvaluations
from app.leaderboard.human_summaries import HumanSummaries
from app.play.policy_catalogue import PolicyOffer
from app.storage.reader import Reader

NOBODY = "Nobody has played this for the human score yet."


class UnknownBoardError(LookupError):
    """The leaderboard has no board with this id."""


class Leaderboard:
    """Reads people from the database and has the policies on offer evaluated."""

    def __init__(self, database: Path, offers: Sequence[PolicyOffer]) -> None:
        self._database, self._offers = database, offers
        self._evaluations = PolicyEvaluations(database.with_name(database.name + "-figures.json"))
        self._people = HumanSummaries()
        self._studies = ClosedStudies()
        self._reading = threading.Lock()

    def boards(self) -> list[LeaderboardEntry]:
        """Return every board; one thread at a time reads what has not been read before."""
        with self._reading, closing(Reader.open(self._database, public=True)) as reader:
            return list_entries(reader, self._studies)

    async def detail(self, board_id: str) -> dict[str, Any]:
        """Return everything about one board and begin evaluations that are missing; UnknownBoardError when there is none."""
        found = next((board for board in await asyncio.to_thread(self.boards) if board.id == board_id), None)
        if found is None:
            raise UnknownBoardError(f"no board {board_id!r} on the leaderboard; GET api/leaderboard lists them")
        people = await asyncio.to_thread(self._people_of, found)
        board = (found.config.rows, found.config.cols)
        sources = {offer.name: offer.source for offer in self._offers if offer.size in (None, board)}
        jobs = found.jobs(sources)
        names = {source: name for name, source in sources.items()}
        states = self._evaluations.request(jobs)
        policies = [{"name": names.get(job.policy, job.policy), **state} for job, state in zip(jobs, states, strict=True)]
        return {"board": found.to_dict(), "people": people, "policies": policies, "sentence": None if people else NOBODY}

    async def close(self) -> None:
        """End the evaluation under way."""
        await self._evaluations.close()

    def _people_of(self, board: LeaderboardEntry) -> dict[str, Any] | None:
        if board.human is None or board.study is not None:
            return board.human
        with self._reading, closing(Reader.open(self._database, public=True)) as reader:
            pictures = self._people.pictures(reader, board.config, board.human)
        plain = ("players", "episodes", "score", "steps", "completed")
        return {**{name: board.human[name] for name in plain}, **pictures}
