"""The replays of a server.

Who asks for an episode gets its course, a policy's on the same terrain, and files of both. What
takes long is a job (`humanplay.jobs`); what was made lately is kept.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from humanplay.board.spectators import Replayer
from humanplay.jobs import JobOptions, Jobs
from humanplay.task import Course, GhostError, PolicyOffer, RunEndedError, Task
from humanplay.task.registration import environment_of
from humanplay.web.replays.episodes import (
    Asker,
    ShownEpisode,
    UnknownReplayError,
    courses_of,
    shown_episode,
)
from humanplay.web.replays.files import Format, file_of
from humanplay.web.replays.page import document

MAX_COURSES = 64
"""Courses of policies that are kept."""
MAX_FILES = 16
"""Files and replays that are kept."""
FILE_S = 90.0
"""Seconds for a file of a replay."""
GHOST_S = 180.0
"""Seconds for a policy's whole episode: it is compiled first, perhaps.

The job has the lowest priority, and what took too long is refused for ten minutes.
"""
SOON_S = 0.2
"""Seconds that a page waits for an environment that is played again."""
T = TypeVar("T")


@dataclass(frozen=True)
class Replay:
    """A finished episode that the asker may see, as a replay shows it.

    Attributes:
        ghosts: Names of the policies that can be shown beside it.
        preferred: The one that is shown when none is chosen.
    """

    episode: ShownEpisode
    course: Course
    ghosts: tuple[str, ...]
    preferred: str | None

    def document(self) -> dict[str, Any]:
        """Return what the page reads."""
        return document(self.episode.id, self.course, self.ghosts, self.preferred)


class Replays:
    """Replays of one server.

    Every call asks the database again whether the episode may be seen. `owner` is whose turn it is
    where something takes long.
    """

    def __init__(
        self,
        database: Path,
        offers: Sequence[PolicyOffer],
        jobs: Jobs,
        task: Task,
        replayer: Replayer,
    ) -> None:
        self._database, self._jobs, self._task, self._replayer = database, jobs, task, replayer
        self._offers = {offer.name: offer for offer in offers}
        self._courses: dict[Hashable, Course] = {}
        self._files: dict[Hashable, bytes] = {}
        self._replays: dict[Hashable, Replay] = {}
        self._begun: dict[Hashable, asyncio.Task[Replay]] = {}

    async def has(self, episode_id: str, asker: Asker) -> bool:
        """Whether there is a replay of an episode for whoever asks."""
        try:
            episode = await asyncio.to_thread(shown_episode, self._database, episode_id, asker)
        except UnknownReplayError:
            return False
        return self._plays(episode.trial.task)

    async def replay(self, episode_id: str, asker: Asker, owner: str) -> Replay:
        """The replay of an episode.

        Raises:
            UnknownReplayError: If the asker may see none.
            ValueError: If the rules that it was played by are gone.
        """
        return await self._replayer.run(owner, self._replay, await self._shown(episode_id, asker))

    async def replay_soon(self, episode_id: str, asker: Asker, owner: str) -> Replay | None:
        """The same as `replay`; None while an environment in a process is played again.

        It goes on, whoever asks meanwhile.
        """
        episode = await self._shown(episode_id, asker)
        if self._task.courses is not None:
            return await self._replayer.run(owner, self._replay, episode)
        key = episode_id, asker
        if (begun := self._begun.get(key)) is None:
            begun = asyncio.create_task(self._replayer.run(owner, self._replay, episode))
            # nobody may ask for it again, and then nobody would take what it raised
            begun.add_done_callback(lambda task: task.cancelled() or task.exception())
            _keep(self._begun, MAX_FILES, key, begun)
        await asyncio.wait({begun}, timeout=SOON_S)
        if not begun.done():
            return None
        self._begun.pop(key, None)
        return begun.result()

    async def _shown(self, episode_id: str, asker: Asker) -> ShownEpisode:
        """An episode that the asker may see, of a task that is played here."""
        episode = await asyncio.to_thread(shown_episode, self._database, episode_id, asker)
        if not self._plays(task := episode.trial.task):
            raise UnknownReplayError(f"this server plays no episodes of {task}")
        return episode

    async def ghost(self, episode_id: str, name: str, asker: Asker, owner: str) -> Course:
        """The course of a policy on the terrain of an episode.

        Raises:
            GhostError: If it cannot play there; JobError and JobsFullError as well, see `replay`.
        """
        episode = await asyncio.to_thread(shown_episode, self._database, episode_id, asker)
        return await self._ghost(episode, name, owner)

    async def file(
        self, episode_id: str, form: Format, ghost: str | None, asker: Asker, owner: str
    ) -> bytes:
        """A replay as a file; see `ghost`.

        Args:
            ghost: A policy on the same terrain; None: without.
        """
        shown = await self.replay(episode_id, asker, owner)
        key = ("replay", episode_id, shown.episode.trial.trajectory_hash, form, ghost)
        if (cached := self._files.get(key)) is not None:
            return cached  # also if the ghost's course is gone
        courses = [shown.course.with_name(shown.episode.name)]  # a file is for everybody
        if ghost is not None:
            courses.append(await self._ghost(shown.episode, ghost, owner))
        return await self._write_once(key, owner, file_of, form, episode_id, courses)

    async def challenge(self, episode_id: str, asker: Asker, owner: str) -> bytes:
        """The picture of a challenge to an episode.

        Raises:
            UnknownReplayError: See `replay`; JobError and JobsFullError as well.
        """
        shown = await self.replay(episode_id, asker, owner)
        key = ("challenge", episode_id, shown.episode.trial.trajectory_hash)
        return await self._write_once(key, owner, shown.course.preview, True)

    async def _write_once(
        self, key: Hashable, owner: str, write: Callable[..., bytes], *arguments: object
    ) -> bytes:
        """A file that is kept, or is written and kept."""
        if (cached := self._files.get(key)) is not None:
            return cached
        options: JobOptions = {"owner": owner, "key": key, "limit_s": FILE_S}
        content = await self._jobs.run(write, *arguments, **options)
        return _keep(self._files, MAX_FILES, key, content)

    def _plays(self, task: str) -> bool:
        """Whether a task is the server's, or drawn in the server's process."""
        return task == self._task.name or environment_of(task).courses is not None

    def _replay(self, episode: ShownEpisode) -> Replay:
        """A replay that is kept, or is made and kept.

        Call it on the replayer's one thread.
        """
        key = episode.id, episode.trial.trajectory_hash, episode.asker_name
        if (cached := self._replays.get(key)) is not None:
            return cached
        courses = courses_of(episode, self._task)
        try:
            course = courses.course_of(episode.asker_name, episode.record)
        except RunEndedError as error:
            raise ValueError(str(error)) from error
        ghosts = courses.choices(list(self._offers.values()), episode.trial.config)
        replay = Replay(episode, course, tuple(ghosts), courses.preferred(episode.name, ghosts))
        return _keep(self._replays, MAX_FILES, key, replay)

    async def _ghost(self, episode: ShownEpisode, name: str, owner: str) -> Course:
        if name not in self._offers:
            raise GhostError(f"no policy {name!r}; choose one of: {', '.join(self._offers)}")
        trial = episode.trial
        key = ("ghost", name, trial.config.hash, trial.terrain, trial.start)
        if (cached := self._courses.get(key)) is not None:
            return cached
        record = await self._replayer.run(owner, lambda: episode.record)
        play, source = courses_of(episode).play_ghost, self._offers[name].source
        course = await self._jobs.run(play, source, record, owner=owner, key=key, limit_s=GHOST_S)
        return _keep(self._courses, MAX_COURSES, key, course)


def _keep(cache: dict[Hashable, T], most: int, key: Hashable, value: T) -> T:
    """Keep a value in the place of the oldest one, and return it."""
    cache[key] = value
    if len(cache) > most:
        del cache[next(iter(cache))]
    return value
