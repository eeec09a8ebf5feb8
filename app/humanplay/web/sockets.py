"""The play socket, /ws/sessions/{id}: acts arrive, and frames are sent.

Only the newest frame ever waits. The receiver answers each message. The sender subscribes to the
session's channel and compares what it has sent last with the session as it stands, so a slow socket
skips frames and never lags behind.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Coroutine
from functools import partial

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from humanplay.board.lobby import UnknownSessionError
from humanplay.board.messages import (
    Act,
    BadMessageError,
    ClockState,
    Events,
    EventsAnswer,
    Pace,
    RepeatProgress,
    encode_error,
    encode_refused,
    no_action,
    parse_message,
)
from humanplay.board.participation import HUMAN, SCRIPT, RefusedError, StudyUnavailableError
from humanplay.board.session import Move, Session
from humanplay.db.store import StoreError
from humanplay.task import Task
from humanplay.task.sentences import sentence_of
from humanplay.web.access import close, is_owner, services_of, session_of
from humanplay.web.protection import has_own_origin

UNKNOWN_SESSION = 4404
"""Close code of our own sockets for a session that the asker may not see."""

router = APIRouter()


async def serve_session(
    websocket: WebSocket,
    find: Callable[[], Awaitable[Session]],
    serve: Callable[[Session], Awaitable[None]],
) -> None:
    """Accept a socket and serve the session that it asks for.

    Where there is none, say so and close the socket.
    """
    await websocket.accept()
    with contextlib.suppress(WebSocketDisconnect):
        try:
            session = await find()
        except UnknownSessionError as error:
            await websocket.send_text(encode_error(str(error)))
            await close(websocket, UNKNOWN_SESSION, "unknown session")
            return
        await serve(session)


async def ignore_all(websocket: WebSocket) -> None:
    """Receive until the client leaves, and do nothing about it."""
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass


async def send_while(receiving: Awaitable[None], sending: Coroutine[object, object, None]) -> None:
    """Send for as long as messages are received."""
    sender = asyncio.create_task(sending)
    try:
        await receiving
    finally:
        sender.cancel()
        with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await sender


@router.websocket("/ws/sessions/{session_id}")
async def play_socket(websocket: WebSocket, session_id: str) -> None:
    """Serve one play socket until it leaves."""
    find = partial(session_of, websocket, session_id)
    await serve_session(websocket, find, lambda session: PlaySocket(websocket, session).serve())


class PlaySocket:
    """One connection to a session.

    It knows whether its player's cookie came with it, and whether our page opened it.
    """

    def __init__(self, websocket: WebSocket, session: Session) -> None:
        self._websocket, self._session = websocket, session
        self._player_id = session.row.player_id
        self._is_owner = is_owner(websocket, session)
        self._is_page = has_own_origin(websocket) is True
        self._keeping: asyncio.Task[None] | None = None
        """What tells that the newest input events are kept."""

    async def serve(self) -> None:
        """Send and receive until the socket leaves."""
        clock = self._session.clock if self._is_owner and self._is_page else None
        if clock is not None:
            clock.stand()  # a reload, a connection made anew, a second tab
        try:
            # in a task of its own, so that a message wakes the receiver alone and not all that
            # surrounds this call
            await send_while(asyncio.create_task(self._receive()), self._send_newest())
        finally:
            if clock is not None:
                clock.stand()
            if self._keeping is not None:
                await self._keeping

    async def _send_newest(self) -> None:
        session, send = self._session, self._websocket.send_text
        frame, episode = "", ""
        pace: Pace | None = None
        fault: str | None = None
        time: ClockState | None = None
        remade: RepeatProgress | None = None
        with session.channel.subscribe() as subscriber:
            async for newest in subscriber:
                if self._is_handed_over():
                    await close(self._websocket, UNKNOWN_SESSION, "the player went on elsewhere")
                    return
                if newest is not frame:
                    frame = newest
                    await send(frame)
                if session.current.id != episode:
                    episode = session.current.id
                    await send(session.history())
                if session.pace != pace and session.pace is not None:
                    pace = session.pace
                    await send(pace.model_dump_json())
                if session.clock is not None and session.clock.state is not time:
                    time = session.clock.state
                    await send(time.model_dump_json())
                if session.remade is not remade and (remade := session.remade) is not None:
                    await send(remade.model_dump_json())
                if session.fault != fault and (fault := session.fault) is not None:
                    await send(encode_error(fault))

    async def _receive(self) -> None:
        while True:
            message = await self._websocket.receive()
            if message["type"] == "websocket.disconnect" or self._is_handed_over():
                return
            text = message.get("text")
            if text is None:
                size = len(message.get("bytes") or b"")
                answer: str | None = encode_error(
                    f"a message must be JSON in a text frame, got {size} binary bytes"
                )
            else:
                answer = await self._answer(text)
            if answer is not None:
                await self._tell(answer)

    async def _answer(self, text: str) -> str | None:
        """The answer to a message.

        An act waits until it is recorded, and so does what this socket sends after it. Events are
        answered once they are recorded, in their order; the act that follows them waits for that no
        longer than its own record does.

        Returns:
            None for an act that was made, since its frame is the answer, and for events.
        """
        session = self._session
        try:
            message = parse_message(text)
            if isinstance(message, Events):
                if self._keeping is not None:
                    await self._keeping
                self._keeping = asyncio.create_task(self._tell_kept(message))
                await asyncio.sleep(0)  # it begins before the act that follows
                return None
            if isinstance(message, Act):
                move = as_move(message, session.task, self._driver(message))
                await session.act(move, lambda text: self._tell(encode_error(text)))
                return None
            return session.history()
        except RefusedError as refusal:
            self._count_refusal("not_current")
            return encode_refused(str(refusal), session.frame)
        except (BadMessageError, PermissionError, StoreError) as error:
            self._count_refusal("not_written" if isinstance(error, StoreError) else "bad_message")
            return encode_error(sentence_of(error))

    def _is_handed_over(self) -> bool:
        """Whether the board is another cookie's since this socket joined it."""
        return self._session.row.player_id != self._player_id

    def _driver(self, act: Act) -> str:
        """Whether a person made an act: "human" or "script".

        A person's is a trusted key or touch on the owner's own page.
        """
        participation = self._session.participation
        is_human = (
            self._is_owner
            and self._is_page
            and act.input is not None
            and self._session.inputs.is_persons
            and (participation is None or participation.driver == HUMAN)
        )
        return HUMAN if is_human else SCRIPT

    async def _tell(self, message: str) -> None:
        """Send a message to whoever is still there.

        Of whoever has gone, what they had sent counts still.
        """
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            await self._websocket.send_text(message)

    async def _tell_kept(self, events: Events) -> None:
        await self._tell((await self._keep(events)).model_dump_json())

    async def _keep(self, events: Events) -> EventsAnswer:
        """Store input events.

        Returns:
            How many are kept: all, none for a reason, or none for now.
        """
        try:
            if not (self._is_owner and self._is_page):
                raise RefusedError(
                    "input events are kept of the board's own player, on this server's page, and of nobody else"
                )
            await self._session.keep_events(events)
        except (StudyUnavailableError, StoreError):
            return EventsAnswer(episode=events.episode, count=0)
        except RefusedError as refusal:
            return EventsAnswer(episode=events.episode, count=0, reason=str(refusal))
        return EventsAnswer(episode=events.episode, count=len(events.events))

    def _count_refusal(self, reason: str) -> None:
        services_of(self._websocket).store.metrics.count_refusal(reason)


def as_move(act: Act, task: Task, driver: str) -> Move:
    """The move of a task that a message asks for, made by `driver`.

    Raises:
        BadMessageError: If it is none.
    """
    if act.action not in task.actions:
        raise no_action(task.actions, act.action)
    fields = act.model_dump(exclude={"kind", "action"})
    return Move(**fields, action=task.actions.index(act.action), driver=driver)
