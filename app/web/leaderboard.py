"""What the page /leaderboard asks for."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, HTTPException, Request

from app.leaderboard.leaderboard import UnknownEntryError
from app.web.access import services_of

router = APIRouter(prefix="/api/leaderboard", tags=["results"])


@router.get("", summary="What people and policies are compared on")
async def get_boards(request: Request) -> list[dict[str, Any]]:
    """List one entry per closed study and per configuration; what people have played stands first."""
    services = services_of(request)
    await services.progress.note_all_closed()
    return [entry.to_dict() for entry in await services.leaderboard.newest_entries()]


@router.get("/{board}", summary="People, policies and rules on one scale")
async def get_board(request: Request, board: str) -> dict[str, Any]:
    """Return means with 95 % intervals: people's over players, policies' over held-out terrains.

    Policies are evaluated in the background when they are first asked for; until then `state` is waiting or computing, and
    `figure` is null.
    """
    try:
        return await services_of(request).leaderboard.detail(board)
    except UnknownEntryError as error:
        raise HTTPException(404, str(error)) from error
