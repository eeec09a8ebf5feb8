"""Files that are made for somebody and sent.

Tables are for anybody, reports and releases for the operator. They lie in a folder beside the
database, which is emptied when a server starts and when it ends. A job writes a table, so no
transaction reads the database for as long as a slow reader takes, which would keep its log from
being emptied.
"""

from __future__ import annotations

import asyncio
import os
import shutil
from collections import Counter
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import (
    AbstractContextManager,
    asynccontextmanager,
    closing,
    contextmanager,
    suppress,
)
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import IO

from fastapi.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from humanplay.jobs import RETRY_S, JobError, Jobs, JobsFullError

LIMIT_S = 1800.0
"""Seconds in which a table has to be written."""
MOST_WRITTEN = 2
"""Tables that are written at a time; one owner has one of them, and the others wait for their turn."""
MOST_BYTES = 2**32
"""Bytes of the tables of one owner, at most; a table takes half of what is free on the disk, at
most."""
SEND_S = 3600.0
"""Seconds after which a table that is still being sent is deleted, and its reader disconnected."""
PIECE_BYTES = 1 << 16


class Downloads:
    """The files of one server, beside its database."""

    def __init__(self, database: Path, jobs: Jobs) -> None:
        self._folder = database.with_name(f"{database.name}-downloads")
        self._jobs = jobs
        self._writing: set[str] = set()
        self._turns = asyncio.Semaphore(MOST_WRITTEN)
        self._sent = Counter[str]()
        self.close()  # a server that was killed has left its files

    def new_folder(self) -> Path:
        """Return a new folder for files that stay until the server ends."""
        self._folder.mkdir(mode=0o700, exist_ok=True)
        return Path(mkdtemp(dir=self._folder))

    async def answer(
        self, owner: str, name: str, write: Callable[..., None], *arguments: object
    ) -> Response:
        """Have a table written as a job, and return the answer that sends it.

        The file has no name any more once it is sent, and is gone when the answer ends, however it
        does.

        Args:
            name: Of the file for its reader.
            write: Called as `write(path, most_bytes, *arguments)`.

        Raises:
            JobsFullError: While another table of the owner's waits or is being written.
            JobError: If it cannot be written.
        """
        if owner in self._writing:
            raise JobsFullError(
                f"another table of yours is being written; ask again in {RETRY_S} s"
            )
        async with self._turn(owner):
            file = await self._write(owner, name, write, *arguments)
        return _OpenFile(file, name, self._counted(owner, file))

    @asynccontextmanager
    async def _turn(self, owner: str) -> AsyncGenerator[None]:
        """Wait for an owner's turn to have a table written.

        Turns come in the order in which they are asked for.
        """
        self._writing.add(owner)
        try:
            async with self._turns:
                yield
        finally:
            self._writing.discard(owner)

    async def _write(
        self, owner: str, name: str, write: Callable[..., None], *arguments: object
    ) -> IO[bytes]:
        free = shutil.disk_usage(self._folder.parent).free
        room = max(0, min(MOST_BYTES - self._sent[owner], free // 2))
        try:
            self._folder.mkdir(mode=0o700, exist_ok=True)
            with TemporaryDirectory(dir=self._folder, ignore_cleanup_errors=True) as folder:
                path = Path(folder) / name
                await self._jobs.run(write, path, room, *arguments, owner=owner, limit_s=LIMIT_S)
                return path.open("rb")
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise JobError(
                f"the table was not written: {reason}, and there is room for {room:,} bytes of it; whoever runs the server can "
                "write it with `humanplay export`"
            ) from error

    def close(self) -> None:
        """Delete every file; the runner of the jobs has been closed."""
        shutil.rmtree(self._folder, ignore_errors=True)

    @contextmanager
    def _counted(self, owner: str, file: IO[bytes]) -> Generator[None]:
        """Count the bytes of a file that is sent, and close it."""
        size = os.fstat(file.fileno()).st_size
        self._sent[owner] += size
        try:
            with closing(file):
                yield
        finally:
            self._sent[owner] -= size
            self._sent += Counter()  # owners of nothing leave


class _OpenFile(StreamingResponse):
    """Sends an open file, for SEND_S at most.

    Its context closes the file, also when the reader goes before its end.
    """

    def __init__(self, file: IO[bytes], name: str, context: AbstractContextManager[None]) -> None:
        headers = {
            "Content-Disposition": f'attachment; filename="{name}"',
            "Content-Length": str(os.fstat(file.fileno()).st_size),
            "Cache-Control": "no-store",
        }
        pieces = iter(lambda: file.read(PIECE_BYTES), b"")
        kind = "application/zip" if name.endswith(".zip") else "text/csv; charset=utf-8"
        super().__init__(pieces, media_type=kind, headers=headers)
        self._context = context

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._context, suppress(TimeoutError):
            async with asyncio.timeout(SEND_S):
                await super().__call__(scope, receive, send)
