"""The operator's login: a password is exchanged for a token that lasts some hours.

The key that signs is drawn at each start, so a restart of the server logs everybody out.
"""

from __future__ import annotations

import hashlib
import hmac
import math
import secrets

from itsdangerous import BadSignature, TimestampSigner

from humanplay.web.protection.limits import Buckets
from humanplay.web.settings import Settings

MIN_PASSWORD = 8
"""Characters of a password, at least."""

TOKEN_S = 8 * 3600
"""Seconds that a token is valid."""

MOST_ATTEMPTS = 5
ATTEMPTS = f"{MOST_ATTEMPTS}+0.006/s"
"""Wrong attempts of an address: so many at once, then one in 167 seconds.

Beyond them not even the right password is looked at.
"""


class WrongPasswordError(Exception):
    """A password is not the operator's."""


class TooManyAttemptsError(Exception):
    """An attempt is refused unread; the next one is possible in `wait_s` seconds."""

    def __init__(self, wait_s: int) -> None:
        super().__init__(
            f"too many wrong attempts from this address: wait {wait_s} seconds, then try again"
        )
        self.wait_s = wait_s


class AdminPassword:
    """The one password of all environments of a server, and the attempts to guess it.

    drawn  the password where the server drew it itself, to be printed once; else None
    """

    def __init__(self, password: str, is_drawn: bool = False) -> None:
        if len(password) < MIN_PASSWORD:
            raise ValueError(
                f"the operator's password must have at least {MIN_PASSWORD} characters, got {len(password)}"
            )
        self.drawn = password if is_drawn else None
        self._digest = _digest(password)
        self.attempts = Buckets(ATTEMPTS)

    @classmethod
    def of(cls, settings: Settings) -> AdminPassword | None:
        """The password of the settings, or a drawn one; None without an operator's page.

        Raises:
            ValueError: If the password is too short.
        """
        password = settings.admin_password.get_secret_value() if settings.admin_password else ""
        if password:
            return cls(password)
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
        """A token for the right password.

        An attempt counts before the password is looked at, so attempts at the same time are no way around the limit.

        Raises:
            WrongPasswordError, TooManyAttemptsError: Otherwise.
        """
        if wait_s := self._password.attempts.of(address).take():
            raise TooManyAttemptsError(math.ceil(wait_s))
        if not self._password.is_right(password):
            raise WrongPasswordError("this is not the operator's password")
        self._password.attempts.forget(address)
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
