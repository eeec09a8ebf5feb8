"""Who is decided for first, and what becomes of a decision that takes too long."""

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest

from humanplay.board import agent
from humanplay.board.agent import THREADS, DecisionQueue, SlowDecisionError
from humanplay.tasks.mars.policies import PolicyCatalogue
from humanplay.web.settings import Limits
from marsexplorer.policies.network import batch
from tests.support.servers import eventually

BOARD = np.zeros((3, 4), np.uint8)


class RecordingPolicy:
    """A policy that notes when it decides, and waits until it may."""

    name = "recorded"

    def __init__(self, name, order, until=None):
        self.who, self.order, self.until = name, order, until

    def reset(self, seed):
        pass

    def act(self, observation):
        self.order.append(self.who)
        if self.until:
            self.until.wait(60)
        return 1


def decide(ask, **settings):
    """Run `ask(decisions)` with a queue of its own."""

    async def run():
        return await ask(DecisionQueue(threads, batch, **settings))

    with ThreadPoolExecutor(THREADS) as threads:
        return asyncio.run(run())


@pytest.mark.parametrize("owners", [["crowd"] * 30, [f"owner {number}" for number in range(30)]])
def test_a_board_waits_for_one_long_decision_and_not_for_thirty(owners, monkeypatch):
    """The clock counts the crowd's decisions alone, so a busy machine changes nothing."""
    order, spent_s, lasts = [], [], Random(3)
    monkeypatch.setattr(agent, "time", SimpleNamespace(monotonic=lambda: sum(spent_s)))

    class LongPolicy(RecordingPolicy):
        def act(self, observation):
            spent_s.append(lasts.uniform(0.01, 0.02))
            return super().act(observation)

    async def ask(decisions):
        async def keep_asking(owner):
            while True:
                await decisions.act(LongPolicy("crowd", order), BOARD, owner)

        crowd = [asyncio.create_task(keep_asking(owner)) for owner in owners]
        while len(order) < 30:  # each has had a decision, and asks for the next
            await asyncio.sleep(0)
        waits = []
        for _ in range(3):
            before = len(order)
            await decisions.act(RecordingPolicy("alone", order), BOARD, "alone")
            waits.append(order[before:].index("alone"))
        for task in crowd:
            task.cancel()
        return waits

    assert max(decide(ask)) <= 2


def test_a_decision_that_takes_too_long_is_given_up_and_the_next_is_made_meanwhile():
    order, release = [], threading.Event()

    async def ask(decisions):
        stuck = [
            asyncio.create_task(
                decisions.act(RecordingPolicy("stuck", order, until=release), BOARD, "one")
            )
            for _ in range(2)
        ]
        await asyncio.sleep(0.01)
        quick = asyncio.create_task(decisions.act(RecordingPolicy("quick", order), BOARD, "two"))
        results = await asyncio.gather(*stuck, quick, return_exceptions=True)
        release.set()
        return results

    *stuck, quick = decide(ask, decision_s=0.1)
    assert [str(error) for error in stuck] == ["a decision took longer than 0.1 s"] * 2
    assert all(isinstance(error, SlowDecisionError) for error in stuck)
    assert quick == 1


class CatalogueWithSlow(PolicyCatalogue):
    """A catalogue whose `random` is slow once."""

    def __init__(self):
        super().__init__()
        self.release, self.loaded = threading.Event(), 0

    def load(self, name):
        self.loaded += 1
        return RecordingPolicy("slow", [], until=self.release if self.loaded == 1 else None)


def test_a_board_whose_policy_takes_too_long_says_so_pauses_and_can_go_on(serve):
    catalogue = CatalogueWithSlow()
    server = serve(policies=catalogue, limits=Limits(decision_s=0.2))
    client = server.client()
    begun = client.post("/api/sessions", json={"player": "random", "seed": 5}).json()
    url = f"/api/sessions/{begun['session']}"
    with server.socket(begun["session"], client) as watcher:
        assert (
            "a decision took longer than 0.2 s, so the policy 'random' is paused"
            in watcher.receive("error")["detail"]
        )
    with server.socket(begun["session"], client) as watcher:
        assert watcher.receive("pace")["mode"] == "paused"
    assert client.get(url).json()["step"] == 0
    catalogue.release.set()
    client.post(f"{url}/pace", json={"moves_per_second": 30})
    eventually(lambda: client.get(url).json()["step"] > 0)
