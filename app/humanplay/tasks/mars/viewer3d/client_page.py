"""viser's page as this server sends it: panels hidden, usable without a GPU.

One page serves all boards: the name of its frame says which board it shows (`static/task/mars/viewer/board_socket.js`).
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
import zlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import viser

from humanplay import STATIC
from humanplay.tasks.mars.viewer3d.viser_transport import PROTOCOL

CLIENT_PAGE = Path(viser.__file__).parent / "client" / "build" / "index.html"
SCRIPTS = (
    STATIC / "task" / "mars" / "viewer" / "board_socket.js",
    STATIC / "task" / "mars" / "viewer" / "software_canvas.js",
)
"""Plain scripts that run before viser's own; they stand in the page, so that it is fetched whole or not at all."""

STYLE = (
    "[data-floating-window],[data-dock-region],.mantine-Notifications-root,.mantine-Paper-root{display:none!important}"
    ":root{color-scheme:dark}html,body,:has(>canvas),:has(>div>canvas),:has(>div>div>canvas),:has(>div>div>div>canvas)"
    "{background:transparent!important}"
)
"""Hides viser's panels, and shows the stage of the page before anything is drawn."""


@dataclass(frozen=True)
class ClientPage:
    """The page as bytes, plain and gzipped, and a version that changes with it.

    The version changes with viser's too.

    script_hashes   of the scripts inside the page, as a Content-Security-Policy names them ("sha256-...")
    """

    html: bytes
    zipped: bytes
    version: str
    script_hashes: tuple[str, ...]

    @property
    def etag(self) -> str:
        """Return the version as an ETag."""
        return f'"{self.version}"'

    @classmethod
    @cache
    def load(cls) -> ClientPage:
        """Read the page from the installed viser, once for a process."""
        scripts = "".join(f"<script>{path.read_text()}</script>" for path in SCRIPTS)
        head = f"<head><style>{STYLE}</style>{scripts}"
        html = CLIENT_PAGE.read_bytes().replace(b"<head>", head.encode(), 1)
        inside = re.findall(rb"<script\b[^>]*>(.*?)</script>", html, re.DOTALL)
        digests = (base64.b64encode(hashlib.sha256(script).digest()).decode() for script in inside)
        hashes, version = tuple(map("sha256-{}".format, digests)), zlib.crc32(html)
        return cls(html, gzip.compress(html, 9, mtime=0), f"{PROTOCOL}-{version:08x}", hashes)
