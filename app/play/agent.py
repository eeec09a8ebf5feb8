"""A policy at the controls of a session: it waits for its turn, decides off the event loop, and moves like anyone else."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from app.play.messages import encode_thought
from app.play.session import Move, Session, revive
from app.storage.store import EpisodeRow
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import Policy
from marsexplorer.policies.files.imported import wrong_size
from marsexplorer.policies.network.batch import act_many, shared_net

ALONE_PER_SECOND = 8.0
"""Moves a second of a rival whose player has ended."""

TOGETHER = 64
"""Boards decided in one call at most: some 10 ms."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Offer:
    """A policy that may be chosen: the name, one line about it, what `policies.load` takes, and the only board it plays.

    size  (rows, cols); None for any
    """

    name: str
    summary: str
    source: str
    size: tuple[int, int] | None


class Policies:
    """The policies on offer, by name: those that load by name, and further ones from paths.

    Loading each once at the start finds a file that is no policy before anybody chooses it, and compiles its kernels.
    """

    def __init__(self, paths: Iterable[Path] = ()) -> None:
        self._offers: dict[str, Offer] = {}
        for source in (*policies.names(), *map(str, paths)):
            policy = policies.load(source)
            policy.reset(0)
            size: tuple[int, int] | None = getattr(policy, "size", None)
            policy.act(Episode.begin(EnvConfig.of("random", size or 5), seed=0).codes.copy())
            self._offers[policy.name] = Offer(policy.name, policies.describe(source), source, size)

    def offers(self) -> list[Offer]:
        """Return what may be chosen."""
        return list(self._offers.values())

    def check(self, name: str, *others: str) -> str:
        """Return the name when it is on offer; ValueError naming the choices (and `others`) otherwise."""
        if name not in self._offers:
            raise ValueError(f"no policy {name!r}; choose one of: {', '.join((*others, *self._offers))}")
        return name

    def check_size(self, names: Iterable[str], config: EnvConfig) -> None:
        """Return when every policy among the names plays boards of this size; ValueError naming one that does not."""
        for name in names:
            size = self._offers[name].size if name in self._offers else None
            if size not in (None, (config.rows, config.cols)):
                raise ValueError(wrong_size(name, size, (config.rows, config.cols)))

    def load(self, name: str) -> Policy:
        """Return a policy of one's own: policies remember their episode."""
        return policies.load(self._offers[self.check(name)].source)


@runtime_checkable
class Thinking(Protocol):
    """A policy that says what it thinks of the last observation."""

    def thought(self) -> tuple[NDArray[np.float32], float]:
        """Return (probabilities float32[4], value)."""


@dataclass(frozen=True)
class _Asked:
    policy: Policy
    observation: NDArray[np.uint8]
    answer: asyncio.Future[int]


class Decisions:
    """Decides for every agent on one thread: more of them would only take the interpreter from the event loop more often.

    Boards that ask while it is busy, or in the same turn of the event loop, and share a network are decided in one call of
    it. Whoever asked first is served first.
    """

    def __init__(self, thread: Executor) -> None:
        self._thread = thread
        self._waiting: list[_Asked] = []
        self._serving: asyncio.Task[None] | None = None

    async def act(self, policy: Policy, observation: NDArray[np.uint8]) -> int:
        """Return the policy's action, or raise what it raised; a board whose asker has gone may still be decided."""
        answer: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self._waiting.append(_Asked(policy, observation, answer))
        if self._serving is None:
            self._serving = asyncio.create_task(self._serve(), name="decisions")
        return await answer

    async def _serve(self) -> None:
        try:
            while self._waiting:
                await asyncio.sleep(0)  # all that ask in this turn of the loop
                await self._answer(self._next())
        finally:
            self._serving = None

    def _next(self) -> list[_Asked]:
        """Take the first in the queue and everyone who can be decided together with it."""
        first = shared_net(self._waiting[0].policy)
        chosen: list[_Asked] = [self._waiting[0]]
        left: list[_Asked] = []
        for asked in self._waiting[1:]:
            is_same = first is not None and len(chosen) < TOGETHER and shared_net(asked.policy) is first
            (chosen if is_same else left).append(asked)
        self._waiting = left
        return chosen

    async def _answer(self, chosen: list[_Asked]) -> None:
        boards, grids = [asked.policy for asked in chosen], [asked.observation for asked in chosen]
        loop = asyncio.get_running_loop()
        try:
            answers = await loop.run_in_executor(self._thread, act_many, boards, grids)
        except Exception as error:
            answers = [error] * len(chosen)
        for asked, answer in zip(chosen, answers, strict=True):
            if asked.answer.done():
                continue
            if isinstance(answer, Exception):
                asked.answer.set_exception(answer)
            else:
                asked.answer.set_result(answer)


class Agent:
    """Drives `session`; beside a `player` it can follow, one move for each of the player's.

    It decides as soon as it sees a frame and tells what it thinks of it, then waits for its turn to move.
    It counts moves and not wakes, so however late it is, it ends on the player's number of steps.
    """

    def __init__(self, session: Session, player: Session | None, load: Callable[[], Policy], decisions: Decisions) -> None:
        self._session, self._player, self._load, self._decisions = session, player, load, decisions
        self._policy: Policy | None = None
        self._ready_for: EpisodeRow | None = None
        self._decided: tuple[str, int, int] | None = None
        self._woken = asyncio.Event()
        self._singles = 0
        self._due = 0.0
        watched = [session] if player is None else [session, player]
        self._leave = [board.channel.listen(self._woken.set) for board in watched]
        self._task = asyncio.create_task(self._run(), name=f"agent of {session.id}")

    def move_once(self) -> None:
        """Let one move happen whatever the pace."""
        self._singles += 1
        self._woken.set()

    def close(self) -> None:
        """Let go of the controls; a decision under way is dropped."""
        for leave in self._leave:
            leave()
        self._task.cancel()

    async def _run(self) -> None:
        while True:
            try:
                if self._is_undecided():
                    await self._think()
                    continue
                delay = self._delay()
                if delay is None or delay > 0:
                    await self._sleep(delay)
                    continue
                self._move()
            except Exception as error:
                _log.exception("the policy %s failed", self._session.row.driver_name)
                self._singles, self._ready_for, self._decided = 0, None, None
                self._session.fail(f"the policy {self._session.row.driver_name!r} failed: {error}")

    def _delay(self) -> float | None:
        """Return seconds until the next move, 0 or less for now, None for not before something changes."""
        episode, pace = self._session.episode, self._session.pace
        if episode.ended or self._session.fault or pace is None:
            return None
        if self._singles:
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
        """Whether the newest frame asks for a decision that has not been made."""
        session = self._session
        if session.episode.ended or session.fault:
            return False
        return self._decided is None or self._decided[:2] != (session.current.id, session.episode.steps)

    async def _think(self) -> None:
        """Decide on the newest frame and tell what the policy thinks of it; an episode that changed meanwhile is dropped."""
        session, row = self._session, self._session.current
        policy = await self._prepared(row)
        if policy is None or session.current.id != row.id:
            return
        step = session.episode.steps
        action = await self._decisions.act(policy, session.episode.codes.copy())
        if session.current.id != row.id:
            return
        self._decided = (row.id, step, action)
        if isinstance(policy, Thinking):
            shares, value = policy.thought()
            session.tell_thought(encode_thought(row.id, step, shares.tolist(), value))

    def _move(self) -> None:
        """Make the move that was decided on."""
        assert self._decided is not None
        episode, step, action = self._decided
        self._session.act(Move(episode, step, action, f"policy:{self._session.row.driver_name}"))
        self._singles = max(0, self._singles - 1)
        self._schedule()

    def _schedule(self) -> None:
        pace, now = self._session.pace, asyncio.get_running_loop().time()
        rate = pace.moves_per_second if pace is not None and pace.mode == "timed" else ALONE_PER_SECOND
        self._due = max(now, self._due + 1 / rate) if now - self._due < 1 / rate else now + 1 / rate

    async def _prepared(self, row: EpisodeRow) -> Policy | None:
        """Return the policy with the memory of the episode so far; None when the episode changed meanwhile."""
        if self._policy is None:
            self._policy = await asyncio.to_thread(self._load)
        if self._ready_for is None or self._ready_for.id != row.id:
            actions = bytes(self._session.episode.actions) if self._session.current.id == row.id else None
            if actions is None:
                return None
            await asyncio.to_thread(remember, self._policy, row, actions)
            self._ready_for = row
        return self._policy


def remember(policy: Policy, row: EpisodeRow, actions: bytes) -> None:
    """Return with the policy told of the episode's start and of every observation it has decided on so far."""
    policy.reset(row.policy_seed)
    if not actions:
        return
    episode = revive(row)
    for action in actions:
        policy.act(episode.codes.copy())
        episode.step(action)
