"""The databases that this process has open, by device and inode.

SQLite locks a file with POSIX locks, and a process that closes any handle on the file loses all of them. So a file that is in
use here is not opened and closed by anything else, and a handle of our own is closed when SQLite has none left.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path

Identity = tuple[int, int]
"""Device and inode."""

_in_use: Counter[Identity] = Counter()
_to_close: dict[Identity, list[int]] = {}


def identity_of(path: Path | str) -> Identity:
    """Return device and inode of the file that a path leads to; OSError when there is none."""
    stat = Path(path).stat()
    return stat.st_dev, stat.st_ino


def is_in_use(path: Path) -> bool:
    """Return whether this process has the file open; OSError when there is none."""
    return _in_use[identity_of(path)] > 0


def hold(path: Path) -> Callable[[], None]:
    """Count the file as in use by this process, and return the function to call when the connection to it is closed."""
    held = [identity_of(path)]
    _in_use.update(held)

    def release() -> None:
        _in_use.subtract(held)
        for identity in held:
            _close_unused(identity)
        held.clear()

    return release


def close_when_unused(handle: int, identity: Identity) -> None:
    """Close a handle of our own on a database: now, or once no connection of this process has the file open."""
    _to_close.setdefault(identity, []).append(handle)
    _close_unused(identity)


def _close_unused(identity: Identity) -> None:
    if _in_use[identity] > 0:
        return
    del _in_use[identity]
    for handle in _to_close.pop(identity, []):
        os.close(handle)
