"""How late the event loop comes back: while it is late, everybody waits."""

from __future__ import annotations

import asyncio

from app.monitoring.metrics import Metrics

PERIOD_S = 0.25


async def measure_lag(metrics: Metrics) -> None:
    """Sleep PERIOD_S again and again until cancelled, and observe by how many seconds each sleep took longer."""
    loop = asyncio.get_running_loop()
    while True:
        due = loop.time() + PERIOD_S
        await asyncio.sleep(PERIOD_S)
        metrics.event_loop_lag.observe(max(0.0, loop.time() - due))
