"""The errors of a database."""

from __future__ import annotations


class StoreError(Exception):
    """The database cannot be used as asked; the message says what was expected, what came, and the way out."""
