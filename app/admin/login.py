"""The operator's login: a password is exchanged for a signed token that lasts some hours, and wrong passwords are counted.

The key that signs is drawn at each start, so a restart of the server logs everybody out.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections import deque
from collections.abc import Callable

from itsdangerous import BadSignature, TimestampSigner

from app.settings import Settings

TOKEN_S = 8 * 3600
"""Seconds that a token is valid."""

MIN_PASSWORD = 8
"""Characters of a password, at least."""

WINDOW_S = 60.0
MAX_WRONG_FROM_ONE, MAX_WRONG_FROM_ALL = 5, 50
"""Wrong passwords within WINDOW_S after which no more are checked: from one address, from all together."""


class WrongPasswordError(Exception):
    """The password is not the operator's."""


class TooManyAttemptsError(Exception):
    """Too many wrong passwords; `wait_s` says when the next one is checked, in whole seconds."""

    def __init__(self, wait_s: int) -> None:
        super().__init__(f"too many wrong passwords: wait {wait_s} seconds, then try again")
        self.wait_s = wait_s


class AdminLogin:
    """The login of one server; `clock` gives seconds that never go back.

    drawn_password  the password when the server drew it itself, to be printed once; else None
    """

    def __init__(self, password: str, clock: Callable[[], float] = time.monotonic, drawn_password: str | None = None) -> None:
        if len(password) < MIN_PASSWORD:
            raise ValueError(f"the operator's password must have at least {MIN_PASSWORD} characters, got {len(password)}")
        self.drawn_password = drawn_password
        self._digest = _digest(password)
        self._signer = TimestampSigner(secrets.token_bytes(32), salt="mars-admin")
        self._clock = clock
        self._wrong: deque[tuple[float, str]] = deque()
        self._revoked: set[str] = set()

    @classmethod
    def of(cls, settings: Settings) -> AdminLogin | None:
        """Return the login that the settings ask for, None for none; ValueError when the password is too short."""
        given = settings.admin_password.get_secret_value() if settings.admin_password else ""
        if given:
            return cls(given)
        if not settings.admin:
            return None
        password = secrets.token_urlsafe(12)
        return cls(password, drawn_password=password)

    def issue(self, password: str, address: str) -> str:
        """Return a token for the right password; WrongPasswordError or TooManyAttemptsError otherwise."""
        self._check_attempts(address)
        if not hmac.compare_digest(_digest(password), self._digest):
            self._wrong.append((self._clock(), address))
            raise WrongPasswordError("this is not the operator's password")
        return self._signer.sign(secrets.token_hex(16)).decode()

    def is_valid(self, token: str) -> bool:
        """Return whether a token was issued here, has not expired and was not revoked."""
        try:
            self._signer.unsign(token, max_age=TOKEN_S)
        except (BadSignature, UnicodeError):
            return False
        return token not in self._revoked

    def revoke(self, token: str) -> None:
        """Make a token invalid."""
        if self.is_valid(token):
            self._revoked.add(token)

    def _check_attempts(self, address: str) -> None:
        now = self._clock()
        while self._wrong and self._wrong[0][0] <= now - WINDOW_S:
            self._wrong.popleft()
        times = [at for at, other in self._wrong if other == address]
        first: float | None = None
        if len(times) >= MAX_WRONG_FROM_ONE:
            first = times[-MAX_WRONG_FROM_ONE]
        elif len(self._wrong) >= MAX_WRONG_FROM_ALL:
            first = self._wrong[-MAX_WRONG_FROM_ALL][0]
        if first is not None:
            raise TooManyAttemptsError(max(1, round(first + WINDOW_S - now)))


def _digest(password: str) -> bytes:
    """Return what is compared: its length is the same whatever was typed."""
    return hashlib.sha256(password.encode("utf-8", "surrogatepass")).digest()
