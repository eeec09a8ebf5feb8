"""The leaderboard of one server: people from the database, policies evaluated in the background."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

from app.leaderboard.closed_studies import ClosedStudies
from app.leaderboard.entries import LeaderboardEntry, list_entries
from app.leaderboard.evaluations import PolicyEvaluations
from app.leaderboard.human_summaries import HumanSummaries
from app.leaderboard.shipped import ShippedFigures
from app.play.policy_catalogue import PolicyOffer
from app.statistics.human_level import VolunteerFigures
from app.storage.reader import Reader

NOBODY_PLAYED = "Nobody has played this ranked yet."


class UnknownEntryError(LookupError):
    """The leaderboard has no entry with this id."""


class Leaderboard:
    """Reads people from the database and has the policies on offer evaluated.

    There is one reading at a time, on a thread of its own, and all who ask while one is under way share the next.

    volunteers  their figures, which other requests read as well
    """

    def __init__(self, database: Path, offers: Sequence[PolicyOffer], studies: Path) -> None:
        self._database, self._offers = database, offers
        self._evaluations = PolicyEvaluations(
            database.with_name(database.name + "-figures.json"), ShippedFigures()
        )
        self.volunteers = VolunteerFigures()
        self._people = HumanSummaries()
        self._studies = ClosedStudies(studies)
        self._reading = threading.Lock()
        self._thread = ThreadPoolExecutor(1, "leaderboard")
        self._turn = asyncio.Lock()
        self._next: asyncio.Task[list[LeaderboardEntry]] | None = None

    def entries(self) -> list[LeaderboardEntry]:
        """Return every entry; one thread at a time reads what has not been read before."""
        with self._reading, closing(Reader.open(self._database, public=True)) as reader:
            found = list_entries(reader, self._studies, self.volunteers)
            self._people.drop_all_but(
                (entry.config.hash, entry.human) for entry in found if entry.study is None
            )
        return found

    async def newest_entries(self) -> list[LeaderboardEntry]:
        """Return every entry as the database has it now, whoever else asks."""
        if self._next is None:
            self._next = asyncio.create_task(self._read_in_turn(), name="leaderboard")
        return await asyncio.shield(self._next)

    async def _read_in_turn(self) -> list[LeaderboardEntry]:
        async with self._turn:
            self._next = None  # this reading may miss what is written from now on
            return await asyncio.get_running_loop().run_in_executor(self._thread, self.entries)

    async def detail(self, entry_id: str) -> dict[str, Any]:
        """Return everything about one entry and begin evaluations that are missing; UnknownEntryError when there is none."""
        found = next((entry for entry in await self.newest_entries() if entry.id == entry_id), None)
        if found is None:
            raise UnknownEntryError(
                f"no board {entry_id!r} on the leaderboard; GET api/leaderboard lists them"
            )
        people = await asyncio.get_running_loop().run_in_executor(
            self._thread, self._people_of, found
        )
        size = (found.config.rows, found.config.cols)
        sources = {offer.name: offer.source for offer in self._offers if offer.size in (None, size)}
        jobs = found.jobs(sources)
        summaries = {offer.source: offer.summary for offer in self._offers}
        states = self._evaluations.request(list(jobs.values()))
        likeness = (found.human or {}).get("likeness", {})
        policies = [
            {
                "name": name,
                "summary": summaries.get(job.policy, ""),
                **state,
                "human_likeness": likeness.get(name),
            }
            for (name, job), state in zip(jobs.items(), states, strict=True)
        ]
        return {
            "board": found.to_dict(),
            "people": people,
            "policies": policies,
            "sentence": None if people else NOBODY_PLAYED,
        }

    async def close(self) -> None:
        """End the evaluation under way, and drop the readings that wait."""
        self._thread.shutdown(wait=False, cancel_futures=True)
        await self._evaluations.close()

    def _people_of(self, entry: LeaderboardEntry) -> dict[str, Any] | None:
        if entry.human is None or entry.study is not None:
            return entry.human
        with self._reading, closing(Reader.open(self._database, public=True)) as reader:
            pictures = self._people.pictures(reader, entry.config, entry.human)
        plain = ("players", "episodes", "abandoned", "score", "steps", "completed")
        return {**{name: entry.human[name] for name in plain}, **pictures}
