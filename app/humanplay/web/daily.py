"""The daily terrain over HTTP: today's board and its results.

Once a day is over, anybody can check it.
"""

from __future__ import annotations

import asyncio
from contextlib import closing
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Depends, HTTPException, Path, Request, Response

from humanplay.db.reader import Reader
from humanplay.db.series import attempts_of, results
from humanplay.results.daily import DailyPlayedError
from humanplay.results.daily_table import (
    PeopleOfDay,
    calendar,
    describe_attempt,
    people_on,
    people_text,
    streak,
)
from humanplay.study.days import DailyTerrain, day_before
from humanplay.web.access import player_of, remember_player, services_of
from humanplay.web.answers.boards import GONE_ON_WITH, Board
from humanplay.web.answers.daily import Day as DayAnswer
from humanplay.web.answers.daily import Results, Today
from humanplay.web.api import session_summary
from humanplay.web.pages import page
from humanplay.web.protection import NO_CACHE, has_own_origin
from humanplay.web.services import Services
from humanplay.web.templates import addresses


async def _is_offered(request: Request) -> None:
    """Check that the server's task has a daily terrain.

    Raises:
        HTTPException: 404 otherwise.
    """
    if (task := services_of(request).lobby.task).boards is None:
        raise HTTPException(404, f"{task.about.title} has no daily terrain")


router = APIRouter(prefix="/api/daily", tags=["daily"], dependencies=[Depends(_is_offered)])
page_router = APIRouter(include_in_schema=False, dependencies=[Depends(_is_offered)])
_DAY = Path(pattern=r"^\d{4}-\d{2}-\d{2}$", description="a date in UTC", examples=["2026-11-22"])
Day = Annotated[str, _DAY]


@router.get("", response_model=Today, summary="Today's terrain, and my attempt at it")
async def get_today(request: Request) -> dict[str, object]:
    """Return the commitment to today's key, and by your cookie your attempt.

    Beside them stand when the next day begins, and yesterday's key. `commitment` is SHA-256 of the
    day's key. The key is shown when the day (UTC) is over, and the terrain follows from it.
    """
    services, player_id = services_of(request), player_of(request)
    terrain, store = await services.daily_boards.today(), services.store
    attempts = [] if player_id is None else await store.read(lambda: attempts_of(store, player_id))
    mine = next((attempt for attempt in attempts if attempt.day == terrain.day), None)
    ended = await store.read(lambda: results(store, terrain.series.name, terrain.ends_ms))
    return {
        **await describe_terrain(services, terrain),
        "now_ms": services.lobby.sources.clock_ms(),
        "next_ms": terrain.ends_ms,
        "max_steps": terrain.config.limit,
        "attempt": describe_attempt(mine, terrain),
        "players": len(ended),
        "streak": streak(attempts, terrain.day),
        "played": sum(attempt.ended_ms is not None for attempt in attempts),
        "calendar": calendar(attempts),
        "yesterday": await _earlier(services, day_before(terrain.day)),
    }


@router.post(
    "",
    status_code=201,
    response_model=Board,
    responses=GONE_ON_WITH,
    summary="Play today's terrain, once",
)
async def begin_today(request: Request, response: Response) -> dict[str, object]:
    """Begin your attempt, or go on with it (200).

    The answer is that of POST /api/sessions. 409 once the attempt is over. Only a page of this
    server may: the board belongs to the player's cookie.
    """
    if not has_own_origin(request):
        raise HTTPException(
            403,
            "the daily terrain is played on this server's page /daily; for a script there is POST /api/sessions",
        )
    services = services_of(request)
    player_id = player_of(request) or services.lobby.sources.player_id()
    try:
        session, was_open = await services.daily_boards.begin(player_id)
    except DailyPlayedError as error:
        raise HTTPException(409, str(error)) from error
    services.daily_policies.prepare(await services.daily_boards.today())
    response.status_code = 200 if was_open else 201
    remember_player(response, request, player_id)
    return await session_summary(services.lobby, session)


@router.get("/{day}", response_model=DayAnswer, summary="The terrain of a day")
async def get_day(request: Request, day: Day) -> dict[str, object]:
    """Return level, size and commitment.

    Once the day is over there are the key and the seed as well, from which anybody can draw the
    terrain.
    """
    services = services_of(request)
    return await describe_terrain(services, await _terrain_on(services, day))


@router.get(
    "/{day}/results",
    response_model=Results,
    response_model_exclude_unset=True,
    summary="People and policies on the terrain of a day",
)
async def get_results(request: Request, day: Day) -> dict[str, object]:
    """Return ranks and the distribution of moves.

    Those of today are for whoever has finished today's attempt: else 403. People are named nowhere,
    and episodes once the day is over. Results of policies come when they are ready.
    """
    services, player_id = services_of(request), player_of(request)
    terrain = await _terrain_on(services, day)
    is_over = day < services.daily_boards.day()
    mine = await services.daily_boards.attempt(player_id, day)
    if not is_over and (mine is None or mine.ended_ms is None):
        raise HTTPException(403, "the results of today are shown when your own attempt is over")
    people = await asyncio.to_thread(_people, services, terrain, player_id, is_over)
    attempt = describe_attempt(mine, terrain)
    policies = services.daily_policies.results(terrain)
    return {"day": day, "attempt": attempt, "people": people, "policies": policies}


@page_router.get("/daily/{day}")
async def day_page(request: Request, day: Day) -> Response:
    """Serve the daily page with the results of a day.

    Its preview shows the route of the first in the table once the day is over.
    """
    services = services_of(request)
    terrain = await _terrain_on(services, day)
    date = datetime.fromisoformat(day)
    context: dict[str, object] = {"title": f"The terrain of {date.day} {date:%B %Y}"}
    if day < services.daily_boards.day():
        people = await asyncio.to_thread(_people, services, terrain, None, True)
        context["description"] = people_text(people)
        if people["table"]:
            best = people["table"][0]["episode"]
            site = addresses(request)["site"]
            # with nobody at the goal, the first is who came furthest
            route = "The best route" if people["moves"] else "The route of who came furthest"
            context |= {"picture": f"{site}replay/{best}.png", "picture_alt": route}
    return page(request, "daily", NO_CACHE, **context)


async def describe_terrain(services: Services, terrain: DailyTerrain) -> dict[str, object]:
    """What anybody may know of a day's terrain now.

    `key` and `seed` are None before the day is over. `protocol` is the canonical JSON that the seed
    is drawn for, beside the key.
    """
    is_over = terrain.day < services.daily_boards.day()
    older, newer = await services.daily_boards.beside(terrain.day)
    return {
        "day": terrain.day,
        "level": terrain.config.level,
        "size": terrain.config.size,
        "protocol": terrain.series.protocol,
        "commitment": terrain.series.commitment,
        "key": terrain.series.secret if is_over else None,
        "seed": terrain.seed if is_over else None,
        "older": older,
        "newer": newer,
    }


async def _earlier(services: Services, day: str) -> dict[str, object] | None:
    terrain = await services.daily_boards.on(day)
    return None if terrain is None else await describe_terrain(services, terrain)


async def _terrain_on(services: Services, day: str) -> DailyTerrain:
    """The terrain of a day.

    Raises:
        HTTPException: 404 where there was none, or is none yet.
    """
    terrain = await services.daily_boards.on(day)
    if terrain is None:
        raise HTTPException(
            404, f"this server has shown no daily terrain on {day}; GET /api/daily has today's"
        )
    return terrain


def _people(
    services: Services, terrain: DailyTerrain, player_id: str | None, is_over: bool
) -> PeopleOfDay:
    with closing(Reader.open(services.store.path)) as reader:
        return people_on(reader, terrain, player_id, is_over)
