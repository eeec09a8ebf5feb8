"""The operator's login: the server's one password is exchanged for a signed token that lasts some hours.

The key that signs is drawn at each start, so a restart of the server logs everybody out.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time

from itsdangerous import BadSignature, TimestampSigner
from limits import parse_many
from limits.storage import MemoryStorage
from limits.strategies import FixedWindowRateLimiter

from humanplay.web.settings import Settings

MIN_PASSWORD = 8
"""Characters of a password, at least."""

TOKEN_S = 8 * 3600
"""Seconds that a token is valid."""

ATTEMPTS_PER_MINUTE, ATTEMPTS_PER_HOUR = 5, 30
"""Wrong attempts of an address, at most; beyond them not even the right password is looked at."""


class WrongPasswordError(Exception):
    """A password is not the operator's."""


class TooManyAttemptsError(Exception):
    """An attempt is not looked at; `wait_s` says when the next one is, in whole seconds."""

    def __init__(self, wait_s: int) -> None:
        super().__init__(
            f"too many wrong attempts from this address: wait {wait_s} seconds, then try again"
        )
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
                raise TooManyAttemptsError(wait_s)

    def forgive(self, address: str) -> None:
        """Forget the attempts of an address: the last one was right."""
        for limit in self._limits:
            self._limiter.clear(limit, address)


class AdminPassword:
    """The server's one password, and how often it is guessed, whichever of its environments is asked.

    drawn  the password where the server drew it itself, to be printed once; else None
    """

    def __init__(self, password: str, is_drawn: bool = False) -> None:
        if len(password) < MIN_PASSWORD:
            raise ValueError(
                f"the operator's password must have at least {MIN_PASSWORD} characters, got {len(password)}"
            )
        self.drawn = password if is_drawn else None
        self._digest = _digest(password)
        self.attempts = Attempts()

    @classmethod
    def of(cls, settings: Settings) -> AdminPassword | None:
        """Return what the settings ask for, None for no operator's page; ValueError when the password is too short."""
        given = settings.admin_password.get_secret_value() if settings.admin_password else ""
        if given:
            return cls(given)
        return cls(secrets.token_urlsafe(12), is_drawn=True) if settings.admin else None

    def is_right(self, password: str) -> bool:
        """Compare in constant time: how long it takes tells nothing of the password."""
        return hmac.compare_digest(_digest(password), self._digest)


class AdminLogin:
    """The login of one server."""

    def __init__(self, password: AdminPassword) -> None:
        self._password = password
        self._signer = TimestampSigner(secrets.token_bytes(32), salt="humanplay-admin")
        self._revoked: set[str] = set()

    def issue(self, address: str, password: str) -> str:
        """Return a token for the right password; WrongPasswordError or TooManyAttemptsError otherwise."""
        self._password.attempts.begin(address)
        if not self._password.is_right(password):
            raise WrongPasswordError("this is not the operator's password")
        self._password.attempts.forgive(address)
        return self._signer.sign(secrets.token_hex(16)).decode()

    def is_valid(self, token: str) -> bool:
        """Whether a token was issued here, and has neither expired nor been revoked."""
        try:
            self._signer.unsign(token, max_age=TOKEN_S)
        except (BadSignature, UnicodeError):
            return False
        return token not in self._revoked

    def revoke(self, token: str) -> None:
        """Make a token invalid."""
        if self.is_valid(token):
            self._revoked.add(token)


def _digest(password: str) -> bytes:
    """What is compared: its length is the same whatever was typed."""
    return hashlib.sha256(password.encode("utf-8", "surrogatepass")).digest()
