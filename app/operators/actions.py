"""What operators did: a row for each action that changes something or takes a file, written before the action begins."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.storage.database import reading, rows
from app.storage.store import Store

_NEWEST = "SELECT at_ms, operator, action, study, status FROM operator_actions ORDER BY number DESC LIMIT ?"


class ActionLog:
    """The log of one database. No address and no identity of anybody else is in it."""

    def __init__(self, store: Store) -> None:
        self._store = store

    async def begin(self, operator: str, action: str, study: str | None) -> int:
        """Log that an action begins and return its number; StoreError when that cannot be written: then do nothing."""
        return await self._store.write(lambda: self._begin(operator, action, study))

    async def end(self, number: int, status: int) -> None:
        """Log how an action ended, by the status of its answer."""
        await self._store.write(lambda: self._end(number, status))

    async def admit(self, operator: str, use_code: Callable[[], bool]) -> bool:
        """Log a login and return True, in the transaction that uses its code; False, and nothing logged, for a wrong one."""
        return await self._store.write(lambda: self._admit(operator, use_code))

    async def newest(self, count: int = 20) -> list[dict[str, Any]]:
        """Return the newest actions, the newest first: at_ms, operator, action, study, and status (None: not ended)."""
        return await self._store.read(lambda: rows(self._store.connection, _NEWEST, count))

    def _begin(self, operator: str, action: str, study: str | None) -> int:
        sql = "INSERT INTO operator_actions (at_ms, operator, action, study) VALUES (?, ?, ?, ?)"
        with self._store.transaction():
            number = self._store.connection.execute(
                sql, (time.time_ns() // 1_000_000, operator, action, study)
            ).lastrowid
        assert number is not None
        return number

    def _admit(self, operator: str, use_code: Callable[[], bool]) -> bool:
        with self._store.transaction():
            if not use_code():
                return False
            self._end(self._begin(operator, "log_in", None), 200)
        return True

    def _end(self, number: int, status: int) -> None:
        with self._store.transaction():
            self._store.connection.execute(
                "UPDATE operator_actions SET status = ? WHERE number = ?", (status, number)
            )


def read_actions(database: Path, count: int) -> list[dict[str, Any]]:
    """Return the newest actions of a database that a server may be writing, as `ActionLog.newest` does."""
    with reading(database) as conn:
        return rows(conn, _NEWEST, count)
