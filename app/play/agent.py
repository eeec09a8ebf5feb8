"""A policy that drives a session: it waits for its turn, decides off the event loop, and moves like anyone else."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from contextlib import suppress
from math import nan
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from app.database_file.errors import WriteRefusedError
from app.database_file.write_queue import NOTICE_S
from app.play.decision_queue import DecisionQueue, SlowDecisionError
from app.play.messages import Pace, encode_thought
from app.play.replays import restore_episode
from app.play.session import Move, RefusedError, Session
from app.storage.store import EpisodeRow, StoreError
from marsexplorer.policies import Policy, goal_of

DEFAULT_MOVES_PER_SECOND = 8.0
"""Of a policy's board until somebody changes its pace, and of a rival whose player's episode has ended."""

_log = logging.getLogger(__name__)


@runtime_checkable
class ReportsThought(Protocol):
    """A policy that reports its probabilities and its value of the last observation that it decided on."""

    def thought(self) -> tuple[NDArray[np.float32], float]:
        """Return (probabilities float32[4], value)."""


class Agent:
    """Drives `session`; with a `player` it can follow, which is one move for each of the player's.

    It decides as soon as it sees a frame, publishes its thought about it, then waits for its turn to move.
    It counts moves and not wakes, so however late it is, it ends on the player's number of steps.
    """

    def __init__(
        self,
        session: Session,
        player: Session | None,
        load: Callable[[], Policy],
        decisions: DecisionQueue,
    ) -> None:
        self._session, self._player, self._load, self._decisions = session, player, load, decisions
        self._owner = (player or session).row.player_id or session.id
        self._policy: Policy | None = None
        self._prepared_for: EpisodeRow | None = None
        self._decided: tuple[str, int, int] | None = None
        self._woken = asyncio.Event()
        self._single_moves = 0
        self._due = 0.0
        watched = [session] if player is None else [session, player]
        self._listeners = [board.channel.add_listener(self._woken.set) for board in watched]
        self._task = asyncio.create_task(self._run(), name=f"agent of {session.id}")

    def move_once(self) -> None:
        """Let one move happen whatever the pace."""
        self._single_moves += 1
        self._woken.set()

    def close(self) -> None:
        """Stop driving; a decision under way is dropped."""
        for remove in self._listeners:
            remove()
        self._task.cancel()

    async def _run(self) -> None:
        while True:
            try:
                if self._is_undecided():
                    await self._decide()
                    continue
                delay = self._delay()
                if delay is None or delay > 0:
                    await self._sleep(delay)
                    continue
                await self._move()
            except WriteRefusedError:
                await asyncio.sleep(NOTICE_S)
            except RefusedError:
                self._decided = None  # the next episode began while the move waited
            except SlowDecisionError as error:
                await self._give_up(error)
            except Exception as error:
                _log.exception("the policy %s failed", self._session.row.driver_name)
                self._single_moves, self._prepared_for, self._decided = 0, None, None
                self._session.fail(f"the policy {self._session.row.driver_name!r} failed: {error}")

    async def _give_up(self, error: SlowDecisionError) -> None:
        """Pause the board and say why; its policy is still at work on that decision, so the next one is of a fresh copy."""
        session = self._session
        self._policy, self._single_moves, self._prepared_for, self._decided = None, 0, None, None
        if session.pace is not None:
            with suppress(StoreError):
                await session.set_pace(
                    Pace(mode="paused", moves_per_second=session.pace.moves_per_second)
                )
        name = session.row.driver_name
        session.fail(
            f"{error}, so the policy {name!r} is paused on this board; change its pace to let it try again"
        )

    def _delay(self) -> float | None:
        """Return seconds until the next move, 0 or less for now, None for not before something changes."""
        episode, pace = self._session.episode, self._session.pace
        if episode.ended or self._session.fault or pace is None:
            return None
        if self._single_moves:
            return 0.0
        if pace.mode == "paused":
            return None
        if pace.mode == "follow" and self._player is not None:
            if episode.steps < self._player.episode.steps:
                return 0.0
            if not self._player.episode.ended:
                return None
        return self._due - asyncio.get_running_loop().time()

    async def _sleep(self, delay: float | None) -> None:
        try:
            async with asyncio.timeout(delay):
                await self._woken.wait()
        except TimeoutError:
            return
        self._woken.clear()

    def _is_undecided(self) -> bool:
        """Return whether the newest frame asks for a decision that has not been made."""
        session = self._session
        if session.episode.ended or session.fault:
            return False
        return self._decided is None or self._decided[:2] != (
            session.current.id,
            session.episode.steps,
        )

    async def _decide(self) -> None:
        """Decide on the newest frame and publish the policy's thought about it; drop both if the episode has changed."""
        session, row = self._session, self._session.current
        policy = await self._prepared_policy(row)
        if policy is None or session.current.id != row.id:
            return
        step = session.episode.steps
        action = await self._decisions.act(policy, session.episode.codes.copy(), self._owner)
        if session.current.id != row.id:
            return
        self._decided = (row.id, step, action)
        shares, value = policy.thought() if isinstance(policy, ReportsThought) else (None, nan)
        probabilities = None if shares is None else shares.tolist()
        if thought := encode_thought(row.id, step, probabilities, value, goal_of(policy)):
            session.publish_thought(thought)

    async def _move(self) -> None:
        """Make the move that was decided on."""
        assert self._decided is not None
        episode, step, action = self._decided
        await self._session.act(
            Move(episode, step, action, f"policy:{self._session.row.driver_name}")
        )
        self._single_moves = max(0, self._single_moves - 1)
        self._schedule()

    def _schedule(self) -> None:
        """Set when the next timed move is due; a late move does not make the following ones faster."""
        pace, now = self._session.pace, asyncio.get_running_loop().time()
        rate = (
            pace.moves_per_second
            if pace is not None and pace.mode == "timed"
            else DEFAULT_MOVES_PER_SECOND
        )
        self._due = max(now, self._due + 1 / rate) if now - self._due < 1 / rate else now + 1 / rate

    async def _prepared_policy(self, row: EpisodeRow) -> Policy | None:
        """Return the policy with the memory of the episode so far; None when the episode changed meanwhile."""
        if self._policy is None:
            self._policy = await asyncio.to_thread(self._load)
        if self._prepared_for is None or self._prepared_for.id != row.id:
            actions = (
                bytes(self._session.episode.actions) if self._session.current.id == row.id else None
            )
            if actions is None:
                return None
            await asyncio.to_thread(replay_decisions, self._policy, row, actions)
            self._prepared_for = row
        return self._policy


def replay_decisions(policy: Policy, row: EpisodeRow, actions: bytes) -> None:
    """Reset the policy and show it every observation that it has decided on so far, so that it remembers the episode."""
    policy.reset(row.policy_seed)
    if not actions:
        return
    episode = restore_episode(row)
    for action in actions:
        policy.act(episode.codes.copy())
        episode.step(action)
