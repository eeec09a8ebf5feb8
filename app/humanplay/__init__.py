"""The MarsExplorer playground: server, storage and command."""

import os
from pathlib import Path

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # see marsexplorer

PACKAGE = Path(__file__).resolve().parent
ROOT = PACKAGE.parents[1]
IS_CHECKOUT = (ROOT / "pyproject.toml").is_file()
"""Whether this package runs from a checkout of the repository; otherwise it is installed from a wheel."""

STATIC = ROOT / "static" if IS_CHECKOUT else PACKAGE / "static"
"""The files of the pages: at the root of a checkout, inside this package in a wheel."""

SHIPPED_DATA = (ROOT if IS_CHECKOUT else PACKAGE) / "data"
"""What comes with the package beside its code: `leaderboard/`, the figures of the shipped policies."""
