"""Rating what was played: policies play the terrains of ranked episodes, in the background and one after the other."""

from __future__ import annotations

import asyncio
import logging
import sqlite3
from collections.abc import Mapping
from typing import Any

from humanplay.board.lobby import Lobby
from humanplay.db import ratings
from humanplay.db.database import StoreError
from humanplay.jobs import JobError, Jobs, JobsFullError
from humanplay.task import GhostError, Record, rules_of

LOOK_S = 3.0
"""Seconds between two looks for games that are not rated yet."""
LONGEST_S = 60.0
"""Seconds that the policies may take on a terrain."""
_log = logging.getLogger(__name__)


def play_policies(sources: Mapping[str, str], task: str, record: Record) -> dict[str, int | None]:
    """Return the moves that policies need on the terrain of an episode, None for one that does not get there."""
    courses: Any = rules_of(task).courses
    play, found = courses.play_ghost, dict[str, int | None]()
    for name, source in sources.items():
        course = play(source, record)
        found[name] = course.moves if course.outcome == "explored" else None
    return found


class Ratings:
    """Rates what was played, one game after the other, in the background."""

    def __init__(self, lobby: Lobby, jobs: Jobs) -> None:
        self._lobby, self._jobs = lobby, jobs

    async def keep(self) -> None:
        """Rate whatever ends, for as long as the server runs."""
        while True:
            try:
                while await self.rate_next():
                    pass
            except (StoreError, sqlite3.Error) as error:
                _log.warning("no game was rated: %s", error)
            await asyncio.sleep(LOOK_S)

    async def rate_next(self) -> bool:
        """Rate the oldest game that is not rated yet; return whether there was one."""
        store, now = self._lobby.store, self._lobby.sources.clock_ms()
        game = await store.read(lambda: ratings.next_game(store, now))
        if game is None:
            return False
        try:
            policies = None if game.episode_id is None else await self._policies(game.episode_id)
        except JobsFullError:
            return False  # later
        await store.change(ratings.rate, game, policies)
        return True

    async def _policies(self, episode_id: str) -> dict[str, int | None] | None:
        """Return what the policies need on the terrain of an episode; None where they cannot play it."""
        store = self._lobby.store

        def read() -> tuple[str, Record] | None:
            found = store.find_episode(episode_id)
            return None if found is None else (found.episode.task, store.load_record(episode_id))

        sources = {each: each for each in ratings.MEASURED}
        try:
            if (found := await store.read(read)) is None or rules_of(found[0]).courses is None:
                return None
            asked: Any = {"owner": "ratings", "limit_s": LONGEST_S}
            return await self._jobs.run(play_policies, sources, *found, **asked)
        except (JobError, GhostError, ValueError) as error:
            _log.warning("the policies could not play the terrain of an episode: %s", error)
            return None
