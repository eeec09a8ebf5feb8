"""Tables to download: a job writes one into a temporary file, which is then sent.

So no transaction reads the database for as long as a slow reader takes, which would keep its log from being emptied.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

from fastapi import Request
from fastapi.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from app.web.access import owner_of, services_of

LIMIT_S = 600.0
"""Seconds in which a table has to be written."""
PIECE_BYTES = 1 << 16


async def send_made(
    request: Request, name: str, write: Callable[..., None], *arguments: Any
) -> Response:
    """Have `write(path, *arguments)` write a file, as a job, and return the answer that sends it as `name`.

    The file has no name any more once it is sent, and is gone when the answer ends, however it does.
    """
    with TemporaryDirectory(prefix="mars-download-") as folder:
        path = Path(folder) / name
        await services_of(request).jobs.run(
            write, path, *arguments, owner=owner_of(request), limit_s=LIMIT_S
        )
        file = path.open("rb")
    headers = {
        "Content-Disposition": f'attachment; filename="{name}"',
        "Content-Length": str(os.fstat(file.fileno()).st_size),
        "Cache-Control": "no-store",
    }
    return _OpenFile(file, media_type="text/csv; charset=utf-8", headers=headers)


class _OpenFile(StreamingResponse):
    """Sends an open file and closes it, also when the reader goes before its end."""

    def __init__(self, file: IO[bytes], **rest: Any) -> None:
        super().__init__(iter(lambda: file.read(PIECE_BYTES), b""), **rest)
        self._file = file

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._file:
            await super().__call__(scope, receive, send)
