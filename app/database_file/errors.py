"""The errors of a database."""

from __future__ import annotations


class StoreError(Exception):
    """The database cannot be used as asked; the message says what was expected, what came, and the way out."""


class WriteRefusedError(StoreError):
    """A write was not made, since its turn did not come; nothing has changed, and the same write may succeed later."""
