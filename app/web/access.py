"""Who may see a session: anybody who knows its id, but a study's board only its participant, and the operator."""

from __future__ import annotations

from starlette.requests import HTTPConnection

from app.play.lobby import Lobby, UnknownSessionError
from app.play.session import Session


async def enter(connection: HTTPConnection, session_id: str) -> Session:
    """Return the session that is asked for; UnknownSessionError when there is none that is the asker's to see."""
    lobby: Lobby = connection.app.state.lobby
    session = await lobby.get(session_id)
    if session.participation is None or owns(connection, session) or connection.app.state.is_admin(connection):
        return session
    raise UnknownSessionError(session_id)


def owns(connection: HTTPConnection, session: Session) -> bool:
    """Return whether the asker's cookie is that of the session's player."""
    player_id: str | None = connection.app.state.players.of(connection)
    return player_id is not None and player_id == session.row.player_id
