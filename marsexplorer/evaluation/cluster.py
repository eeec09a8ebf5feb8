"""Episodes on a Ray cluster, and a connection to the cluster for other work.

Every machine of the cluster needs this package. Policy files need not be there: they are sent with the work.
"""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from marsexplorer.config import CORE_VERSION
from marsexplorer.evaluation.episodes import EpisodeChunk, Result, play_chunk

LOCAL = "local"
"""The address of a cluster of this machine alone, which is started for the work and stopped after it."""

CONNECT_TIMEOUT_S = 10.0
"""Seconds to wait for a cluster's machine to accept a connection."""


class ClusterError(RuntimeError):
    """Ray is missing, the cluster cannot be reached, or its machines have another version of the rules."""


@contextmanager
def session(address: str, workers: int | None = None) -> Iterator[Any]:
    """Connect to the cluster at an address and yield the module `ray`; a connection that exists already is used and kept.

    address  LOCAL, "auto" (the one running on this machine), HOST:PORT or ray://HOST:PORT
    workers  processes of a LOCAL one; None takes one per core
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is sent to anyone
    try:
        ray: Any = import_module("ray")
    except ImportError as error:
        raise ClusterError(
            "ray is not installed; install it with: pip install 'marsexplorer-playground[ray]'"
        ) from error
    is_ours = not ray.is_initialized()
    if is_ours:
        _check_reachable(address)
        local = {"num_cpus": workers, "include_dashboard": False} if address == LOCAL else {}
        try:
            ray.init(address=address, log_to_driver=False, logging_level=logging.CRITICAL, **local)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise _no_cluster(address) from error
    try:
        yield ray
    finally:
        if is_ours:
            ray.shutdown()


def _no_cluster(address: str) -> ClusterError:
    return ClusterError(
        f"no Ray cluster answers at {address}; start one with `ray start --head`, or say {LOCAL}"
    )


def _check_reachable(address: str) -> None:
    """Raise ClusterError when nothing listens at HOST:PORT or ray://HOST:PORT: Ray itself would try for ten minutes."""
    if address in (LOCAL, "auto"):
        return
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon or not port.isdigit():
        raise ClusterError(
            f"expected a Ray address like HOST:PORT, ray://HOST:PORT, auto or {LOCAL}, got {address!r}"
        )
    try:
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_TIMEOUT_S).close()
    except (OSError, OverflowError) as error:
        raise _no_cluster(address) from error


def play_chunks_on_ray(chunks: Sequence[EpisodeChunk], address: str) -> Iterator[list[Result]]:
    """Yield the results chunk by chunk, in any order, as `episodes.play_chunks` does."""
    with session(address) as ray:
        task = ray.remote(_play_remotely)
        files = {
            chunk.policy: Path(chunk.policy) for chunk in chunks if Path(chunk.policy).is_file()
        }
        stored = {name: ray.put(path.read_bytes()) for name, path in files.items()}
        pending = [task.remote(chunk, stored.get(chunk.policy)) for chunk in chunks]
        while pending:
            ready, pending = ray.wait(pending)
            version, results = ray.get(ready[0])
            if version != CORE_VERSION:
                raise ClusterError(
                    f"a machine of the cluster has core version {version}, this one has {CORE_VERSION}"
                )
            yield results


def _play_remotely(chunk: EpisodeChunk, file: bytes | None) -> tuple[str, list[Result]]:
    """Play a chunk and return (core version, results); the content of its policy's file is written to a file first."""
    if file is None:
        return CORE_VERSION, play_chunk(chunk)
    with TemporaryDirectory() as folder:
        path = Path(folder) / Path(chunk.policy).name
        path.write_bytes(file)
        results = play_chunk(replace(chunk, policy=str(path)))
    return CORE_VERSION, [replace(result, policy=chunk.policy) for result in results]
