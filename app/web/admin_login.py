"""The operator's door: a password opens it, a signed cookie keeps it open for some hours, wrong guesses are counted.

The key that signs is drawn at each start, so a restart of the server closes the door for everybody.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections import deque
from collections.abc import Callable

from itsdangerous import BadSignature, TimestampSigner
from starlette.requests import HTTPConnection
from starlette.responses import Response

from app.settings import Settings
from app.web.cookies import is_secure

COOKIE = "mars_admin"
HOURS = 8
OPEN_S = HOURS * 3600
SHORTEST = 8
"""Characters of a password, at least."""

WINDOW_S = 60.0
FROM_ONE, FROM_ALL = 5, 50
"""Wrong passwords within WINDOW_S after which no more are looked at: from one address, from all together."""


class WrongPasswordError(Exception):
    """The password is not the operator's."""


class TooManyAttemptsError(Exception):
    """Too many wrong passwords; `wait_s` says when the next is looked at, in whole seconds."""

    def __init__(self, wait_s: int) -> None:
        super().__init__(f"too many wrong passwords: wait {wait_s} seconds, then try again")
        self.wait_s = wait_s


class AdminLogin:
    """One server's; `clock` gives seconds that never go back."""

    drawn: str | None = None
    """The password when it was drawn here, to be printed once."""

    def __init__(self, password: str, clock: Callable[[], float] = time.monotonic) -> None:
        if len(password) < SHORTEST:
            raise ValueError(f"the operator's password must have at least {SHORTEST} characters, got {len(password)}")
        self._digest = _digest(password)
        self._signer = TimestampSigner(secrets.token_bytes(32), salt="mars-admin")
        self._clock = clock
        self._wrong: deque[tuple[float, str]] = deque()
        self._left: set[str] = set()

    @classmethod
    def of(cls, settings: Settings) -> AdminLogin | None:
        """Return the door that the settings ask for; None: there is none. ValueError when the password is too short."""
        given = settings.admin_password.get_secret_value() if settings.admin_password else ""
        if not given and not settings.admin:
            return None
        password = given or secrets.token_urlsafe(12)
        door = cls(password)
        door.drawn = None if given else password
        return door

    def open(self, password: str, address: str) -> str:
        """Return a cookie's value for the right password; WrongPasswordError or TooManyAttemptsError otherwise."""
        self._check_attempts(address)
        if not hmac.compare_digest(_digest(password), self._digest):
            self._wrong.append((self._clock(), address))
            raise WrongPasswordError("this is not the operator's password")
        return self._signer.sign(secrets.token_hex(16)).decode()

    def admits(self, connection: HTTPConnection) -> bool:
        """Return whether the asker's cookie is one of ours, not expired, not handed back."""
        value = connection.cookies.get(COOKIE, "")
        try:
            self._signer.unsign(value, max_age=OPEN_S)
        except (BadSignature, UnicodeError):
            return False
        return value not in self._left

    def leave(self, connection: HTTPConnection) -> None:
        """Return with the asker's cookie worth nothing any more."""
        if self.admits(connection):
            self._left.add(connection.cookies[COOKIE])

    def _check_attempts(self, address: str) -> None:
        now = self._clock()
        while self._wrong and self._wrong[0][0] <= now - WINDOW_S:
            self._wrong.popleft()
        own = [at for at, whose in self._wrong if whose == address]
        first = own[-FROM_ONE] if len(own) >= FROM_ONE else self._wrong[-FROM_ALL][0] if len(self._wrong) >= FROM_ALL else None
        if first is not None:
            raise TooManyAttemptsError(max(1, round(first + WINDOW_S - now)))


def remember(response: Response, connection: HTTPConnection, value: str) -> None:
    """Set the cookie: readable by no script, sent from our own pages alone, gone after HOURS."""
    response.set_cookie(COOKIE, value, max_age=OPEN_S, path="/", httponly=True, samesite="strict", secure=is_secure(connection))


def forget(response: Response, connection: HTTPConnection) -> None:
    """Take the cookie back."""
    response.delete_cookie(COOKIE, path="/", httponly=True, samesite="strict", secure=is_secure(connection))


def _digest(password: str) -> bytes:
    """Return what is compared: of one length, whatever was typed."""
    return hashlib.sha256(password.encode("utf-8", "surrogatepass")).digest()
