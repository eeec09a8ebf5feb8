"""Who asks: a player is a signed cookie, and a page of ours says so by its Origin."""

from __future__ import annotations

from urllib.parse import urlsplit

from itsdangerous import BadSignature, Signer
from starlette.requests import HTTPConnection
from starlette.responses import Response

COOKIE = "mars_player"
_TWO_YEARS_S = 2 * 365 * 24 * 3600


class PlayerCookies:
    """Signs players' ids into cookies and reads them back; `secret` is the database's."""

    def __init__(self, secret: str) -> None:
        self._signer = Signer(secret, salt="mars-player")

    def of(self, connection: HTTPConnection) -> str | None:
        """Return the player's id in a cookie of ours; None without one or when it was tampered with."""
        try:
            return self._signer.unsign(connection.cookies.get(COOKIE, "")).decode()
        except (BadSignature, UnicodeError):
            return None

    def remember(self, response: Response, connection: HTTPConnection, player_id: str) -> None:
        """Set the cookie, readable by no script and sent from our own pages alone; Secure when the page came by TLS."""
        response.set_cookie(
            COOKIE,
            self._signer.sign(player_id).decode(),
            max_age=_TWO_YEARS_S,
            path="/",
            httponly=True,
            samesite="lax",
            secure=is_secure(connection),
        )


def is_secure(connection: HTTPConnection) -> bool:
    """Return whether the page came by TLS, to us or to a proxy before us."""
    forwarded = connection.headers.get("x-forwarded-proto", "").split(",")[0].strip()
    return "https" in (connection.url.scheme, forwarded) or connection.url.scheme == "wss"


def has_own_origin(connection: HTTPConnection) -> bool | None:
    """Return whether the Origin header names the host asked for; None without one (a browser always sends it).

    A proxy may hand its own name on in X-Forwarded-Host, and a Host without a port (nginx's `$host`) speaks for any.
    """
    origin = connection.headers.get("origin")
    if origin is None:
        return None
    came = urlsplit(origin)
    forwarded = connection.headers.get("x-forwarded-host", "").split(",")[0].strip()
    hosts = [host.lower() for host in (connection.headers.get("host", ""), forwarded) if host]
    return came.netloc.lower() in hosts or (came.hostname or "") in hosts
