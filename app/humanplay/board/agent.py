"""Policies that drive sessions: they decide off the event loop, move like anyone.

An `Agent` waits for its turn on one board. A `DecisionQueue` decides for all of them on one thread,
and decides boards that share a network together. What a policy is asked is the task's.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass

from humanplay.board.messages import Pace
from humanplay.board.participation import RefusedError
from humanplay.board.session import Move, Session
from humanplay.db.store import NOTICE_S, StoreError, Trial
from humanplay.task import NotReadyError, Policies, Policy, Task

MAX_BATCH = 64
"""Boards decided in one call at most: some 10 ms."""

DECISION_S = 10.0
"""Seconds that a decision may take unless a server's settings say otherwise."""

THREADS = 4
"""One thread that decides, and spares: nothing can end a decision that takes too long."""


class SlowDecisionError(Exception):
    """A decision took too long; its policy object must not be asked again."""


@dataclass(frozen=True)
class _Request:
    policy: Policy
    observation: object
    owner: str
    answer: asyncio.Future[int]


class DecisionQueue:
    """Decides for every agent on one thread.

    Boards that wait at the same time and share a network are decided in one call of it. Otherwise
    the owner whose boards have had the least time is served first, and of their boards the one that
    asked first: a small board waits for one decision of a player with thirty large boards, not for
    thirty. A decision that takes longer than `decision_s` seconds is given up, and the next one
    starts on another thread.

    Args:
        policies: Asks several policies of a task together.
        threads: At least THREADS workers, so that one is free while others are left with
            decisions that took too long.
    """

    def __init__(
        self, threads: Executor, policies: Policies, decision_s: float = DECISION_S
    ) -> None:
        self._threads, self._policies, self._decision_s = threads, policies, decision_s
        self._waiting: list[_Request] = []
        self._used_s: defaultdict[str, float] = defaultdict(float)
        self._left: set[asyncio.Future[Sequence[int | Exception]]] = set()
        self._serving: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        """How many boards wait for a decision that nobody is working on."""
        return len(self._waiting)

    async def act(self, policy: Policy, observation: object, owner: str = "") -> int:
        """Ask a policy for its action on an observation.

        If the caller is cancelled, the board may still be decided; its answer is dropped.

        Raises:
            SlowDecisionError: If the decision took too long.
            Exception: What the policy raised.
        """
        answer: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        # a new owner starts level with the one who has had the least, not ahead of everybody
        if owner not in self._used_s:
            self._used_s[owner] = min(self._used_s.values(), default=0.0)
        self._waiting.append(_Request(policy, observation, owner, answer))
        if self._serving is None:
            self._serving = asyncio.create_task(self._serve(), name="decisions")
        return await answer

    async def _serve(self) -> None:
        try:
            while self._waiting:
                await asyncio.sleep(0)  # let every board that asks in this turn of the loop join
                await self._answer(self._next_batch())
        finally:
            self._serving = None
            # forget the owners who have had the least: they would start at the same time again
            least = min(self._used_s.values(), default=0.0)
            longer = {owner: s for owner, s in self._used_s.items() if s > least}
            self._used_s = defaultdict(float, longer)

    def _next_batch(self) -> list[_Request]:
        """Take the request that is due and those that can be decided with it."""
        next_one = min(self._waiting, key=lambda request: self._used_s[request.owner])
        first = self._policies.batch_network(next_one.policy)
        chosen: list[_Request] = [next_one]
        left: list[_Request] = []
        for request in self._waiting:
            if request is next_one:
                continue
            is_same = (
                first is not None
                and len(chosen) < MAX_BATCH
                and self._policies.batch_network(request.policy) is first
            )
            (chosen if is_same else left).append(request)
        self._waiting = left
        return chosen

    async def _answer(self, batch: list[_Request]) -> None:
        policies = [request.policy for request in batch]
        observations = [request.observation for request in batch]
        began = time.monotonic()
        answers: list[int | Exception]
        try:
            answers = await self._decide(policies, observations)
        except Exception as error:
            answers = [error] * len(batch)
        share_s = (time.monotonic() - began) / len(batch)
        for request, answer in zip(batch, answers, strict=True):
            self._used_s[request.owner] += share_s
            if request.answer.done():
                continue
            if isinstance(answer, Exception):
                request.answer.set_exception(answer)
            else:
                request.answer.set_result(answer)

    async def _decide(
        self, policies: list[Policy], observations: list[object]
    ) -> list[int | Exception]:
        """Decide on the policies' thread, for at most `decision_s` seconds.

        Raises:
            SlowDecisionError: If it takes longer; the thread goes on until the decision is made.
        """
        deciding = asyncio.get_running_loop().run_in_executor(
            self._threads, self._policies.act_many, policies, observations
        )
        done, _ = await asyncio.wait([deciding], timeout=self._decision_s)
        if done:
            return list(deciding.result())
        self._left.add(deciding)
        deciding.add_done_callback(self._note_end)
        # every thread has a decision that was given up: the next one could not start
        if len(self._left) >= THREADS:
            await asyncio.wait(self._left, return_when=asyncio.FIRST_COMPLETED)
        raise SlowDecisionError(f"a decision took longer than {self._decision_s:g} s")

    def _note_end(self, deciding: asyncio.Future[Sequence[int | Exception]]) -> None:
        self._left.discard(deciding)
        if not deciding.cancelled():
            deciding.exception()


DEFAULT_MOVES_PER_SECOND = 8.0
"""A policy's pace until somebody changes it, and a rival's once its player's episode has ended."""

_log = logging.getLogger(__name__)


class Agent:
    """Drives a session by a policy.

    It decides as soon as it sees a frame, then waits for its turn to move. If there is a player to
    follow, it makes one move for each of the player's. It counts moves, not wakes, so however late
    it is, it ends on the player's number of steps.
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
        self._prepared_for: Trial | None = None
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
            except StoreError as error:
                # a full disk, say: nothing has changed, and the next write may succeed
                self._session.fail(str(error))
                await asyncio.sleep(NOTICE_S)
                self._session.fault = None
            except RefusedError:
                self._decided = None  # the next episode began while the move waited
            except SlowDecisionError as error:
                await self._give_up(error)
            except NotReadyError as error:
                await self._wait_for(error)
            except Exception as error:
                self._note_failure(error)

    def _note_failure(self, error: Exception) -> None:
        """Say that the policy failed; the next episode, or another policy, goes on."""
        _log.error("the policy %s failed", self._session.row.driver_name, exc_info=error)
        self._single_moves, self._prepared_for, self._decided = 0, None, None
        self._session.fail(f"the policy {self._session.row.driver_name!r} failed: {error}")

    async def _wait_for(self, error: NotReadyError) -> None:
        """Report that the policy is getting ready, and wait."""
        session = self._session
        # replay the episode to the policy: it may have seen only part of it
        self._prepared_for = self._decided = None
        session.fail(f"the policy {session.row.driver_name!r} is {error}")
        try:
            await error.wait()
        except Exception as failure:
            self._note_failure(failure)
        else:
            session.fault = None

    async def _give_up(self, error: SlowDecisionError) -> None:
        """Pause the board and say why.

        The thread still works on that decision, so the next one asks a fresh copy of the policy.
        """
        session = self._session
        self._policy, self._single_moves, self._prepared_for, self._decided = None, 0, None, None
        if session.pace is not None:
            with suppress(StoreError):
                speed = session.pace.moves_per_second
                await session.set_pace(Pace(mode="paused", moves_per_second=speed))
        name = session.row.driver_name
        session.fail(
            f"{error}, so the policy {name!r} is paused on this board; change its pace to let it try again"
        )

    def _delay(self) -> float | None:
        """Seconds until the next move: 0 or less if it is due.

        None if no move is due before something changes.
        """
        episode, pace = self._session.shown, self._session.pace
        if episode.ended or self._session.fault or pace is None:
            return None
        if self._single_moves:
            return 0.0
        if pace.mode == "paused":
            return None
        if pace.mode == "follow" and self._player is not None:
            if episode.steps < self._player.shown.steps:
                return 0.0
            if not self._player.shown.ended:
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
        """Whether the newest frame needs a decision that has not been made."""
        session = self._session
        if session.shown.ended or session.fault:
            return False
        shown = (session.current.id, session.shown.steps)
        return self._decided is None or self._decided[:2] != shown

    async def _decide(self) -> None:
        """Decide on the newest frame; drop the decision if the episode has changed."""
        session, row = self._session, self._session.current
        policy = await self._prepared_policy(row)
        if policy is None or session.current.id != row.id:
            return
        step = session.shown.steps
        action = await self._decisions.act(policy, session.shown.observation(), self._owner)
        if session.current.id != row.id:
            return
        self._decided = (row.id, step, action)

    async def _move(self) -> None:
        """Make the move that was decided on."""
        assert self._decided is not None
        episode, step, action = self._decided
        driver = f"policy:{self._session.row.driver_name}"
        await self._session.act(Move(episode, step, action, driver))
        self._single_moves = max(0, self._single_moves - 1)
        self._schedule()

    def _schedule(self) -> None:
        """Set when the next timed move is due; a late move does not hurry the rest."""
        pace, now = self._session.pace, asyncio.get_running_loop().time()
        is_timed = pace is not None and pace.mode == "timed"
        rate = pace.moves_per_second if pace and is_timed else DEFAULT_MOVES_PER_SECOND
        self._due = max(now, self._due + 1 / rate) if now - self._due < 1 / rate else now + 1 / rate

    async def _prepared_policy(self, row: Trial) -> Policy | None:
        """The policy, with the memory of the episode so far.

        None if the episode changed in the meantime.
        """
        if self._policy is None:
            self._policy = await asyncio.to_thread(self._load)
        if self._prepared_for is None or self._prepared_for.id != row.id:
            actions = self._session.shown.actions if self._session.current.id == row.id else None
            if actions is None:
                return None
            task = self._session.task
            await asyncio.to_thread(replay_decisions, task, self._policy, row, actions)
            self._prepared_for = row
        return self._policy


def replay_decisions(task: Task, policy: Policy, row: Trial, actions: bytes) -> None:
    """Reset the policy and show it every observation of the episode so far."""
    task.policies.reset(policy, row.config, row.policy_seed)
    if not actions:
        return
    run = task.replay(row)
    for action in actions:
        task.policies.act(policy, run.observation())
        run.step(action)
