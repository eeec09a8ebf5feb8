"""Decisions of many policies on one thread, off the event loop; boards that share a network are decided together."""

from __future__ import annotations

import asyncio
import time
from collections import defaultdict
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.policies import Policy
from marsexplorer.policies.network.batch import act_many, shared_net

MAX_BATCH = 64
"""Boards decided in one call at most: some 10 ms."""

DECISION_S = 10.0
"""Seconds that a decision may take unless a server's settings say otherwise."""

THREADS = 4
"""One thread that decides, and those that may be left with a decision that takes too long: nothing can end it."""


class SlowDecisionError(Exception):
    """A decision took longer than it may; the policy that makes it must not be asked again."""


@dataclass(frozen=True)
class _Request:
    policy: Policy
    observation: NDArray[np.uint8]
    owner: str
    answer: asyncio.Future[int]


class DecisionQueue:
    """Decides for every agent on one thread: more threads would only take the interpreter from the event loop more often.

    Boards that ask while it is busy, or in the same turn of the event loop, and share a network are decided in one call of
    it. Otherwise the owner whose boards have had the least time is served first, and of each owner's boards the one that asked
    first: thirty large boards of one player or of many keep a small one waiting for one of their decisions, not for thirty.
    A decision that takes longer than `decision_s` seconds is given up, and the next is made beside it.

    threads  at least THREADS workers, so that one is free while others are left with decisions that took too long
    """

    def __init__(self, threads: Executor, decision_s: float = DECISION_S) -> None:
        self._threads, self._decision_s = threads, decision_s
        self._waiting: list[_Request] = []
        self._used_s: defaultdict[str, float] = defaultdict(float)
        self._left: set[asyncio.Future[list[int | Exception]]] = set()
        self._serving: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        """Return how many boards wait for a decision that nobody is working on."""
        return len(self._waiting)

    async def act(self, policy: Policy, observation: NDArray[np.uint8], owner: str = "") -> int:
        """Return the policy's action for observation uint8[rows, cols], or raise what the policy raised.

        SlowDecisionError when it took too long. A board whose asker was cancelled may still be decided; its answer is dropped.
        """
        answer: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        if owner not in self._used_s:  # whoever is new begins beside those who have had the least
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
            least = min(
                self._used_s.values(), default=0.0
            )  # who has had no more than the others is as new
            self._used_s = defaultdict(
                float, {owner: s for owner, s in self._used_s.items() if s > least}
            )

    def _next_batch(self) -> list[_Request]:
        """Take the request of the owner who has had the least time, and every one that can be decided together with it."""
        next_one = min(self._waiting, key=lambda request: self._used_s[request.owner])
        first = shared_net(next_one.policy)
        chosen: list[_Request] = [next_one]
        left: list[_Request] = []
        for request in self._waiting:
            if request is next_one:
                continue
            is_same = (
                first is not None
                and len(chosen) < MAX_BATCH
                and shared_net(request.policy) is first
            )
            (chosen if is_same else left).append(request)
        self._waiting = left
        return chosen

    async def _answer(self, batch: list[_Request]) -> None:
        policies, observations = (
            [request.policy for request in batch],
            [request.observation for request in batch],
        )
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
        self, policies: list[Policy], observations: list[NDArray[np.uint8]]
    ) -> list[int | Exception]:
        """Return the actions; SlowDecisionError after `decision_s`, while the thread goes on until its decision is made."""
        deciding = asyncio.get_running_loop().run_in_executor(
            self._threads, act_many, policies, observations
        )
        done, _ = await asyncio.wait([deciding], timeout=self._decision_s)
        if done:
            return list(deciding.result())
        self._left.add(deciding)
        deciding.add_done_callback(self._note_end)
        if len(self._left) >= THREADS:
            await asyncio.wait(self._left, return_when=asyncio.FIRST_COMPLETED)
        raise SlowDecisionError(f"a decision took longer than {self._decision_s:g} s")

    def _note_end(self, deciding: asyncio.Future[list[int | Exception]]) -> None:
        self._left.discard(deciding)
        if not deciding.cancelled():
            deciding.exception()
