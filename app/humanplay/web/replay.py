"""Replays over HTTP: the page, files to keep, and a policy's course.

A preview of the link shows a picture.
"""

from __future__ import annotations

from functools import partial
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, HTTPException, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from humanplay.db.names import challengers
from humanplay.db.playground import watchable_session
from humanplay.web.access import asker_of, owner_of, services_of
from humanplay.web.answers.base import Course, file_of
from humanplay.web.answers.people import Challenger
from humanplay.web.answers.replays import Replay
from humanplay.web.errors import bad_input
from humanplay.web.pages import page, waiting_page
from humanplay.web.protection import SHARED
from humanplay.web.replays.episodes import UnknownReplayError
from humanplay.web.replays.files import MEDIA_TYPES, Format, offered
from humanplay.web.replays.page import render
from humanplay.web.templates import absolute_address, addresses

FILES = file_of(*MEDIA_TYPES.values(), meaning="the replay")
router = APIRouter()
PolicyName = Annotated[str, Query(max_length=200)]
NO_GHOST = "none"
"""The name of a ghost that says that no policy is to be shown."""


@router.get(
    "/api/episodes/{episode_id}/replay",
    response_model=Replay,
    response_model_exclude_unset=True,
    tags=["results"],
    summary="The course of a finished episode",
)
async def get_replay(request: Request, episode_id: str) -> dict[str, object]:
    """Return what the episode's replay shows after each move.

    404 as for the episode.
    """
    with bad_input():
        replays, owner = services_of(request).replays, owner_of(request)
        return (await replays.replay(episode_id, asker_of(request), owner)).document()


@router.get(
    "/api/episodes/{episode_id}/ghost",
    response_model=Course,
    tags=["results"],
    summary="A policy on the terrain of a finished episode",
)
async def get_ghost(
    request: Request, episode_id: str, policy: PolicyName | None = None
) -> dict[str, object]:
    """Return the course of a policy from the same start on the same terrain.

    Without `policy` it is the usual one. 404 as for the replay.
    """
    asker, owner, replays = asker_of(request), owner_of(request), services_of(request).replays
    with bad_input():
        chosen = policy or (await replays.replay(episode_id, asker, owner)).preferred
        if chosen is None:
            raise HTTPException(
                404, "no policy on offer plays boards of this size; GET /api/policies lists them"
            )
        course = await replays.ghost(episode_id, chosen, asker, owner)
        return course.to_dict()


@router.get(
    "/replay/{episode_id}.{form}",
    response_class=Response,
    responses=FILES,
    tags=["results"],
    summary="A replay as a page in one file, a GIF, an MP4 or a picture",
)
async def replay_file(
    request: Request, episode_id: str, form: Format, ghost: PolicyName | None = None
) -> Response:
    """Return a replay as a file, with the policy that `ghost` names beside it.

    Without `ghost` it is the usual policy, and none for "none". The page holds everything that it
    needs and opens from a disk without a network. The picture shows the end, and no policy. 404 as
    for the episode, and for an MP4 where the server cannot make one.
    """
    asker, owner, replays = asker_of(request), owner_of(request), services_of(request).replays
    with bad_input():
        chosen = ghost or (await replays.replay(episode_id, asker, owner)).preferred
        beside = None if chosen == NO_GHOST or form == "png" else chosen
        content = await replays.file(episode_id, form, beside, asker, owner)
    # the page would not run here: the server's own policy for scripts forbids those inside a page
    kind = "attachment" if form == "html" else "inline"
    name = f"humanplay-{quote(episode_id)}.{form}"
    headers = {"Content-Disposition": f'{kind}; filename="{name}"', **SHARED}
    return Response(content, media_type=MEDIA_TYPES[form], headers=headers)


@router.get(
    "/api/episodes/{episode_id}/challengers",
    response_model=list[Challenger],
    tags=["results"],
    summary="Who took up the challenge of an episode",
)
async def get_challengers(request: Request, episode_id: str) -> list[dict[str, object]]:
    """List who succeeded on its terrain when challenged to it, the fewest moves first.

    404 as for the replay.
    """
    services, replays = services_of(request), services_of(request).replays
    with bad_input():
        await replays.replay(episode_id, asker_of(request), owner_of(request))
    store, successes = services.store, services.lobby.task.successes
    people = await store.read(partial(challengers, store, episode_id, successes))
    return [person._asdict() for person in people]


@router.get("/challenge/{episode_id}.png", include_in_schema=False)
async def challenge_picture(request: Request, episode_id: str) -> Response:
    """Return what is seen before the first move, for a preview of the link.

    404 as for the replay.
    """
    asker, owner = asker_of(request), owner_of(request)
    with bad_input():
        content = await services_of(request).replays.challenge(episode_id, asker, owner)
    return Response(content, media_type=MEDIA_TYPES["png"], headers=SHARED)


@router.get("/challenge/{episode_id}", include_in_schema=False)
async def challenge_page(request: Request, episode_id: str) -> Response:
    """Serve the page that challenges to an episode; it begins no board.

    404 as for its replay.
    """
    asker, owner = asker_of(request), owner_of(request)
    with bad_input():
        replay = await services_of(request).replays.replay_soon(episode_id, asker, owner)
    if replay is None:
        return waiting_page(request)
    return page(request, "challenge", headline=replay.course.challenge)


@router.get("/replay/{episode_id}", include_in_schema=False)
async def replay_page(request: Request, episode_id: str) -> Response:
    """Serve the page of a replay.

    It leads to the live view where the episode of somebody on the playground still runs, and says so
    while the episode is played again.
    """
    asker = asker_of(request)
    try:
        with bad_input():
            replays, owner = services_of(request).replays, owner_of(request)
            replay = await replays.replay_soon(episode_id, asker, owner)
    except UnknownReplayError:
        services = services_of(request)
        store, now = services.store, services.lobby.sources.clock_ms()
        find = partial(watchable_session, store, episode_id, now, asker.player_id)
        watchable = await store.read(find)
        if watchable is not None and not watchable[1]:
            return RedirectResponse(f"../watch/{episode_id}", 303)
        raise
    if replay is None:
        return waiting_page(request)
    rendered = render(
        replay.document(),
        replay.course,
        addresses(request),
        offered(),
        absolute_address(request),
    )
    return HTMLResponse(rendered)
