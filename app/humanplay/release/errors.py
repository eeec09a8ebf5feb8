"""The error of a release, and the libraries that only some commands need."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


class ReleaseError(Exception):
    """A release cannot be written or imported; the message says what was expected, and what to do."""


EXPORT_LIBRARIES = ("pyarrow", "minari", "h5py", "mlcroissant", "cryptography")
"""The libraries of the extra `export`."""


def check_libraries() -> None:
    """Check that everything that writing a release needs is installed; ReleaseError naming the
    first that is not."""
    for name in EXPORT_LIBRARIES:
        library(name)


def library(name: str) -> ModuleType:
    """Import an optional library and return its module; ReleaseError naming the extra when it is
    not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        missing = name.split(".")[0]
        raise ReleaseError(
            f'{missing} is not installed: `pip install "humanplay[export]"` brings what releases are written with'
        ) from error
