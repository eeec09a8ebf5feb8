"""The files of the pages, below an address that holds one hash of them all.

So a browser asks for each of them once. A file that has changed changes the hash at the next page.
Below an old hash stands today's file, which no browser keeps.
"""

from __future__ import annotations

import asyncio
import gzip
import hashlib
import mimetypes
import os
import posixpath
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import Response
from starlette.exceptions import HTTPException

from humanplay.web.protection import NO_CACHE, SHARED

router = APIRouter(include_in_schema=False)

KEPT = {"Cache-Control": "public, max-age=31536000, immutable"}
"""Of what stands below the hash that it had a part in."""
WORTH_ZIPPING = 600
"""Bytes from which on a text is sent gzipped; nothing that is gzipped holds a secret beside what
somebody else chose."""
TEXTS = ("text/", "application/javascript", "image/svg", "application/json")
UNSERVED = (".html", ".ts")
"""Templates, and types, which no browser reads."""
IMPORT = re.compile(r'^@import "([^"]+)";\n', re.M)
"""A sheet that stands in another one, at its place."""

Version = tuple[int, int, int]


@dataclass(frozen=True)
class PageFile:
    """A file as it was when it was read; a style sheet with those that it imports.

    Attributes:
        parts: The files that it is made of, and their versions.
    """

    content: bytes
    media_type: str
    parts: Mapping[str, Version]
    zipped: bytes | None
    etag: str

    def is_current(self) -> bool:
        """Whether its parts are as they were."""
        try:
            return all(
                _version(Path(path).stat()) == version for path, version in self.parts.items()
            )
        except OSError:
            return False

    def answer(self, request: Request, headers: Mapping[str, str]) -> Response:
        """Answer with the file, or 304 if the browser has this version.

        It is gzipped if the browser reads that.
        """
        headers = {**headers, "ETag": self.etag}
        if self.zipped is not None:
            headers["Vary"] = "Accept-Encoding"
        versions = request.headers.get("if-none-match", "").split(",")
        if self.etag in (version.strip().removeprefix("W/") for version in versions):
            return Response(status_code=304, headers=headers)
        if self.zipped is None or not reads_gzip(request):
            return Response(self.content, media_type=self.media_type, headers=headers)
        headers["Content-Encoding"] = "gzip"
        return Response(self.zipped, media_type=self.media_type, headers=headers)


class PageFiles:
    """The files of some folders by their names, in memory once they have been read.

    Args:
        folders: By what their names begin with; a later folder's file takes the place of an earlier
            one's.
    """

    def __init__(self, folders: Mapping[str, Path]) -> None:
        self._folders = folders
        self._listed: dict[str, tuple[str, Version]] = {}
        self._hash = ""
        self._read: dict[str, PageFile] = {}

    def address(self) -> str:
        """The address below which a page finds the files as they are now: static/HASH/."""
        listed = {
            name: file
            for prefix, folder in self._folders.items()
            for name, file in _files_below(str(folder), prefix)
        }
        if listed != self._listed:
            digest = hashlib.sha256()
            for name, (path, _) in sorted(listed.items()):
                digest.update(
                    f"{name}\0".encode() + hashlib.sha256(Path(path).read_bytes()).digest()
                )
            self._listed, self._hash = listed, digest.hexdigest()[:12]
        return f"static/{self._hash}/"

    async def file(self, name: str) -> PageFile:
        """A file as it is now.

        Raises:
            KeyError: If there is none.
            FileNotFoundError: If there is none any more.
        """
        if not self._listed:
            self.address()
        file = self._read.get(name)
        if file is None or not file.is_current():
            file = self._read[name] = await asyncio.to_thread(self._load, name)
        return file

    def is_hashed(self, address: str, file: PageFile) -> bool:
        """Whether the hash of an address was made of a file as it is."""
        versions = dict(self._listed.values())
        is_current = all(versions.get(path) == version for path, version in file.parts.items())
        return address == self._hash and is_current

    def _load(self, name: str) -> PageFile:
        parts: dict[str, Version] = {}

        def read(name: str) -> bytes:
            path, _ = self._listed[name]
            parts[path] = _version(Path(path).stat())
            return Path(path).read_bytes()

        content = joined(name, read)
        media_type = mimetypes.guess_type(name)[0] or "application/octet-stream"
        is_zipped = len(content) >= WORTH_ZIPPING and media_type.startswith(TEXTS)
        return PageFile(
            content,
            media_type,
            parts,
            gzip.compress(content, 9, mtime=0) if is_zipped else None,
            f'"{hashlib.sha256(content).hexdigest()[:20]}"',
        )


ASKED_FOR = {
    "/favicon.ico": "common/icon.ico",
    "/apple-touch-icon.png": "common/touch_icon.png",
    "/robots.txt": "common/robots.txt",
}
"""What browsers and search engines ask for by addresses of their own."""


def _serve(path: str, name: str) -> None:
    async def serve(request: Request) -> Response:
        files: PageFiles = request.app.state.files
        return (await files.file(name)).answer(request, NO_CACHE)

    router.add_api_route(path, serve, methods=["GET"])


for _path, _name in ASKED_FOR.items():
    _serve(_path, _name)


@router.get("/static/{name}")
async def no_page_file(name: str) -> Response:
    """Answer that nothing stands without a hash.

    Else the router would send to `/static/NAME/`.
    """
    raise HTTPException(404)


@router.get("/static/{version}/{name:path}")
async def page_file(request: Request, version: str, name: str) -> Response:
    """Serve a file of the pages."""
    files: PageFiles = request.app.state.files
    try:
        if not re.fullmatch("[0-9a-f]{12}", version):
            raise KeyError(version)
        file = await files.file(name)
    except (KeyError, FileNotFoundError) as error:
        raise HTTPException(404) from error
    caching = KEPT if files.is_hashed(version, file) else NO_CACHE
    # pages of other sites may show the picture of a preview
    return file.answer(request, {**caching, **(SHARED if file.media_type == "image/png" else {})})


def joined(name: str, read: Callable[[str], bytes]) -> bytes:
    """A file; a style sheet with those that it imports, in their places.

    Args:
        read: Returns what stands in a file, by its name.
    """
    content = read(name)
    if not name.endswith(".css"):
        return content

    def imported(match: re.Match[str]) -> str:
        beside = posixpath.join(posixpath.dirname(name), match[1])
        return joined(posixpath.normpath(beside), read).decode()

    return IMPORT.sub(imported, content.decode()).encode()


def reads_gzip(request: Request) -> bool:
    """Whether a browser reads what is gzipped."""
    return "gzip" in request.headers.get("accept-encoding", "")


def _files_below(folder: str, prefix: str) -> Iterator[tuple[str, tuple[str, Version]]]:
    """Yield names, paths and versions.

    It uses `scandir`, since every page waits for it.
    """
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                yield from _files_below(entry.path, f"{prefix}{entry.name}/")
            elif not entry.name.endswith(UNSERVED):
                yield prefix + entry.name, (entry.path, _version(entry.stat()))


def _version(stat: os.stat_result) -> Version:
    return stat.st_mtime_ns, stat.st_size, stat.st_ino
