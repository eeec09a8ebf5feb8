"""The metrics of one server, in a registry of their own, and their HTTP listener.

Prometheus asks the listener.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, start_http_server
from prometheus_client.process_collector import ProcessCollector

_SHORT_S = (0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 1.0, 5.0)
_LONG_S = (0.001, 0.0025, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 30.0)
"""Upper bounds of a histogram's buckets in seconds."""

PERIOD_S = 0.25
"""Seconds between two looks at how late the event loop is."""


class Metrics:
    """Counters, histograms and gauges of one server.

    Attributes:
        moves: Committed moves by who made them: "human", "script" or "policy".
        step: Seconds from a move's check to its frame's publication, the commit included.
        commit: Seconds of a transaction of the writer, from BEGIN to COMMIT.
        dropped_frames: Frames that a subscriber never got, since a newer one replaced them
            first.
        newest_s: Seconds of the newest 1,000 moves.
        event_loop_lag: Seconds by which the event loop came back too late.
    """

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        counter = partial(Counter, namespace="humanplay", registry=self.registry)
        histogram = partial(Histogram, namespace="humanplay", registry=self.registry)
        moves = counter("moves", "Moves that were committed.", ["driver"])
        self.moves = {name: moves.labels(name) for name in ("human", "script", "policy")}
        about = "A move, from its check to its frame."
        self.step = histogram("step_seconds", about, buckets=_SHORT_S)
        about = "A transaction of the writer."
        self.commit = histogram("commit_seconds", about, buckets=_SHORT_S)
        about = "Frames that a newer one replaced before a subscriber got them."
        self.dropped_frames = counter("dropped_frames", about)
        self._requests = counter("http_requests", "Requests that were answered.", ["status"])
        about = "Requests, sockets and moves that were refused."
        self._refusals = counter("refusals", about, ["reason"])
        about = "How late the event loop came back."
        self.event_loop_lag = histogram("event_loop_lag_seconds", about, buckets=_LONG_S)

        self.newest_s = deque[float](maxlen=1000)
        about = "99 of 100 of the last 1,000 moves took no longer; 0: there was none."
        self.add_gauge("move_p99_seconds", about, self._move_p99_s)

    def _move_p99_s(self) -> float:
        newest_s = sorted(self.newest_s.copy())
        return newest_s[99 * len(newest_s) // 100] if newest_s else 0.0

    def values(self, *names: str) -> dict[str, float]:
        """What some gauges hold now, by their names without `humanplay_`."""
        read = self.registry.get_sample_value
        return {name: read(f"humanplay_{name}") or 0.0 for name in names}

    def count_refusal(self, reason: str) -> None:
        """Count a refusal.

        Args:
            reason: A fixed short name such as `not_current`, never what somebody sent.
        """
        self._refusals.labels(reason).inc()

    def count_request(self, status: int) -> None:
        """Count an answered request.

        One that was refused or failed (400 and above) counts as a refusal too.
        """
        self._requests.labels(str(status)).inc()
        if status >= 400:
            self._refusals.labels(f"http_{status}").inc()

    def add_gauge(self, name: str, about: str, read: Callable[[], float]) -> None:
        """Add a gauge `humanplay_NAME`.

        Args:
            about: What it measures, for people.
            read: Called in a thread of the listener whenever somebody asks.
        """
        Gauge(f"humanplay_{name}", about, registry=self.registry).set_function(read)

    async def measure_lag(self) -> None:
        """Observe, until cancelled, by how many seconds each sleep took too long.

        While the event loop is late, everybody waits.
        """
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + PERIOD_S
            await asyncio.sleep(PERIOD_S)
            self.event_loop_lag.observe(max(0.0, loop.time() - due))

    @contextmanager
    def serve(self, host: str, port: int) -> Iterator[str]:
        """Serve the metrics during the block and yield their address.

        They have a port of their own, which is private unless it is opened; 0 takes a free one.

        Raises:
            OSError: If the port is taken.
        """
        server, thread = start_http_server(port, host, self.registry)
        try:
            yield f"http://{f'[{host}]' if ':' in host else host}:{server.server_port}/metrics"
        finally:
            server.shutdown()
            server.server_close()
            thread.join()
