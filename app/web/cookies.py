"""The two cookies: a player's for two years, the operator's for some hours. No script can read either."""

from __future__ import annotations

from starlette.requests import HTTPConnection
from starlette.responses import Response

from app.web.operator.login import TOKEN_S
from app.web.protection import is_secure

PLAYER_COOKIE = "mars_player"
ADMIN_COOKIE = "mars_admin"
_TWO_YEARS_S = 2 * 365 * 24 * 3600


def player_token(connection: HTTPConnection) -> str:
    """Return the value of the player's cookie; "" without one."""
    return connection.cookies.get(PLAYER_COOKIE, "")


def set_player_token(response: Response, connection: HTTPConnection, token: str) -> None:
    """Set the player's cookie, which other sites' pages send only with links to us; Secure when the page came by TLS."""
    response.set_cookie(
        PLAYER_COOKIE,
        token,
        max_age=_TWO_YEARS_S,
        path="/",
        httponly=True,
        samesite="lax",
        secure=is_secure(connection),
    )


def admin_token(connection: HTTPConnection) -> str:
    """Return the value of the operator's cookie; "" without one."""
    return connection.cookies.get(ADMIN_COOKIE, "")


def set_admin_token(response: Response, connection: HTTPConnection, token: str) -> None:
    """Set the operator's cookie, which only our own pages send; Secure when the page came by TLS."""
    response.set_cookie(
        ADMIN_COOKIE,
        token,
        max_age=TOKEN_S,
        path="/",
        httponly=True,
        samesite="strict",
        secure=is_secure(connection),
    )


def delete_admin_token(response: Response, connection: HTTPConnection) -> None:
    """Delete the operator's cookie."""
    response.delete_cookie(
        ADMIN_COOKIE, path="/", httponly=True, samesite="strict", secure=is_secure(connection)
    )
