"""The same work on a Ray cluster: episodes played there, and a session with the cluster for whoever else needs one.

Every machine of the cluster needs this package; policy files need not be there, they travel with the work.
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
from marsexplorer.evaluation.play import Chunk, Result, play

LOCAL = "local"
"""The address that stands for a cluster of this machine alone, started for the occasion."""


PATIENCE_S = 10.0
"""Seconds to wait for a cluster's machine to answer."""


class ClusterError(RuntimeError):
    """Ray is missing, the cluster cannot be reached, or its machines have another version of the rules."""


@contextmanager
def session(address: str, workers: int | None = None) -> Iterator[Any]:
    """Yield the module `ray`, connected to the cluster at an address; a connection that was there before is used and left.

    address  LOCAL, "auto" (the one running on this machine), HOST:PORT or ray://HOST:PORT
    workers  processes of a LOCAL one; None takes one per core
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is sent to anyone
    try:
        ray: Any = import_module("ray")
    except ImportError as error:
        raise ClusterError("ray is not installed; install it with: pip install 'marsexplorer-playground[ray]'") from error
    mine = not ray.is_initialized()
    if mine:
        _check_reachable(address)
        local = {"num_cpus": workers, "include_dashboard": False} if address == LOCAL else {}
        try:
            ray.init(address=address, log_to_driver=False, logging_level=logging.CRITICAL, **local)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise _no_cluster(address) from error
    try:
        yield ray
    finally:
        if mine:
            ray.shutdown()


def _no_cluster(address: str) -> ClusterError:
    return ClusterError(f"no Ray cluster answers at {address}; start one with `ray start --head`, or say {LOCAL}")


def _check_reachable(address: str) -> None:
    """Return when something listens at HOST:PORT or ray://HOST:PORT: Ray itself would go on trying for ten minutes."""
    if address in (LOCAL, "auto"):
        return
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon or not port.isdigit():
        raise ClusterError(f"expected a Ray address like HOST:PORT, ray://HOST:PORT, auto or {LOCAL}, got {address!r}")
    try:
        socket.create_connection((host.strip("[]"), int(port)), PATIENCE_S).close()
    except (OSError, OverflowError) as error:
        raise _no_cluster(address) from error


def played_on_ray(chunks: Sequence[Chunk], address: str) -> Iterator[list[Result]]:
    """Yield the results chunk by chunk, in any order, as `play.played` does."""
    with session(address) as ray:
        task = ray.remote(_play_there)
        files = {chunk.policy: Path(chunk.policy) for chunk in chunks if Path(chunk.policy).is_file()}
        held = {name: ray.put(path.read_bytes()) for name, path in files.items()}
        waiting = [task.remote(chunk, held.get(chunk.policy)) for chunk in chunks]
        while waiting:
            ready, waiting = ray.wait(waiting)
            version, results = ray.get(ready[0])
            if version != CORE_VERSION:
                raise ClusterError(f"a machine of the cluster has core version {version}, this one has {CORE_VERSION}")
            yield results


def _play_there(chunk: Chunk, file: bytes | None) -> tuple[str, list[Result]]:
    """Return (core version, results) of a chunk; the policy's file is laid under its own name first when it came along."""
    if file is None:
        return CORE_VERSION, play(chunk)
    with TemporaryDirectory() as folder:
        path = Path(folder) / Path(chunk.policy).name
        path.write_bytes(file)
        results = play(replace(chunk, policy=str(path)))
    return CORE_VERSION, [replace(result, policy=chunk.policy) for result in results]
