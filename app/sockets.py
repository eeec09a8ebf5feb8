"""WS /ws/sessions/{id}: acts come in, frames go out, the newest always first.

The receiver answers each message; the sender follows the session's channel and compares what it has sent last with how
things stand, so a slow socket skips frames and never lags behind.
"""

from __future__ import annotations

import asyncio
import contextlib

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from app.lobby import Lobby, UnknownSession
from app.players import Players, has_own_origin
from app.protocol import Act, BadMessage, Pace, encode_error, encode_history, encode_refused, parse
from app.session import HUMAN, SCRIPT, Move, Refused, Session
from app.store import StoreError

UNKNOWN_SESSION = 4404
FOREIGN_ORIGIN = 4403

router = APIRouter()


@router.websocket("/ws/sessions/{session_id}")
async def play(websocket: WebSocket, session_id: str) -> None:
    """Serve one socket until it leaves."""
    if has_own_origin(websocket) is False:
        await websocket.close(FOREIGN_ORIGIN, "the Origin of this page is not this server's")
        return
    await websocket.accept()
    lobby: Lobby = websocket.app.state.lobby
    with contextlib.suppress(WebSocketDisconnect):
        try:
            session = await lobby.get(session_id)
        except UnknownSession as error:
            await websocket.send_text(encode_error(str(error)))
            await websocket.close(UNKNOWN_SESSION, "unknown session")
            return
        players: Players = websocket.app.state.players
        is_own = has_own_origin(websocket) is True and players.of(websocket) == session.row.player_id
        await Socket(websocket, session, is_own and session.row.player_id is not None).serve()


class Socket:
    """One connection to a session; `is_own` says that it is a page of ours with the session's own cookie."""

    def __init__(self, websocket: WebSocket, session: Session, is_own: bool) -> None:
        self._websocket, self._session, self._is_own = websocket, session, is_own

    async def serve(self) -> None:
        """Return when the socket has left."""
        sender = asyncio.create_task(self._send_newest())
        try:
            await self._receive()
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sender

    async def _send_newest(self) -> None:
        session, send = self._session, self._websocket.send_text
        frame, episode = "", ""
        pace: Pace | None = None
        fault: str | None = None
        with session.channel.follow() as follower:
            async for newest in follower:
                if newest is not frame:
                    frame = newest
                    await send(frame)
                if session.current.id != episode:
                    episode = session.current.id
                    await send(encode_history(episode, session.episode))
                if session.pace is not pace and session.pace is not None:
                    pace = session.pace
                    await send(pace.model_dump_json())
                if session.fault != fault:
                    fault = session.fault
                    if fault is not None:
                        await send(encode_error(fault))

    async def _receive(self) -> None:
        while True:
            message = await self._websocket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            if text is None:
                size = len(message.get("bytes") or b"")
                answer: str | None = encode_error(f"a message must be JSON in a text frame, got {size} binary bytes")
            else:
                answer = self._answer(text)
            if answer is not None:
                await self._websocket.send_text(answer)

    def _answer(self, text: str) -> str | None:
        """Return the answer to a message, None for an act that went through: its frame answers."""
        session = self._session
        try:
            message = parse(text)
            if isinstance(message, Act):
                session.act(as_move(message, self._driver(message)))
                return None
            return encode_history(session.current.id, session.episode)
        except Refused as refusal:
            return encode_refused(str(refusal), session.frame)
        except (BadMessage, StoreError) as error:
            return encode_error(str(error))

    def _driver(self, act: Act) -> str:
        return HUMAN if self._is_own and act.input is not None else SCRIPT


def as_move(act: Act, driver: str) -> Move:
    """Return the move a message asks for, whoever drives."""
    return Move(
        episode=act.episode,
        step=act.step,
        action=act.code,
        driver=driver,
        input=act.input,
        key_down_ms=act.key_down_ms,
        key_up_ms=act.key_up_ms,
        client_ms=act.client_ms,
    )
