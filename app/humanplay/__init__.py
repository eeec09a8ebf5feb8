"""The MarsExplorer playground: server, storage and command."""

import os
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # see marsexplorer

PACKAGE = Path(__file__).resolve().parent
ROOT = PACKAGE.parents[1]
IS_CHECKOUT = (ROOT / "pyproject.toml").is_file()
"""Whether this package runs from a checkout of the repository; otherwise it is installed from a
wheel."""

STATIC = ROOT / "static" if IS_CHECKOUT else PACKAGE / "static"
"""The files of the pages: at the root of a checkout, inside this package in a wheel."""

SHIPPED_DATA = (ROOT if IS_CHECKOUT else PACKAGE) / "data"
"""What comes with the package beside its code: `leaderboard/`, the figures of the shipped policies."""

if TYPE_CHECKING:
    from humanplay.cli.pilot.play import play
    from humanplay.cli.pilot.score import score

__all__ = ["IS_CHECKOUT", "PACKAGE", "ROOT", "SHIPPED_DATA", "STATIC", "play", "score"]


def __getattr__(name: str) -> object:
    """`play` and `score`, which are imported when they are first wanted."""
    if name in ("play", "score"):
        return getattr(import_module(f"humanplay.cli.pilot.{name}"), name)
    raise AttributeError(f"humanplay has no {name!r}")
