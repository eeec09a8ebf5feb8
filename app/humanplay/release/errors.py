"""The error of a release, and the libraries that only some commands need."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


class ReleaseError(Exception):
    """A release cannot be written or imported; says what was expected and what to do."""


EXPORT_LIBRARIES = ("pyarrow", "minari", "h5py", "mlcroissant", "cryptography")
"""The libraries of the extra `export`."""


def check_libraries() -> None:
    """Check that everything that writing a release needs is installed.

    Raises:
        ReleaseError: With the first library that is not.
    """
    for name in EXPORT_LIBRARIES:
        library(name)


def library(name: str) -> ModuleType:
    """Import an optional library and return its module.

    Raises:
        ReleaseError: If it is not installed; names the extra.
    """
    try:
        return import_module(name)
    except ImportError as error:
        missing = name.split(".")[0]
        raise ReleaseError(
            f'{missing} is not installed: `pip install "humanplay[export]"` brings what releases are written with'
        ) from error
