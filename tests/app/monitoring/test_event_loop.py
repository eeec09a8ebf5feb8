"""Garbage is collected when nobody waits for the event loop."""

import asyncio
import gc
import time
import weakref

import pytest

from app.monitoring import event_loop
from app.monitoring.event_loop import YOUNG_OBJECTS, collect_in_quiet_moments, rare_collections


class Cycle:
    def __init__(self):
        self.myself = self


@pytest.fixture
def often(monkeypatch):
    """Look ten times a second; a moment is quiet with little work, since a busy machine lets a busy thread do less."""
    monkeypatch.setattr(event_loop, "LOOK_S", 0.1)
    monkeypatch.setattr(event_loop, "QUIET_S", 0.002)
    monkeypatch.setattr(event_loop, "SOONEST_S", 0.3)


async def lives_for(seconds, work_s):
    """Return for how many seconds garbage outlives its last use, at most `seconds`, while the loop works and rests in turn."""
    cycle = Cycle()
    garbage, began = weakref.ref(cycle), time.monotonic()
    del cycle
    collecting = asyncio.create_task(collect_in_quiet_moments())
    while garbage() is not None and time.monotonic() - began < seconds:
        until = time.thread_time() + work_s
        while time.thread_time() < until:
            pass
        await asyncio.sleep(0 if work_s else 0.05)
    collecting.cancel()
    return time.monotonic() - began


def test_garbage_is_collected_in_a_quiet_moment(often):
    old = [Cycle()]
    gc.collect()  # old enough that Python itself would look at it last
    gone = weakref.ref(old.pop())

    async def wait():
        assert await lives_for(10, 0.0) < 10
        assert gone() is None

    gc.disable()
    try:
        asyncio.run(wait())
    finally:
        gc.enable()


def test_garbage_waits_while_the_event_loop_has_work_but_not_for_ever(often, monkeypatch):
    gc.disable()
    try:
        assert asyncio.run(lives_for(2, 0.004)) >= 2
        monkeypatch.setattr(event_loop, "LATEST_S", 0.7)
        assert 0.7 <= asyncio.run(lives_for(10, 0.004)) < 10
    finally:
        gc.enable()


def test_python_looks_at_all_objects_never_by_itself_while_a_server_runs(server):
    def full_collections():
        return gc.get_stats()[2]["collections"]

    with server.client() as client:
        assert client.get("/healthz").status_code == 200
    before, kept = full_collections(), [[number] for number in range(8 * YOUNG_OBJECTS)]
    for _ in range(100):
        gc.collect(1)  # as with ten million objects more
    kept += [
        [number] for number in range(2 * YOUNG_OBJECTS)
    ]  # it looks at something again, and might at all
    assert full_collections() == before


def test_thresholds_are_what_they_were_after_a_server():
    before = gc.get_threshold()
    with rare_collections():
        assert gc.get_threshold() != before
    assert gc.get_threshold() == before
