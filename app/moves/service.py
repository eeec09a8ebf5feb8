"""The regrets that a server gives: worked out one after the other by a process of low priority, so no move waits for one."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
from asyncio.subprocess import PIPE, Process
from pathlib import Path
from typing import Any

from app.moves.regret import regret_cache
from app.moves.worker import record_to_json
from marsexplorer.episode import Record
from marsexplorer.evaluation.regret import check_size

MAX_WAITING = 8
"""Requests that wait for their turn; another one is refused."""
MAX_LINE_BYTES = 1 << 20


class RegretBusyError(RuntimeError):
    """More regrets have been asked for than can be worked out soon."""


class Regrets:
    """Regrets of finished episodes, kept next to the database. Whoever asks has checked that the asker may see the episode."""

    def __init__(self, database: Path) -> None:
        self._folder = regret_cache(database)
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._process: Process | None = None
        self._closed = False

    async def of(self, record: Record) -> dict[str, Any]:
        """Return what `worker.explain` says of an episode.

        ValueError for a board that is too large or an episode that cannot be replayed, RegretBusyError when too many wait.
        """
        check_size(record.config)
        if self._waiting >= MAX_WAITING:
            raise RegretBusyError(
                "many players are asking where they lost moves; ask again in a minute"
            )
        self._waiting += 1
        try:
            async with self._turn:
                answer = await self._ask(record)
        finally:
            self._waiting -= 1
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer

    async def close(self) -> None:
        """End the process."""
        self._closed = True
        if self._process is not None:
            await _end(self._process)

    async def _ask(self, record: Record) -> dict[str, Any]:
        process = await self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(record_to_json(record).encode() + b"\n")
            await process.stdin.drain()
            line = await process.stdout.readline()
        except ConnectionError:
            line = b""
        except asyncio.CancelledError:
            await _end(process)  # its answer would be taken for the next request's
            raise
        answer: dict[str, Any] = (
            json.loads(line) if line else {"error": "working out the regret ended early; ask again"}
        )
        return answer

    async def _started(self) -> Process:
        """Return the process, started when there is none that runs."""
        if self._closed:
            raise RegretBusyError("the server is closing")
        if self._process is None or self._process.returncode is not None:
            # a session of its own: Ctrl-C in the server's terminal is not meant for it
            self._process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "app.moves.worker", str(self._folder), stdin=PIPE, stdout=PIPE, limit=MAX_LINE_BYTES,
                env={**os.environ, "OMP_NUM_THREADS": "1"}, start_new_session=True,
            )  # fmt: skip
        return self._process


async def _end(process: Process) -> None:
    """End a process, wait for it and close its pipes."""
    assert process.stdin is not None
    assert process.stdout is not None
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    process.stdin.close()
    await process.stdout.read()
    await process.wait()
