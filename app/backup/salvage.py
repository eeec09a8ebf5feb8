"""The rows that can still be read from a table of a damaged database, whatever pages of it are gone."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from typing import Any

Row = tuple[Any, ...]

_LAST_ROWID = 2**62
"""Beyond every row id that SQLite gives by itself."""


class TableSalvage:
    """The readable rows of one table, given by name and columns; `is_whole` says afterwards whether all of them were.

    is_whole  False once a page could not be read
    """

    def __init__(self, source: sqlite3.Connection, table: str, columns: Sequence[str]) -> None:
        self._source, self._table, self._columns = source, table, ", ".join(columns)
        self.is_whole = True

    def by_rowid(self) -> Iterator[Row]:
        """Yield the rows of a table with row ids: those before and after each damaged page."""
        first = -_LAST_ROWID
        while True:
            try:
                for rowid, *row in self._select("rowid >= ? ORDER BY rowid", (first,), "rowid, "):
                    first = rowid + 1
                    yield tuple(row)
                return
            except sqlite3.DatabaseError:
                self.is_whole = False
                found = self._next_readable(first)
                if found is None:
                    return
                first = found

    def by_keys(self, key: str, values: Sequence[object], order: str) -> Iterator[Row]:
        """Yield the rows of a table without row ids, for each value of its first key column from both ends.

        key     the first column of its primary key, `order` the next one
        """
        for value in values:
            for direction in ("ASC", "DESC"):
                try:
                    yield from self._select(f"{key} = ? ORDER BY {order} {direction}", (value,))
                    break
                except sqlite3.DatabaseError:
                    self.is_whole = False

    def from_both_ends(self, key: str) -> Iterator[Row]:
        """Yield the rows before the first damaged page and those after the last one; rows may come twice."""
        for direction in ("ASC", "DESC"):
            try:
                yield from self._select(
                    f"1 ORDER BY {', '.join(f'{column} {direction}' for column in key.split(', '))}",
                    (),
                )
                return
            except sqlite3.DatabaseError:
                self.is_whole = False

    def _select(self, condition: str, values: Sequence[object], before: str = "") -> Iterator[Row]:
        yield from self._source.execute(
            f"SELECT {before}{self._columns} FROM {self._table} WHERE {condition}", values
        )

    def _next_readable(self, first: int) -> int | None:
        """Return the smallest row id from `first` on from which a row can be read, None when there is none.

        The distance doubles until a row can be read, then halves.
        """
        step, low = 1, first
        while not self._is_readable(first + step):
            low, step = first + step, 2 * step
            if first + step >= 2 * _LAST_ROWID:
                return None
        high = first + step
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self._is_readable(middle) else (middle, high)
        return high

    def _is_readable(self, rowid: int) -> bool:
        """Return whether the first row from a row id on can be read, or there is none."""
        try:
            next(self._select("rowid >= ? ORDER BY rowid LIMIT 1", (rowid,)), None)
        except sqlite3.DatabaseError:
            return False
        return True
