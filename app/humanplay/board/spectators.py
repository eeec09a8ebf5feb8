"""Watching somebody else's board by a link that grants nothing else.

A link names a board by its own id for watching (`humanplay.board.sources`) and shows one episode
after the other on it. The link of a replay names one episode, and leads here while that runs. No
answer here holds a session's id, a player's, a seed, or the id for watching if the link is another.
A spectator is no subscriber, so a board that its player has left is not kept in memory by being
watched, and a policy on it does not go on.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncGenerator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from typing import NamedTuple, ParamSpec, TypeVar

from humanplay.board.lobby import Lobby, Locks
from humanplay.board.session import Session
from humanplay.db.playground import newest_episode, watchable_session
from humanplay.db.store import StoredEpisode
from humanplay.task import Run, describe, on_threads

LOOK_S = 2.0
"""Seconds between two looks for a board that is not in memory."""
P = ParamSpec("P")
T = TypeVar("T")


class Replayer:
    """Replays stored episodes on a thread of its own, so that no board waits for it.

    Owners take turns.
    """

    def __init__(self) -> None:
        self._turns, self._thread = Locks(), ThreadPoolExecutor(1, "replays")

    async def run(
        self, owner: str, function: Callable[P, T], *arguments: P.args, **named: P.kwargs
    ) -> T:
        """Call a function on the thread, after all else that its owner has asked for."""
        async with self._turns.of(owner):
            loop = asyncio.get_running_loop()
            call = partial(function, *arguments, **named)
            return await loop.run_in_executor(self._thread, call)

    def close(self) -> None:
        """Begin nothing more."""
        self._thread.shutdown(wait=False, cancel_futures=True)


class UnwatchableError(LookupError):
    """No board or episode with this id can be watched."""

    def __init__(self, link: str) -> None:
        super().__init__(f"no episode {link!r} that can be watched: check the link")


class WatchedEpisode(NamedTuple):
    """What a link shows now.

    Attributes:
        is_board: Whether it goes on with the next episode of that board.
    """

    session_id: str
    episode_id: str
    is_board: bool


class Spectators:
    """What spectators are shown of the boards of a lobby."""

    def __init__(self, lobby: Lobby, replayer: Replayer) -> None:
        self._lobby, self._replayer = lobby, replayer

    async def watched_episode(self, link: str, viewer: str | None = None) -> WatchedEpisode:
        """What a link shows: the newest episode of a board, or one episode.

        Args:
            link: The board's id for watching, or the episode's id.
            viewer: The player who asks: a daily episode is shown to its own player alone until its
                day is over.

        Raises:
            UnwatchableError: For any other id.
        """
        store = self._lobby.store
        board = await self._lobby.watch_ids.session(link)

        def read() -> WatchedEpisode:
            episode_id = link if board is None else newest_episode(store, board)
            now = self._lobby.sources.clock_ms()
            watchable = episode_id and watchable_session(store, episode_id, now, viewer)
            if not episode_id or not watchable:
                raise UnwatchableError(link)
            return WatchedEpisode(watchable[0], episode_id, board is not None)

        return await store.read(read)

    async def describe(self, link: str, owner: str, viewer: str | None = None) -> dict[str, object]:
        """The episode that a link shows, with every frame once it has ended.

        Args:
            owner: Whose turn it is to have moves replayed.
            viewer: As for `watched_episode`.

        Raises:
            UnwatchableError: As for `watched_episode`.
        """
        episode_id = (await self.watched_episode(link, viewer)).episode_id
        stored, run = await self._read_stored(episode_id, link, owner)
        task, shown = self._lobby.task, run.view()
        about = task.describe(stored.episode)
        whole = None
        if stored.ended:
            whole = await self._again(owner, task.frames, run.record(), episode_id)
        return {
            "episode": episode_id,
            "player": self._who_drives(stored, viewer),
            "task": describe(task),
            **{name: about[name] for name in about if name != "map"},
            "frame": json.loads(shown.frame(episode_id)),
            "history": json.loads(shown.history(episode_id)),
            "frames": whole,
        }

    async def messages(
        self, link: str, owner: str, viewer: str | None = None
    ) -> AsyncGenerator[str, None]:
        """Yield the newest frame whenever it changes, and the history after a gap.

        It ends with the episode if the link names one, and never if it names a board: the next
        episode follows there.

        Args:
            owner: Whose turn it is to have moves replayed.
            viewer: As for `watched_episode`.

        Raises:
            UnwatchableError: As for `watched_episode`.
        """
        newest, steps, woken, last_id = "", -2, asyncio.Event(), ""
        board: Session | None = None
        with ExitStack() as listening:
            while True:
                woken.clear()
                session_id, episode_id, is_board = await self.watched_episode(link, viewer)
                if episode_id != last_id:
                    last_id, steps = episode_id, -2
                if (now := self._board(session_id, episode_id)) is not board:
                    listening.close()
                    board = now
                    if board is not None:
                        listening.callback(board.channel.add_listener(woken.set))
                asked = episode_id, link, owner
                shown = board.shown if board else (await self._read_stored(*asked))[1].view()
                frame = shown.frame(episode_id) if board is None else board.frame
                has_ended, is_behind = shown.ended, shown.steps > steps + 1
                if frame != newest:
                    newest, steps = frame, shown.steps
                    history = shown.history(episode_id) if is_behind else None
                    yield frame
                    if history is not None:
                        yield history
                if has_ended and not is_board:
                    return
                with suppress(TimeoutError):
                    async with asyncio.timeout(LOOK_S):
                        await woken.wait()

    @staticmethod
    def _who_drives(stored: StoredEpisode, viewer: str | None) -> str:
        """Who drives: "you" for the viewer, "human", "script", or a policy's name."""
        session, driver = stored.session, stored.episode.driver
        if driver.startswith("policy:"):
            return session.driver_name
        return "you" if viewer is not None and session.player_id == viewer else driver

    def _board(self, session_id: str, episode_id: str) -> Session | None:
        """A session's board, if it is in memory and the episode is current on it."""
        board = self._lobby.in_memory(session_id)
        return board if board is not None and board.current.id == episode_id else None

    async def _read_stored(
        self, episode_id: str, link: str, owner: str
    ) -> tuple[StoredEpisode, Run]:
        """The episode that a link shows, as the store holds it.

        Raises:
            UnwatchableError: If it is not there or the rules have changed.
        """
        store, task = self._lobby.store, self._lobby.task
        stored = await store.read(lambda: store.find_episode(episode_id))
        if stored is None:
            raise UnwatchableError(link)
        try:
            if stored.ended:
                record = await store.read(lambda: store.load_record(episode_id))
                return stored, await self._again(owner, task.replay_record, record)
            return stored, await self._again(owner, task.replay, stored.episode, stored.actions)
        except ValueError as error:
            raise UnwatchableError(link) from error

    async def _again(
        self, owner: str, function: Callable[P, T], *arguments: P.args, **named: P.kwargs
    ) -> T:
        """Replay moves, on the threads of a task that has some for waiting."""
        task = self._lobby.task
        if task.steps_on is not None:
            return await on_threads(task, partial(function, *arguments, **named))
        return await self._replayer.run(owner, function, *arguments, **named)
