"""The replays of a server: who asks for an episode gets its course, a policy's on the same terrain, and files of both.

What takes long is worked out on one thread, one after the other, so that it takes the interpreter from the moves of players as
little as possible; what was asked for lately is kept.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from app.play.policy_catalogue import PolicyOffer
from app.replay.course import Course, course_of
from app.replay.episodes import Asker, ShownEpisode, UnknownReplayError, shown_episode
from app.replay.files import Format, file_of
from app.replay.ghosts import GhostError, choices, play_ghost, preferred
from marsexplorer.episode import Record

MAX_WAITING = 16
"""Requests that wait for their turn; another one is refused."""
MAX_COURSES, MAX_FILES = 64, 16
"""Courses of policies, and files, that are kept."""
T = TypeVar("T")


class ReplayBusyError(RuntimeError):
    """More replays have been asked for than can be worked out soon."""


@dataclass(frozen=True)
class Replay:
    """A finished episode that the asker may see, as a replay shows it.

    ghosts  names of the policies that can be shown beside it; preferred is the one that is shown when none is chosen
    """

    episode: ShownEpisode
    course: Course
    ghosts: tuple[str, ...]
    preferred: str | None

    def document(self) -> dict[str, Any]:
        """Return what the page reads; no seed, no player and no session is in it."""
        config = self.course.config
        return {
            "episode": self.episode.id,
            "level": config.level,
            "rows": config.rows,
            "cols": config.cols,
            "run": self.course.to_dict(),
            "ghosts": list(self.ghosts),
            "preferred": self.preferred,
        }


class Replays:
    """Replays of one server; every call asks the database again whether the episode may be seen."""

    def __init__(self, database: Path, offers: Sequence[PolicyOffer]) -> None:
        self._database = database
        self._offers = {offer.name: offer for offer in offers}
        self._thread = ThreadPoolExecutor(1, "replays")
        self._waiting = 0
        self._courses: _Kept[Course] = _Kept(MAX_COURSES)
        self._files: _Kept[bytes] = _Kept(MAX_FILES)

    async def has(self, episode_id: str, asker: Asker) -> bool:
        """Return whether there is a replay of an episode for whoever asks."""
        try:
            await asyncio.to_thread(shown_episode, self._database, episode_id, asker)
        except UnknownReplayError:
            return False
        return True

    async def replay(self, episode_id: str, asker: Asker) -> Replay:
        """Return the replay of an episode.

        UnknownReplayError where the asker may see none, ValueError where the rules that it was played by are gone.
        """
        return await asyncio.to_thread(self._replay, episode_id, asker)

    async def ghost(self, episode_id: str, name: str, asker: Asker) -> Course:
        """Return the course of a policy on the terrain of an episode; GhostError as well, see `replay`."""
        return await self._work(
            lambda: self._ghost(shown_episode(self._database, episode_id, asker).record, name)
        )

    async def file(self, episode_id: str, form: Format, ghost: str | None, asker: Asker) -> bytes:
        """Return a replay as a file, with a policy on the same terrain unless `ghost` is None; see `ghost`."""
        replay = await self.replay(episode_id, asker)
        record, course = (
            replay.episode.record,
            replace(replay.course, name=replay.episode.name),
        )  # a file is for everybody

        def write() -> bytes:
            courses = [course, *([] if ghost is None else [self._ghost(record, ghost)])]
            return file_of(form, episode_id, courses)

        return await self._work(
            lambda: self._files.get((episode_id, record.trajectory_hash, form, ghost), write)
        )

    def close(self) -> None:
        """Drop what waits; what is being worked out ends by itself."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _replay(self, episode_id: str, asker: Asker) -> Replay:
        episode = shown_episode(self._database, episode_id, asker)
        course = course_of(episode.asker_name, episode.record)
        ghosts = choices(list(self._offers.values()), course.config)
        return Replay(episode, course, tuple(ghosts), preferred(ghosts, episode.name))

    def _ghost(self, record: Record, name: str) -> Course:
        if name not in self._offers:
            raise GhostError(f"no policy {name!r}; choose one of: {', '.join(self._offers)}")
        key = (name, record.config.hash, record.terrain, record.start)
        return self._courses.get(key, lambda: play_ghost(self._offers[name].source, record))

    async def _work(self, work: Callable[[], T]) -> T:
        if self._waiting >= MAX_WAITING:
            raise ReplayBusyError("many people are asking for replays; ask again in a minute")
        self._waiting += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._thread, work)
        finally:
            self._waiting -= 1


class _Kept(Generic[T]):
    """The newest results of work that takes long."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._values: OrderedDict[Hashable, T] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what is kept under a key, or make and keep it."""
        if key in self._values:
            self._values.move_to_end(key)
            return self._values[key]
        value = self._values[key] = make()
        if len(self._values) > self._most:
            self._values.popitem(last=False)
        return value
