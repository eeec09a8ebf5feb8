"""Policies' figures: those that came with the package; the rest is made here by a process of low priority when first requested.

What is made here is kept in a file next to the database. A figure belongs to (core version, policy with its file,
configuration, seeds); when one of these changes, it is made again. No figure is ever guessed: until it is ready, its progress
is shown.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.leaderboard.jobs import EvaluationJob
from app.leaderboard.shipped import ShippedFigure, ShippedFigures
from marsexplorer.config import CORE_VERSION
from marsexplorer.files import write_whole

MAX_LINE_BYTES = 1 << 24
"""Bytes of a worker's line: a heat map of the largest grid fits."""

_log = logging.getLogger(__name__)


class PolicyEvaluations:
    """Gives the figures that are ready and makes the missing ones in the background, the latest request first."""

    def __init__(self, path: Path, shipped: ShippedFigures | None = None) -> None:
        self.path = path
        self._shipped = shipped
        self._done: dict[str, dict[str, Any]] = _read(path)
        self._failed: dict[str, str] = {}
        self._waiting: dict[str, EvaluationJob] = {}
        self._progress: tuple[str, int] = ("", 0)
        self._task: asyncio.Task[None] | None = None
        self._process: Process | None = None
        self._closed = False

    def request(self, jobs: Sequence[EvaluationJob]) -> list[dict[str, Any]]:
        """Return per job {"state", "done", "of", "figure", "shipped", "error"}; what is missing is begun.

        `shipped` says where a figure comes from that came with the package, None for one that was made here. Call it on the
        event loop.
        """
        keys = {job.key: job for job in jobs}
        came = {
            key: self._shipped.find(job) if self._shipped else None
            for key, job in keys.items()
            if key not in self._done
        }
        known = {**self._done, **self._failed, **{key: made for key, made in came.items() if made}}
        missing = {key: job for key, job in keys.items() if key not in known}
        if missing and not self._closed:
            self._waiting = {**missing, **self._waiting}
            if self._task is None or self._task.done():
                self._task = asyncio.create_task(self._work(), name="leaderboard")
        return [self._state(key, job, came.get(key)) for key, job in keys.items()]

    async def close(self) -> None:
        """End the process; what it had not finished is begun again after the next start."""
        self._waiting.clear()
        self._closed = True
        if self._process is not None:
            _kill(self._process)
        if self._task is not None:
            await self._task

    def _state(self, key: str, job: EvaluationJob, came: ShippedFigure | None) -> dict[str, Any]:
        made, error = came.figure if came else self._done.get(key), self._failed.get(key)
        at, done = self._progress
        state = "ready" if made else "failed" if error else "computing" if at == key else "waiting"
        count = len(job.seeds) if made else done if at == key else 0
        return {
            "state": state,
            "done": count,
            "of": len(job.seeds),
            "figure": made,
            "shipped": came and asdict(came.origin),
            "error": error,
        }

    async def _work(self) -> None:
        """Make figures until none is missing."""
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        command = (sys.executable, "-m", "app.leaderboard.worker")
        # a session of its own: Ctrl-C in the server's terminal is not meant for it
        process = self._process = await asyncio.create_subprocess_exec(
            *command,
            stdin=PIPE,
            stdout=PIPE,
            limit=MAX_LINE_BYTES,
            env=environment,
            start_new_session=True,
        )
        while self._waiting:
            key, job = next(iter(self._waiting.items()))
            await self._make(process, key, job)
            self._waiting.pop(key, None)
            await asyncio.to_thread(_write, self.path, dict(self._done))
        self._progress, self._process = ("", 0), None
        await _end(process)

    async def _make(self, process: Process, key: str, job: EvaluationJob) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self._progress = (key, 0)
        with contextlib.suppress(ConnectionError):
            process.stdin.write(job.to_json().encode() + b"\n")
            await process.stdin.drain()
        while line := await process.stdout.readline():
            message = json.loads(line)
            if "done" in message:
                self._progress = (key, message["done"])
            elif "figure" in message:
                self._done[key] = message["figure"]
                return
            else:
                self._failed[key] = message["error"]
                return
        for (
            each
        ) in self._waiting:  # none when we close; else the process has died: nothing more comes
            self._failed[each] = "the evaluation ended early; restart the server to try again"
        if self._waiting:
            _log.warning("the leaderboard's evaluation ended early (%s)", job.policy)
        self._waiting.clear()


async def _end(process: Process) -> None:
    """End the process, wait for it and close its pipes."""
    assert process.stdin is not None
    assert process.stdout is not None
    _kill(process)
    process.stdin.close()
    await process.stdout.read()
    await process.wait()


def _kill(process: Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.kill()


def _read(path: Path) -> dict[str, dict[str, Any]]:
    """Return the figures of this core version in a file; none when it is absent or not whole."""
    try:
        kept = json.loads(path.read_bytes())
        return {
            key: value
            for key, value in kept.items()
            if key.split("|")[0] == CORE_VERSION and "curve" in value
        }
    except (OSError, ValueError, AttributeError, TypeError):
        return {}


def _write(path: Path, figures: dict[str, dict[str, Any]]) -> None:
    """Write the figures to the file; when the disk is full, warn: the next start must then make them again."""
    try:
        with write_whole(path) as file:
            file.write(json.dumps(figures, separators=(",", ":")).encode())
    except OSError as error:
        _log.warning("the leaderboard's figures were not kept in %s: %s", path, error.strerror)
