"""How late the event loop comes back: while it is late, everybody waits.

Python's collections of garbage are what can make it late in the midst of play. One that looks at all objects takes 50 to 140 ms
with a thousand boards in memory, so it waits for a moment in which nobody plays.
"""

from __future__ import annotations

import asyncio
import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager

from app.monitoring.metrics import Metrics

PERIOD_S = 0.25

YOUNG_OBJECTS = 10_000
"""New objects after which Python collects the garbage among them. Its own 700 are the messages of one moment that many people
play in: nearly all of them are dropped without a collection, which would look at them in vain."""

NEVER = 2**30

LOOK_S = 1.0
"""Seconds between two looks for a quiet moment."""
QUIET_S = 0.01
"""Seconds that the event loop has worked since the last look, at most, for the moment to be quiet."""
SOONEST_S, LATEST_S = 10.0, 60.0
"""Seconds from one collection to the next in a quiet moment, at least, and in any moment."""


async def measure_lag(metrics: Metrics) -> None:
    """Sleep PERIOD_S again and again until cancelled, and observe by how many seconds each sleep took longer."""
    loop = asyncio.get_running_loop()
    while True:
        due = loop.time() + PERIOD_S
        await asyncio.sleep(PERIOD_S)
        metrics.event_loop_lag.observe(max(0.0, loop.time() - due))


@contextmanager
def rare_collections() -> Iterator[None]:
    """Let Python collect young garbage rarely during the block, and garbage of all ages only when it is told to.

    What is there at the beginning stays for ever and is looked at no more.
    """
    thresholds = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(YOUNG_OBJECTS, thresholds[1], NEVER)
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)


async def collect_in_quiet_moments() -> None:
    """Collect garbage of all ages again and again until cancelled: when the event loop has had little to do, or after LATEST_S.

    A closed socket leaves seven small objects, so little waits for a quiet moment.
    """
    collected_s = time.monotonic()
    while True:
        worked_s = time.thread_time()
        await asyncio.sleep(LOOK_S)
        is_quiet, since_s = time.thread_time() - worked_s <= QUIET_S, time.monotonic() - collected_s
        if since_s >= (SOONEST_S if is_quiet else LATEST_S):
            gc.collect()
            collected_s = time.monotonic()
