"""Watching somebody else's episode on the playground, by the id of the episode.

The id grants nothing else: no answer here holds a session's id, a player's or a seed. A spectator is no subscriber, so a board
that its player has left is not kept in memory by being watched, and a policy on it does not go on.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncGenerator
from contextlib import ExitStack, suppress
from typing import Any

from app.play.lobby import Lobby
from app.play.messages import encode_frame, encode_history
from app.play.replays import frames, restore_episode
from app.play.session import Session
from app.storage.playground import watchable_session
from app.storage.store import Resumable
from marsexplorer.episode import Episode, replay

LOOK_S = 2.0
"""Seconds between two looks for a board that is not in memory."""


class UnwatchableError(LookupError):
    """No episode with this id can be watched."""

    def __init__(self, episode_id: str) -> None:
        super().__init__(f"no episode {episode_id!r} that can be watched: check the link")


class Spectators:
    """What spectators are shown of the episodes of a lobby."""

    def __init__(self, lobby: Lobby) -> None:
        self._lobby = lobby

    async def describe(self, episode_id: str, viewer: str | None = None) -> dict[str, Any]:
        """Return an episode as it stands, with every frame once it has ended; UnwatchableError for any other id.

        viewer  the player who asks: a daily episode is shown to its own player alone until its day is over
        """
        found, episode = await self._stored(episode_id, viewer)
        config, driver = found.episode.config, found.episode.driver
        whole = await asyncio.to_thread(frames, episode.record(), episode_id) if found.ended else None
        return {
            "episode": episode_id,
            "player": found.session.driver_name if driver.startswith("policy:") else driver,
            "level": config.level,
            "size": config.rows if config.rows == config.cols else [config.rows, config.cols],
            "frame": json.loads(encode_frame(episode_id, episode)),
            "history": json.loads(encode_history(episode_id, episode)),
            "frames": whole,
        }

    async def messages(self, episode_id: str, viewer: str | None = None) -> AsyncGenerator[str, None]:
        """Yield the newest frame whenever it changes, and the history wherever frames were missed, until the episode ends.

        UnwatchableError for an id that cannot be watched. `viewer` as for `describe`.
        """
        newest, steps, woken = "", -2, asyncio.Event()
        board: Session | None = None
        with ExitStack() as listening:
            while True:
                woken.clear()
                if (now := self._board(episode_id, viewer)) is not board:
                    listening.close()
                    board = now
                    if board is not None:
                        listening.callback(board.channel.add_listener(woken.set))
                episode = (await self._stored(episode_id, viewer))[1] if board is None else board.episode
                frame = encode_frame(episode_id, episode) if board is None else board.frame
                has_ended, is_behind = episode.ended, episode.steps > steps + 1
                if frame != newest:
                    newest, steps = frame, episode.steps
                    history = encode_history(episode_id, episode) if is_behind else None
                    yield frame
                    if history is not None:
                        yield history
                if has_ended:
                    return
                with suppress(TimeoutError):
                    async with asyncio.timeout(LOOK_S):
                        await woken.wait()

    def _session_of(self, episode_id: str, viewer: str | None) -> str | None:
        """Return the id of the session of an episode that the viewer may watch."""
        found = watchable_session(self._lobby.store, episode_id, self._lobby.sources.clock_ms(), viewer)
        return None if found is None else found[0]

    def _board(self, episode_id: str, viewer: str | None) -> Session | None:
        """Return the board in memory on which an episode is the current one."""
        found = self._session_of(episode_id, viewer)
        board = None if found is None else self._lobby.in_memory(found)
        return board if board is not None and board.current.id == episode_id else None

    async def _stored(self, episode_id: str, viewer: str | None) -> tuple[Resumable, Episode]:
        """Return an episode as the store holds it; UnwatchableError for others, and where the rules have changed."""
        store = self._lobby.store
        found = store.find_episode(episode_id) if self._session_of(episode_id, viewer) else None
        if found is None:
            raise UnwatchableError(episode_id)
        try:
            if found.ended:
                return found, await asyncio.to_thread(replay, store.load_record(episode_id))
            return found, await asyncio.to_thread(restore_episode, found.episode, found.actions)
        except ValueError as error:
            raise UnwatchableError(episode_id) from error
