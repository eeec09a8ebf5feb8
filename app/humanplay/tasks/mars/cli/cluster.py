"""A Ray cluster as an executor of `concurrent.futures`."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Callable
from concurrent.futures import Executor, Future
from importlib import import_module
from importlib.metadata import version
from typing import ParamSpec, TypeVar

from humanplay.jobs import JobError

LOCAL = "local"
"""The address of a cluster of this machine alone, which is started for the calls and stopped after them."""
CONNECT_TIMEOUT_S = 10.0
"""Seconds to wait for a cluster's machine to accept a connection."""

P = ParamSpec("P")
T = TypeVar("T")


class ClusterError(RuntimeError):
    """Ray is missing, the cluster is unreachable, or a machine has another version."""


class Cluster(Executor):
    """A connection to a Ray cluster; the process's own connection, if it has one.

    Args:
        address: LOCAL, "auto" (the one running on this machine), HOST:PORT or ray://HOST:PORT. Every machine
            of it needs this package.

    Raises:
        ClusterError: there is no Ray, or no cluster answers.
    """

    def __init__(self, address: str) -> None:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is sent to anyone
        try:
            self._ray = import_module("ray")
        except ImportError as error:
            raise ClusterError(
                "ray is not installed; install it with: pip install 'humanplay[ray]'"
            ) from error
        self._is_ours = not self._ray.is_initialized()
        if self._is_ours:
            _check_reachable(address)
            local = {"include_dashboard": False} if address == LOCAL else {}
            quiet = {"log_to_driver": False, "logging_level": logging.CRITICAL}
            try:
                self._ray.init(address=address, **quiet, **local)
            except (ConnectionError, ValueError, RuntimeError) as error:
                raise _no_cluster(address) from error
        self._call = self._ray.remote(_call_there)
        self._sent: dict[int, tuple[bytes, object]] = {}

    def submit(
        self, function: Callable[P, T], /, *arguments: P.args, **named: P.kwargs
    ) -> Future[T]:
        """Call the function on the cluster.

        Bytes among the arguments, such as policy files, are sent there once.

        The future raises what the function raises, and JobError when its process ended early.
        """
        references = (
            self._send(argument) if isinstance(argument, bytes) else argument
            for argument in arguments
        )
        reference = self._call.remote(version("humanplay"), function, *references, **named)
        future: Future[T] = Future()
        future.set_running_or_notify_cancel()  # it cannot be cancelled any more
        reference.future().add_done_callback(lambda done: self._settle(future, done))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the connection if it is ours, and with it what still runs."""
        del wait, cancel_futures
        if self._is_ours:
            self._ray.shutdown()

    def _send(self, content: bytes) -> object:
        if id(content) not in self._sent:
            self._sent[id(content)] = content, self._ray.put(content)
        return self._sent[id(content)][1]

    def _settle(self, future: Future[T], done: Future[T]) -> None:
        """Hand on what a call returned or raised, without Ray's wrapping."""
        error = done.exception()
        if error is None:
            future.set_result(done.result())
        elif isinstance(error, self._ray.exceptions.RayTaskError):
            cause = error.cause
            future.set_exception(cause if isinstance(cause, Exception) else error)
        else:
            line = str(error).strip().splitlines()[-1]
            future.set_exception(JobError(f"its process ended early: {line}"))


def _call_there(release: str, function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
    """Call a function on a machine of the cluster; ClusterError on another release."""
    if release != version("humanplay"):
        raise ClusterError(
            f"a machine of the cluster has humanplay {version('humanplay')}, this one has {release}"
        )
    return function(*arguments, **named)


def _no_cluster(address: str) -> ClusterError:
    way_out = f"start one with `ray start --head`, or say {LOCAL}"
    return ClusterError(f"no Ray cluster answers at {address}; {way_out}")


def _check_reachable(address: str) -> None:
    """Raise ClusterError if nothing listens: Ray itself would try for ten minutes."""
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
