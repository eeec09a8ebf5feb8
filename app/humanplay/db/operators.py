"""The named operators of a database, and the log of what they did.

Operators are added on the command line and checked by the server at the login. A password is stored as an argon2id hash. The
log has a row for each action that changes something or takes a file, written before the action begins; no address and no
identity of anybody else is in it.
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from argon2 import PasswordHasher
from argon2.exceptions import VerifyMismatchError

from humanplay.db.database import StoreError, open_database, reading, rows, transaction
from humanplay.db.reader import now_ms
from humanplay.db.store import Store

MIN_PASSWORD = 8
"""Characters of a password, at least."""

PASSWORD_ALONE = "operator"
"""The name under which whoever has the server's one password, MARS_ADMIN_PASSWORD, acts."""

_NAME = re.compile(r"[a-z][a-z0-9_-]{0,31}")
_HASHER = PasswordHasher()
_NOBODYS_HASH = "$argon2id$v=19$m=65536,t=3,p=4$hj4/Ja4HvCL4qlWZD8r+KQ$fpPwtuBjR0wFAXWHQTZR1bntV0LUVyrRUNcOLykKB5k"
"""Checked where no operator has the name, so that the answer takes as long as for one who is there."""
_COLUMNS = "at_ms, operator, action, study, status"
_ADD_ACTION = f"INSERT INTO operator_actions ({_COLUMNS}) VALUES (?, ?, ?, ?, ?)"
_NEWEST = "SELECT at_ms, operator, action, study, status FROM operator_actions ORDER BY number DESC LIMIT ?"


class OperatorError(ValueError):
    """An operator cannot be added or removed as asked; the message says why."""


@dataclass(frozen=True)
class Operator:
    """An operator's row."""

    name: str
    password_hash: str
    created_ms: int


async def find_operator(store: Store, name: str) -> Operator | None:
    """Return the operator of this name, None without one."""
    sql = "SELECT * FROM operators WHERE name = ?"
    found = await store.read(lambda: rows(store.connection, sql, name))
    return Operator(**found[0]) if found else None


def is_password_of(operator: Operator | None, password: str) -> bool:
    """Return whether a password is an operator's; it takes some 50 ms in any case, so call it in a thread."""
    stored = _NOBODYS_HASH if operator is None else operator.password_hash
    try:
        _HASHER.verify(stored, password.encode("utf-8", "surrogatepass"))
    except VerifyMismatchError:
        return False
    return operator is not None


def check_password(password: str) -> None:
    """Raise OperatorError where a password is too short."""
    if len(password) < MIN_PASSWORD:
        least = f"at least {MIN_PASSWORD} characters"
        raise OperatorError(f"the operator's password must have {least}, got {len(password)}")


def add_operator(database: Path, name: str, password: str) -> None:
    """Add an operator; the server may be running.

    OperatorError for a name that is taken or not allowed, and for a password that is too short.
    """
    if not _NAME.fullmatch(name) or name == PASSWORD_ALONE:
        raise OperatorError(
            f"an operator's name is a letter and up to 31 of a-z, 0-9, _ and -, but not {PASSWORD_ALONE!r}, got {name!r}"
        )
    check_password(password)
    row = (name, _HASHER.hash(password.encode("utf-8", "surrogatepass")), now_ms())
    with _writing(database, f"add_operator {name}") as conn:
        if conn.execute("INSERT OR IGNORE INTO operators VALUES (?, ?, ?)", row).rowcount != 1:
            way_out = "remove them first, or choose another name"
            raise OperatorError(f"there is an operator {name!r} already: {way_out}")


def remove_operator(database: Path, name: str) -> None:
    """Remove an operator; they are logged out at once. OperatorError when there is none of this name."""
    with _writing(database, f"remove_operator {name}") as conn:
        if conn.execute("DELETE FROM operators WHERE name = ?", [name]).rowcount != 1:
            raise OperatorError(f"there is no operator {name!r}; `operator list` names them")


def list_operators(database: Path) -> list[Operator]:
    """Return the operators by name; StoreError where there is no database."""
    with reading(database) as conn:
        return [Operator(**row) for row in rows(conn, "SELECT * FROM operators ORDER BY name")]


@contextmanager
def _writing(database: Path, action: str) -> Iterator[sqlite3.Connection]:
    """Yield a connection in a transaction, beside a server that may be running, and log what it does.

    StoreError when the file cannot be written.
    """
    try:
        with closing(open_database(database).conn) as conn, transaction(conn):
            yield conn
            conn.execute(_ADD_ACTION, (now_ms(), "command line", action, None, 200))
    except sqlite3.Error as error:
        why = f"did not take the write, nothing changed: {error}"
        raise StoreError(f"the database {database} {why}") from error


class ActionLog:
    """The log of one database."""

    def __init__(self, store: Store) -> None:
        self._store = store

    async def begin(
        self, operator: str, action: str, study: str | None = None, status: int | None = None
    ) -> int:
        """Log that an action begins, or with its status a whole one, and return its number.

        StoreError when that cannot be written: then do nothing.
        """
        values = (now_ms(), operator, action, study, status)
        return await self._store.change(_execute, _ADD_ACTION, values)

    async def end(self, number: int, status: int) -> None:
        """Log how an action ended, by the status of its answer."""
        sql = "UPDATE operator_actions SET status = ? WHERE number = ?"
        await self._store.change(_execute, sql, (status, number))

    async def newest(self, count: int = 20) -> list[dict[str, Any]]:
        """Return the newest actions, the newest first: at_ms, operator, action, study, and status (None: not ended)."""
        return await self._store.read(lambda: rows(self._store.connection, _NEWEST, count))


def _execute(conn: sqlite3.Connection, sql: str, values: tuple[Any, ...]) -> int:
    return conn.execute(sql, values).lastrowid or 0


def read_actions(database: Path, count: int) -> list[dict[str, Any]]:
    """Return the newest actions of a database that a server may be writing, as `ActionLog.newest` does."""
    with reading(database) as conn:
        return rows(conn, _NEWEST, count)
