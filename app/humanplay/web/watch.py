"""Watching a board or an episode, over HTTP and over a socket.

It is for anybody who has the link, and nothing but watching.
"""

from __future__ import annotations

import contextlib
from collections.abc import AsyncGenerator

from fastapi import APIRouter, Request, WebSocket
from fastapi.responses import RedirectResponse, Response

from humanplay.board.messages import encode_error
from humanplay.board.spectators import UnwatchableError
from humanplay.web.access import asker_of, close, owner_of, player_of, services_of
from humanplay.web.answers.results import Watched
from humanplay.web.pages import page
from humanplay.web.sockets import UNKNOWN_SESSION, ignore_all, send_while

router = APIRouter()


@router.get(
    "/api/watch/{watch_id}",
    response_model=Watched,
    tags=["play"],
    summary="Watch a board of the playground",
)
async def get_watched(request: Request, watch_id: str) -> dict[str, object]:
    """Return the episode on a board: the newest frame and the path so far.

    Once it has ended there is every frame. `watch_id` is the board's `watch` in the answer of POST
    /api/sessions. The id of an episode shows that episode alone.

    `player` is "you", "human", "script" or a policy's name. Episodes of studies cannot be watched,
    and one of a daily terrain only by its own player before the day is over.
    """
    asked = watch_id, owner_of(request), player_of(request)
    return await services_of(request).spectators.describe(*asked)


@router.get("/watch/{watch_id}", include_in_schema=False)
async def watch_page(request: Request, watch_id: str) -> Response:
    """Serve the live view of a board or an episode; 404 for an id that shows nothing.

    The id of an episode that has ended leads to its replay; a board's goes on with the next
    episode.
    """
    services, asker = services_of(request), asker_of(request)
    if await services.replays.has(watch_id, asker):
        return RedirectResponse(f"../replay/{watch_id}", 303)
    await services.spectators.watched_episode(watch_id, asker.player_id)
    return page(request, "watch")


@router.websocket("/ws/watch/{watch_id}")
async def watch_socket(websocket: WebSocket, watch_id: str) -> None:
    """Send a board's frames as they come, or an episode's until it has ended.

    What the spectator sends is ignored.
    """
    await websocket.accept()
    asked = watch_id, owner_of(websocket), player_of(websocket)
    messages = services_of(websocket).spectators.messages(*asked)
    await send_while(ignore_all(websocket), _send(websocket, messages))


async def _send(websocket: WebSocket, messages: AsyncGenerator[str, None]) -> None:
    """Send each message, then close the socket."""
    async with contextlib.aclosing(messages):
        try:
            async for message in messages:
                await websocket.send_text(message)
        except UnwatchableError as error:
            await websocket.send_text(encode_error(str(error)))
            await close(websocket, UNKNOWN_SESSION, "unknown episode")
            return
    await close(websocket, 1000, "the episode has ended")
