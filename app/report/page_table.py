"""A table of the page as text cells."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class PageTable:
    """A table whose first column names the rows; a line break in a cell is kept.

    is_text      left-aligned text instead of numbers
    row_classes  a CSS class for each row, "" for none; empty when no row has one
    """

    caption: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    is_text: bool = False
    row_classes: Sequence[str] = ()

    @property
    def id(self) -> str:
        """The caption's id in the page, the same for the same table."""
        return "t" + hashlib.sha256(f"{self.caption}{self.rows}".encode()).hexdigest()[:10]
