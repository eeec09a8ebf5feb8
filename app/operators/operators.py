"""The named operators of a database: added on the command line, checked by the server at the login.

A password is stored as an argon2id hash. The secret of a second factor is stored as it is, since each code is computed from it.
"""

from __future__ import annotations

import hmac
import re
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyotp
from argon2 import PasswordHasher
from argon2.exceptions import VerifyMismatchError

from app.storage.database import StoreError, open_database, reading, rows, transaction
from app.storage.store import Store

MIN_PASSWORD = 8
"""Characters of a password, at least."""

PASSWORD_ALONE = "operator"
"""The name under which whoever has the server's one password, MARS_ADMIN_PASSWORD, acts."""

PERIOD_S = 30
"""Seconds that a code of a second factor stands (RFC 6238); the one before and the one after pass as well."""

_NAME = re.compile(r"[a-z][a-z0-9_-]{0,31}")
_HASHER = PasswordHasher()
_NOBODYS_HASH = "$argon2id$v=19$m=65536,t=3,p=4$hj4/Ja4HvCL4qlWZD8r+KQ$fpPwtuBjR0wFAXWHQTZR1bntV0LUVyrRUNcOLykKB5k"
"""Checked where no operator has the name, so that the answer takes as long as for one who is there."""


class OperatorError(ValueError):
    """An operator cannot be added or removed as asked; the message says why."""


@dataclass(frozen=True)
class Operator:
    """An operator's row; `totp_secret` is None without a second factor, `last_code` the newest period whose code was used."""

    name: str
    password_hash: str
    totp_secret: str | None
    last_code: int
    created_ms: int


class Operators:
    """The operators as a server reads them; `clock` gives seconds since 1970."""

    def __init__(self, store: Store, clock: Callable[[], float] = time.time) -> None:
        self._store, self._clock = store, clock

    async def find(self, name: str) -> Operator | None:
        """Return the operator of this name, None without one."""
        sql = "SELECT * FROM operators WHERE name = ?"
        found = await self._store.read(lambda: rows(self._store.connection, sql, name))
        return Operator(**found[0]) if found else None

    def use_code(self, operator: Operator, code: str) -> bool:
        """Return whether a code of the second factor is right and was not used, and use it up; call it in `Store.write`."""
        if operator.totp_secret is None:
            return True
        totp, now = pyotp.TOTP(operator.totp_secret), int(self._clock()) // PERIOD_S
        for period in (now - 1, now, now + 1):
            if hmac.compare_digest(
                totp.generate_otp(period).encode(), code.strip().encode("utf-8", "replace")
            ):
                sql = "UPDATE operators SET last_code = ?2 WHERE name = ?1 AND last_code < ?2"
                with self._store.transaction():
                    return (
                        self._store.connection.execute(sql, (operator.name, period)).rowcount == 1
                    )
        return False


def is_password_of(operator: Operator | None, password: str) -> bool:
    """Return whether a password is an operator's; it takes some 50 ms in any case, so call it in a thread."""
    try:
        _HASHER.verify(
            _NOBODYS_HASH if operator is None else operator.password_hash,
            password.encode("utf-8", "surrogatepass"),
        )
    except VerifyMismatchError:
        return False
    return operator is not None


def check_password(password: str) -> None:
    """Raise OperatorError where a password is too short."""
    if len(password) < MIN_PASSWORD:
        raise OperatorError(
            f"the operator's password must have at least {MIN_PASSWORD} characters, got {len(password)}"
        )


def add_operator(database: Path, name: str, password: str, totp: bool = False) -> str | None:
    """Add an operator and return the otpauth address of their second factor, None without one; the server may be running.

    OperatorError for a name that is taken or not allowed, and for a password that is too short.
    """
    if not _NAME.fullmatch(name) or name == PASSWORD_ALONE:
        raise OperatorError(
            f"an operator's name is a letter and up to 31 of a-z, 0-9, _ and -, but not {PASSWORD_ALONE!r}, got {name!r}"
        )
    check_password(password)
    secret = pyotp.random_base32() if totp else None
    with _writing(database) as conn:
        row = (
            name,
            _HASHER.hash(password.encode("utf-8", "surrogatepass")),
            secret,
            0,
            time.time_ns() // 1_000_000,
        )
        if (
            conn.execute("INSERT OR IGNORE INTO operators VALUES (?, ?, ?, ?, ?)", row).rowcount
            != 1
        ):
            raise OperatorError(
                f"there is an operator {name!r} already: remove them first, or choose another name"
            )
        note_from_command_line(conn, f"add_operator {name}")
    return (
        None
        if secret is None
        else pyotp.TOTP(secret).provisioning_uri(name=name, issuer_name="MarsExplorer Playground")
    )


def remove_operator(database: Path, name: str) -> None:
    """Remove an operator; they are logged out at once. OperatorError when there is none of this name."""
    with _writing(database) as conn:
        if conn.execute("DELETE FROM operators WHERE name = ?", [name]).rowcount != 1:
            raise OperatorError(
                f"there is no operator {name!r}; `marsexplorer operator list` names them"
            )
        note_from_command_line(conn, f"remove_operator {name}")


def list_operators(database: Path) -> list[Operator]:
    """Return the operators by name; none where there is no database yet."""
    if not database.exists():
        return []
    with reading(database) as conn:
        return [Operator(**row) for row in rows(conn, "SELECT * FROM operators ORDER BY name")]


def note_from_command_line(conn: sqlite3.Connection, action: str) -> None:
    """Log what was done on the command line; call it in the transaction that does it."""
    sql = "INSERT INTO operator_actions (at_ms, operator, action, status) VALUES (?, 'command line', ?, 200)"
    conn.execute(sql, (time.time_ns() // 1_000_000, action))


@contextmanager
def _writing(database: Path) -> Iterator[sqlite3.Connection]:
    """Yield a connection in a transaction, beside a server that may be running; StoreError when the file cannot be written."""
    database.parent.mkdir(parents=True, exist_ok=True)
    try:
        with closing(open_database(database).conn) as conn, transaction(conn):
            yield conn
    except sqlite3.Error as error:
        raise StoreError(
            f"the database {database} did not take the write, nothing changed: {error}"
        ) from error
