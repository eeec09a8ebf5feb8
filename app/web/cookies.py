"""The cookies: a player's and a participant's for two years, the operator's for some hours. No script can read any.

Who plays and who takes part in studies are two people to the server: nothing links a browser's one cookie to its other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from starlette.requests import HTTPConnection
from starlette.responses import Response

from app.web.operator.login import TOKEN_S
from app.web.protection import is_secure

PLAYER_COOKIE = "mars_player"
PARTICIPANT_COOKIE = "mars_participant"
ADMIN_COOKIE = "mars_admin"


@dataclass(frozen=True)
class Cookie:
    """A cookie that lasts some seconds; other sites' pages send it with links to us ("lax"), or never ("strict")."""

    name: str
    lasts_s: int
    samesite: Literal["lax", "strict"]

    def token(self, connection: HTTPConnection) -> str:
        """Return the cookie's value; "" without one."""
        return connection.cookies.get(self.name, "")

    def set(self, response: Response, connection: HTTPConnection, token: str) -> None:
        """Set the cookie, Secure when the page came by TLS; an empty token deletes it."""
        response.set_cookie(
            self.name, token, max_age=self.lasts_s if token else 0, httponly=True,
            samesite=self.samesite, secure=is_secure(connection),
        )  # fmt: skip


PLAYER = Cookie(PLAYER_COOKIE, 2 * 365 * 24 * 3600, "lax")
PARTICIPANT = Cookie(PARTICIPANT_COOKIE, 2 * 365 * 24 * 3600, "lax")
ADMIN = Cookie(ADMIN_COOKIE, TOKEN_S, "strict")
