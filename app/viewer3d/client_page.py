"""viser's page as this server hands it out: its panels hidden, and our script for browsers that draw without a GPU."""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path

import viser

from app.viewer3d.viser_transport import PROTOCOL

CLIENT_PAGE = Path(viser.__file__).parent / "client" / "build" / "index.html"

INJECTED = (
    "<style>[data-floating-window],[data-dock-region],.mantine-Notifications-root,.mantine-Paper-root{display:none!important}"
    "html,body,:has(>canvas),:has(>div>canvas),:has(>div>div>canvas),:has(>div>div>div>canvas)"
    "{background:#0e0b0d!important}</style>"
    "<script>document.hasFocus=()=>true</script>"
    '<script src="../../static/viewer/software_canvas.js"></script>'
)
"""Stands ahead of viser's own head: hides its panels, lets it reconnect while the page around it has the focus, and shows
what a processor draws without the page waiting for it."""


@dataclass(frozen=True)
class ClientPage:
    """The page as bytes, plain and gzipped, with an ETag that changes with viser's version and the page's content."""

    html: bytes
    zipped: bytes
    etag: str

    @classmethod
    def load(cls) -> ClientPage:
        """Read the page from the installed viser."""
        html = CLIENT_PAGE.read_bytes().replace(b"<head>", b"<head>" + INJECTED.encode(), 1)
        return cls(html, gzip.compress(html, 6, mtime=0), f'"{PROTOCOL}-{zlib.crc32(html):08x}"')
