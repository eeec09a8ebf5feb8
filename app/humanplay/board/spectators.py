"""Watching somebody else's board on the playground, by a link that grants nothing else.

A link names a board by its own id for watching (`humanplay.board.sources`) and shows one episode after the other on it. The
link of a replay names one episode, and leads here while that runs. No answer here holds a session's id, a player's, a seed,
or the id for watching where the link is another. A spectator is no subscriber, so a board that its player has left is not
kept in memory by being watched, and a policy on it does not go on.
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
from humanplay.db.store import Resumable
from humanplay.task import Run, describe, on_threads

LOOK_S = 2.0
"""Seconds between two looks for a board that is not in memory."""
P = ParamSpec("P")
T = TypeVar("T")


class Replayer:
    """Plays stored episodes again on a thread of its own, so that no board waits for it; owners take turns."""

    def __init__(self) -> None:
        self._turns, self._thread = Locks(), ThreadPoolExecutor(1, "replays")

    async def run(
        self, owner: str, function: Callable[P, T], *arguments: P.args, **named: P.kwargs
    ) -> T:
        """Return what a function comes to, once nothing else of the owner's runs or waits and its turn has come."""
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


class Shown(NamedTuple):
    """What a link shows now; `is_board`: it goes on with the next episode of that board."""

    session_id: str
    episode_id: str
    is_board: bool


class Spectators:
    """What spectators are shown of the boards of a lobby."""

    def __init__(self, lobby: Lobby, replayer: Replayer) -> None:
        self._lobby, self._replayer = lobby, replayer

    async def shown(self, link: str, viewer: str | None = None) -> Shown:
        """Return what a link shows: the newest episode of the board whose id for watching it is, or the episode of that id.

        viewer  the player who asks: a daily episode is shown to its own player alone until its day is over

        UnwatchableError for any other id.
        """
        store = self._lobby.store
        board = await self._lobby.watch_ids.session(link)

        def read() -> Shown:
            episode_id = link if board is None else newest_episode(store, board)
            now = self._lobby.sources.clock_ms()
            found = episode_id and watchable_session(store, episode_id, now, viewer)
            if not episode_id or not found:
                raise UnwatchableError(link)
            return Shown(found[0], episode_id, board is not None)

        return await store.read(read)

    async def describe(self, link: str, owner: str, viewer: str | None = None) -> dict[str, object]:
        """Return the episode that a link shows as it stands, with every frame once it has ended.

        `owner` is whose turn it is where moves are made again; UnwatchableError and `viewer` as for `shown`.
        """
        episode_id = (await self.shown(link, viewer)).episode_id
        found, run = await self._stored(episode_id, link, owner)
        task, shown = self._lobby.task, run.view()
        about = task.describe(found.episode)
        whole = None
        if found.ended:
            whole = await self._again(owner, task.frames, run.record(), episode_id)
        return {
            "episode": episode_id,
            "player": self._who_drives(found, viewer),
            "task": describe(task),
            **{each: about[each] for each in about if each != "map"},
            "frame": json.loads(shown.frame(episode_id)),
            "history": json.loads(shown.history(episode_id)),
            "frames": whole,
        }

    async def messages(
        self, link: str, owner: str, viewer: str | None = None
    ) -> AsyncGenerator[str, None]:
        """Yield the newest frame whenever it changes, and the history wherever frames were missed.

        It ends with the episode where the link names one, and never where it names a board: the next episode follows there.
        UnwatchableError, `owner` and `viewer` as for `describe`.
        """
        newest, steps, woken, last_id = "", -2, asyncio.Event(), ""
        board: Session | None = None
        with ExitStack() as listening:
            while True:
                woken.clear()
                session_id, episode_id, is_board = await self.shown(link, viewer)
                if episode_id != last_id:
                    last_id, steps = episode_id, -2
                if (now := self._board(session_id, episode_id)) is not board:
                    listening.close()
                    board = now
                    if board is not None:
                        listening.callback(board.channel.add_listener(woken.set))
                asked = episode_id, link, owner
                shown = board.shown if board else (await self._stored(*asked))[1].view()
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
    def _who_drives(found: Resumable, viewer: str | None) -> str:
        """Return "you" for the viewer's own hand, "human", "script", or a policy's name."""
        session, driver = found.session, found.episode.driver
        if driver.startswith("policy:"):
            return session.driver_name
        return "you" if viewer is not None and session.player_id == viewer else driver

    def _board(self, session_id: str, episode_id: str) -> Session | None:
        """Return a session's board if it is in memory and the episode is the current one on it."""
        board = self._lobby.in_memory(session_id)
        return board if board is not None and board.current.id == episode_id else None

    async def _stored(self, episode_id: str, link: str, owner: str) -> tuple[Resumable, Run]:
        """Return the episode that a link shows as the store holds it; UnwatchableError where the rules have changed."""
        store, task = self._lobby.store, self._lobby.task
        found = await store.read(lambda: store.find_episode(episode_id))
        if found is None:
            raise UnwatchableError(link)
        try:
            if found.ended:
                record = await store.read(lambda: store.load_record(episode_id))
                return found, await self._again(owner, task.replay_record, record)
            return found, await self._again(owner, task.replay, found.episode, found.actions)
        except ValueError as error:
            raise UnwatchableError(link) from error

    async def _again(
        self, owner: str, function: Callable[P, T], *arguments: P.args, **named: P.kwargs
    ) -> T:
        """Return what comes of moves that are made again: on the threads of a task that has some for waiting."""
        task = self._lobby.task
        if task.steps_on is not None:
            return await on_threads(task, partial(function, *arguments, **named))
        return await self._replayer.run(owner, function, *arguments, **named)
