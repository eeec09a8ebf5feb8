"""Who asks, and what they may see and move.

A session that the page began is its player's: only their cookie sees and moves it. One that a
script began (`control` is "bearer") is anybody's who knows its id. A study's board is its
participant's; the operator watches boards on their own page (`humanplay.web.admin`). Whoever may
not see a session gets the answer for an id that does not exist.

The cookies are a player's and a participant's for two years, the operator's for some hours. No
script can read any. Who plays and who takes part in studies are two people to the server: nothing
links a browser's one cookie to its other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.websockets import WebSocket

from humanplay.board.lobby import UnknownSessionError
from humanplay.board.session import Session
from humanplay.web.operator.login import TOKEN_S
from humanplay.web.protection import client_address, is_secure
from humanplay.web.replays.episodes import Asker
from humanplay.web.services import Services

PLAYER_COOKIE = "humanplay_player"
PARTICIPANT_COOKIE = "humanplay_participant"
ADMIN_COOKIE = "humanplay_admin"


@dataclass(frozen=True)
class Cookie:
    """A cookie that lasts some seconds.

    Attributes:
        samesite: Other sites' pages send it with links to us ("lax"), or never ("strict").
    """

    name: str
    lasts_s: int
    samesite: Literal["lax", "strict"]

    def token(self, connection: HTTPConnection) -> str:
        """Return the cookie's value; "" without one."""
        return connection.cookies.get(self.name + connection.app.state.cookies, "")

    def set(self, response: Response, connection: HTTPConnection, token: str) -> None:
        """Set the cookie, Secure when the page came by TLS; an empty token deletes it.

        In a frame of another site browsers send none but those that say so: where one may frame us,
        ours do.
        """
        is_framed = bool(connection.app.state.framed_by) and self.samesite == "lax"
        response.set_cookie(
            self.name + connection.app.state.cookies, token, max_age=self.lasts_s if token else 0, httponly=True,
            samesite="none" if is_framed else self.samesite, secure=is_framed or is_secure(connection),
        )  # fmt: skip
        if is_framed:  # browsers keep it apart for each site that frames us; Starlette writes that from Python 3.14 on
            name, cookie = response.raw_headers[-1]
            response.raw_headers[-1] = name, cookie + b"; Partitioned"


PLAYER = Cookie(PLAYER_COOKIE, 2 * 365 * 24 * 3600, "lax")
PARTICIPANT = Cookie(PARTICIPANT_COOKIE, 2 * 365 * 24 * 3600, "lax")
ADMIN = Cookie(ADMIN_COOKIE, TOKEN_S, "strict")


def services_of(connection: HTTPConnection) -> Services:
    """Return the services of the server that a request or a websocket has reached."""
    services: Services = connection.app.state.services
    return services


async def close(websocket: WebSocket, code: int, reason: str) -> None:
    """Close a websocket and note the code for the log and the metrics."""
    websocket.scope["noted"]["status"] = code
    await websocket.close(code, reason)


def player_of(connection: HTTPConnection) -> str | None:
    """The player's id in a cookie of this server.

    None without a cookie, or when it was tampered with.
    """
    return services_of(connection).player_tokens.read(PLAYER.token(connection))


def participant_of(connection: HTTPConnection) -> str | None:
    """The id under which the asker takes part in studies.

    It is another one than the player's, linked to nothing played. None as for `player_of`.
    """
    return services_of(connection).player_tokens.read(PARTICIPANT.token(connection))


def asker_of(connection: HTTPConnection) -> Asker:
    """Who asks for a replay, and when by the server's clock."""
    return Asker(player_of(connection), services_of(connection).lobby.sources.clock_ms())


def owner_of(connection: HTTPConnection) -> str:
    """Whose turn it is when the asker's jobs take theirs.

    An address has one turn, whatever cookies come from it.
    """
    return client_address(connection)


def remember_player(
    response: Response, connection: HTTPConnection, player_id: str, cookie: Cookie = PLAYER
) -> None:
    """Set the player's cookie, or the participant's."""
    cookie.set(response, connection, services_of(connection).player_tokens.sign(player_id))


def is_operator(connection: HTTPConnection) -> bool:
    """Whether the operator asks; False on a server without an operator's page."""
    admin = services_of(connection).admin
    if admin is None:
        return False
    return admin.login.is_valid(ADMIN.token(connection))


def is_owner(connection: HTTPConnection, session: Session) -> bool:
    """Whether the asker is the player at whose screen the session runs.

    A cookie of theirs says so.
    """
    owner = services_of(connection).lobby.owner_of(session)
    return owner is not None and owner in (player_of(connection), participant_of(connection))


def may_control(connection: HTTPConnection, session: Session) -> bool:
    """Whether the asker may move the session, by their cookie and the id they know."""
    is_bearer = session.row.control == "bearer" and session.participation is None
    return is_bearer or is_owner(connection, session)


async def session_of(connection: HTTPConnection, session_id: str) -> Session:
    """The session that the asker sees and moves.

    Raises:
        UnknownSessionError: If it is not theirs.
    """
    session = await services_of(connection).lobby.get(session_id)
    if not may_control(connection, session):
        raise UnknownSessionError(session_id)
    return session
