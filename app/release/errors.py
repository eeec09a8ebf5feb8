"""What can go wrong with a release, in one sentence; and libraries that only some commands need."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class ReleaseError(Exception):
    """A release, an import, a merge or an erasure cannot be done; the message says what was expected and the way out."""


LIBRARIES = ("pyarrow", "minari", "h5py", "mlcroissant", "cryptography")
"""What the extra `export` brings."""


def check_libraries() -> None:
    """Return when everything that writing a release needs is installed; ReleaseError naming the first that is not."""
    for name in LIBRARIES:
        library(name)


def library(name: str) -> Any:
    """Return the module of an optional library; ReleaseError naming the extra when it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        missing = name.split(".")[0]
        raise ReleaseError(
            f'{missing} is not installed: `pip install "marsexplorer-playground[export]"` brings what releases are written with'
        ) from error
