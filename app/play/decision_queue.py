"""Decisions of many policies on one thread, off the event loop; boards that share a network are decided together."""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marsexplorer.policies import Policy
from marsexplorer.policies.network.batch import act_many, shared_net

MAX_BATCH = 64
"""Boards decided in one call at most: some 10 ms."""


@dataclass(frozen=True)
class _Request:
    policy: Policy
    observation: NDArray[np.uint8]
    answer: asyncio.Future[int]


class DecisionQueue:
    """Decides for every agent on one thread: more threads would only take the interpreter from the event loop more often.

    Boards that ask while it is busy, or in the same turn of the event loop, and share a network are decided in one call of
    it. Whoever asked first is served first.
    """

    def __init__(self, thread: Executor) -> None:
        self._thread = thread
        self._waiting: list[_Request] = []
        self._serving: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        """Return how many boards wait for a decision that nobody is working on."""
        return len(self._waiting)

    async def act(self, policy: Policy, observation: NDArray[np.uint8]) -> int:
        """Return the policy's action for observation uint8[rows, cols], or raise what the policy raised.

        A board whose asker was cancelled may still be decided; its answer is dropped.
        """
        answer: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self._waiting.append(_Request(policy, observation, answer))
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

    def _next_batch(self) -> list[_Request]:
        """Take the first request of the queue and every one that can be decided together with it."""
        first = shared_net(self._waiting[0].policy)
        chosen: list[_Request] = [self._waiting[0]]
        left: list[_Request] = []
        for request in self._waiting[1:]:
            is_same = first is not None and len(chosen) < MAX_BATCH and shared_net(request.policy) is first
            (chosen if is_same else left).append(request)
        self._waiting = left
        return chosen

    async def _answer(self, batch: list[_Request]) -> None:
        policies, observations = [request.policy for request in batch], [request.observation for request in batch]
        loop = asyncio.get_running_loop()
        try:
            answers = await loop.run_in_executor(self._thread, act_many, policies, observations)
        except Exception as error:
            answers = [error] * len(batch)
        for request, answer in zip(batch, answers, strict=True):
            if request.answer.done():
                continue
            if isinstance(answer, Exception):
                request.answer.set_exception(answer)
            else:
                request.answer.set_result(answer)
