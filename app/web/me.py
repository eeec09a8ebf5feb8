"""A player's own episodes over HTTP: by their cookie alone, so nobody sees anybody else's."""

from __future__ import annotations

from contextlib import closing
from typing import Annotated, Any, Literal

from fastapi import APIRouter, HTTPException, Query, Request
from fastapi.responses import Response

from app.statistics.personal import describe_own, personal_bests
from app.storage.export import write_own_table
from app.storage.reader import Reader
from app.web.access import player_of, services_of
from app.web.downloads import send_made

router = APIRouter(prefix="/api/me", tags=["me"])


@router.get("/history", summary="My own episodes and bests")
def get_history(
    request: Request,
    limit: Annotated[int, Query(ge=1, le=1000)] = 50,
    offset: Annotated[int, Query(ge=0, le=2**53)] = 0,
) -> dict[str, Any]:
    """Return what you have driven, the newest first, and per configuration your best and your place among the volunteers.

    By your cookie alone; without one everything is empty. Episodes of open studies are left out.
    """
    player_id = player_of(request)
    if player_id is None:
        return {"total": 0, "episodes": [], "bests": []}
    with closing(Reader.open(services_of(request).store.path, public=True)) as reader:
        rows = reader.played_by(player_id)
        bests = personal_bests(reader, rows)
    return {
        "total": len(rows),
        "episodes": [describe_own(row) for row in rows[offset : offset + limit]],
        "bests": bests,
    }


@router.get("/export/{table}.csv", summary="My own episodes, as CSV")
async def export(request: Request, table: Literal["episodes", "steps"]) -> Response:
    """Export what you have driven, by your cookie alone; 404 without one."""
    player_id = player_of(request)
    if player_id is None:
        raise HTTPException(
            404, "this browser has no player's cookie: nothing was played with it; play at / first"
        )
    database = services_of(request).store.path
    return await send_made(request, f"my-{table}.csv", write_own_table, database, table, player_id)
