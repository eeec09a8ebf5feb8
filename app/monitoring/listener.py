"""The listener from which Prometheus fetches the metrics: a port of its own, which is private unless it is opened."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from prometheus_client import start_http_server

from app.monitoring.metrics import Metrics


@contextmanager
def metrics_served(metrics: Metrics, host: str, port: int) -> Iterator[str]:
    """Serve the metrics for as long as the block runs and yield their address; OSError when the port is taken.

    port  0 takes a free one
    """
    server, thread = start_http_server(port, host, metrics.registry)
    try:
        yield f"http://{f'[{host}]' if ':' in host else host}:{server.server_port}/metrics"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
