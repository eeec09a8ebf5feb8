"""The operator's login: a password is exchanged for a signed token that lasts some hours.

The password is the server's one, MARS_ADMIN_PASSWORD, or that of an operator with a name. The key that signs is drawn at each
start, so a restart of the server logs everybody out.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import secrets
import sqlite3
import time

from itsdangerous import BadSignature, TimestampSigner
from limits import parse_many
from limits.storage import MemoryStorage
from limits.strategies import FixedWindowRateLimiter

from humanplay.db.database import StoreError
from humanplay.db.operators import (
    PASSWORD_ALONE,
    ActionLog,
    Operator,
    check_password,
    find_operator,
    is_password_of,
    list_operators,
)
from humanplay.db.store import Store
from humanplay.web.settings import Settings

TOKEN_S = 8 * 3600
"""Seconds that a token is valid."""

ATTEMPTS_PER_MINUTE, ATTEMPTS_PER_HOUR = 5, 30
"""Wrong attempts of an address, at most; beyond them not even the right password is looked at."""

MOST_CHECKED = 8
"""Logins by name whose passwords are checked or wait for it, at most: a hash takes some 50 ms of a core, one at a time."""

BUSY_S = 2
"""Seconds after which whoever comes beyond MOST_CHECKED is told to come again."""

REFUSED_EVERY_S = 60.0
"""Seconds between two refused logins that are logged, so that guessing does not fill the disk."""


class WrongPasswordError(Exception):
    """Name and password are no operator's."""


class TooManyAttemptsError(Exception):
    """An attempt is not looked at; `wait_s` says when the next one is, in whole seconds."""

    def __init__(self, reason: str, wait_s: int) -> None:
        super().__init__(f"{reason}: wait {wait_s} seconds, then try again")
        self.wait_s = wait_s


class Attempts:
    """The attempts of each address, counted by the library `limits`."""

    def __init__(self) -> None:
        self._limits = parse_many(f"{ATTEMPTS_PER_MINUTE}/minute; {ATTEMPTS_PER_HOUR}/hour")
        self._limiter = FixedWindowRateLimiter(MemoryStorage())

    def begin(self, address: str) -> None:
        """Count an attempt as wrong until `forgive` says otherwise; TooManyAttemptsError beyond the limits.

        It counts before the password is looked at, so attempts at the same time are no way around the limits.
        """
        for limit in self._limits:
            if not self._limiter.hit(limit, address):
                ends_s = self._limiter.get_window_stats(limit, address).reset_time
                wait_s = max(1, round(ends_s - time.time()))
                raise TooManyAttemptsError("too many wrong attempts from this address", wait_s)

    def forgive(self, address: str) -> None:
        """Forget the attempts of an address: the last one was right."""
        for limit in self._limits:
            self._limiter.clear(limit, address)


class AdminPassword:
    """The server's one password, or (None) none, and how often it is guessed, whichever of its environments is asked.

    `is_drawn` says that the server drew it itself, to be printed once.
    """

    def __init__(self, password: str | None, is_drawn: bool = False) -> None:
        if password is not None:
            check_password(password)
        self.drawn = password if is_drawn else None
        self._digest = None if password is None else _digest(password)
        self.attempts = Attempts()

    @classmethod
    def of(cls, settings: Settings) -> AdminPassword | None:
        """Return what the settings ask for, None for no operator's page; ValueError when the password is too short.

        The page is there with a password, with `--admin`, and where the database has named operators; then none is drawn.
        """
        given = settings.admin_password.get_secret_value() if settings.admin_password else ""
        if given:
            return cls(given)
        try:
            has_operators = bool(list_operators(settings.database))
        except (StoreError, sqlite3.Error):  # opening the store says what is wrong
            has_operators = False
        if has_operators:
            return cls(None)
        return cls(secrets.token_urlsafe(12), is_drawn=True) if settings.admin else None

    def is_right(self, password: str) -> bool:
        """Return whether this is the server's one password."""
        return self._digest is not None and hmac.compare_digest(_digest(password), self._digest)


class AdminLogin:
    """The login of one server, with what it logs."""

    def __init__(self, password: AdminPassword, store: Store, log: ActionLog) -> None:
        self._password, self._store, self._log = password, store, log
        self._signer = TimestampSigner(secrets.token_bytes(32), salt="mars-admin")
        self._revoked: set[str] = set()
        self._checking = asyncio.Lock()  # a hash takes 64 MiB: one at a time
        self._checked = 0
        self._refused_at = -REFUSED_EVERY_S

    async def issue(self, address: str, name: str, password: str) -> str:
        """Return a token for the right name ("" for the server's one password) and password.

        WrongPasswordError or TooManyAttemptsError otherwise; StoreError where it cannot be logged. Call it once for an attempt:
        it waits by itself while another program has locked the database.
        """
        if name and self._checked >= MOST_CHECKED:  # such an attempt does not count
            raise TooManyAttemptsError("too many people log in at this moment", BUSY_S)
        self._password.attempts.begin(address)
        who = await self._with_password(name, password) if name else None
        if who is None and (name or not self._password.is_right(password)):
            await self._note_refused(name)
            what = "no operator's name and password" if name else "not the operator's password"
            raise WrongPasswordError(f"this is {what}")
        await self._log.begin(name or PASSWORD_ALONE, "log_in", status=200)
        self._password.attempts.forgive(address)
        since = who.created_ms if who else 0
        return self._signer.sign(f"{secrets.token_hex(16)}:{name}:{since}").decode()

    async def operator_of(self, token: str) -> str | None:
        """Return whose token this is; None for one that was not issued here, has expired, or was revoked with its operator."""
        try:
            _, name, since = self._signer.unsign(token, max_age=TOKEN_S).decode().split(":")
        except (BadSignature, ValueError):  # UnicodeError is a ValueError
            return None
        if token in self._revoked:
            return None
        if not name:
            return PASSWORD_ALONE
        found = await find_operator(self._store, name)
        return name if found is not None and str(found.created_ms) == since else None

    async def revoke(self, token: str) -> None:
        """Make a token invalid."""
        if await self.operator_of(token) is not None:
            self._revoked.add(token)

    async def _with_password(self, name: str, password: str) -> Operator | None:
        """Return the operator whose name and password these are."""
        self._checked += 1
        try:
            found = await find_operator(self._store, name)
            async with self._checking:
                is_right = await asyncio.to_thread(is_password_of, found, password)
        finally:
            self._checked -= 1
        return found if is_right else None

    async def _note_refused(self, name: str) -> None:
        """Log a refused login, at most one each minute, by the name if there is such an operator."""
        if time.monotonic() - self._refused_at >= REFUSED_EVERY_S:
            self._refused_at = time.monotonic()
            is_unknown = name and await find_operator(self._store, name) is None
            who = "unknown name" if is_unknown else name or PASSWORD_ALONE
            await self._log.begin(who, "log_in", status=401)


def _digest(password: str) -> bytes:
    """Return what is compared: its length is the same whatever was typed."""
    return hashlib.sha256(password.encode("utf-8", "surrogatepass")).digest()
