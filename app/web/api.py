"""The HTTP API: what the page uses, and anyone's script as well. `/docs` shows it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Annotated, Any, Literal

from fastapi import APIRouter, HTTPException, Query, Request, Response
from fastapi.responses import StreamingResponse

from app.play.lobby import Lobby
from app.play.messages import Act, ChangePace, Frame, History, NewEpisode, NewSession, Pace, encode_history
from app.play.session import SCRIPT, RefusedError, Session
from app.statistics.human_level import human_level
from app.storage.export import rows
from app.storage.reader import Reader
from app.web.access import enter
from app.web.sockets import as_move
from marsexplorer.config import CORE_VERSION, LEVELS

router = APIRouter(prefix="/api")
Who = Literal["all", "human"]
_FRAME: dict[int | str, dict[str, Any]] = {200: {"model": Frame}}


def _lobby(request: Request) -> Lobby:
    lobby: Lobby = request.app.state.lobby
    return lobby


def _json(text: str, status: int = 200) -> Response:
    return Response(text, status, media_type="application/json", headers={"Cache-Control": "no-store"})


@contextmanager
def _bad_input() -> Iterator[None]:
    """Answer 422 where what was asked for cannot be: an unknown policy, a level without a solvable terrain."""
    try:
        yield
    except ValueError as error:
        raise HTTPException(422, str(error)) from error


@contextmanager
def _reader(request: Request) -> Iterator[Reader]:
    """Return a read-only connection for one request: long queries run in a thread and hold no move up."""
    with closing(Reader.open(request.app.state.store.path, public=True)) as reader:
        yield reader


def _not_seated(session: Session, what: str, instead: str) -> Session:
    """Return the session; 409 when it is a participant's of a study, which has its own way."""
    if session.participation is not None:
        raise HTTPException(409, f"this board is a participant's of a study: {what}; {instead}")
    return session


def about(lobby: Lobby, session: Session) -> dict[str, Any]:
    """Return what a page needs to show a session: its driver, its configuration, its frame and its rival."""
    rival, config = lobby.rival_of(session), session.current.config
    return {
        "session": session.id,
        "player": session.row.driver_name,
        "level": config.level,
        "size": config.rows if config.rows == config.cols else [config.rows, config.cols],
        "counts": _counts(lobby, session),
        "frame": json.loads(session.frame),
        "rival": rival
        and {
            "session": rival.id,
            "policy": rival.row.driver_name,
            "pace": rival.pace and rival.pace.model_dump(),
            "frame": json.loads(rival.frame),
        },
    }


def _counts(lobby: Lobby, session: Session) -> bool:
    """Return what the store says of a finished episode, and what can be said of a running one."""
    finished = lobby.store.episode(session.current.id) if session.episode.ended else None
    return session.counts if finished is None else bool(finished["counts"])


@router.get("/health", tags=["server"], summary="Is the server well?")
async def health(request: Request) -> dict[str, Any]:
    """The core version fixes what a recorded episode replays to; `sessions` are those in memory."""
    database = request.app.state.store.path.name
    return {"status": "ok", "core_version": CORE_VERSION, "sessions": len(_lobby(request)), "database": database}


@router.get("/levels", tags=["server"], summary="What can be played")
async def levels() -> list[dict[str, Any]]:
    """`random` is the paper's section 3.2, `t-m-b` the twelve of section 3.3."""
    return [
        {
            "name": level.name,
            "summary": level.summary,
            "topology": level.topology,
            "morphology": level.morphology,
            "pays_bonus": level.pays_bonus,
        }
        for level in LEVELS.values()
    ]


@router.get("/policies", tags=["server"], summary="Who can be watched, or played beside")
async def policies(request: Request) -> list[dict[str, str]]:
    """Each name can be given as `player` or as `rival`."""
    return [{"name": offer.name, "summary": offer.summary} for offer in _lobby(request).policies.offers()]


@router.post("/sessions", status_code=201, tags=["play"], summary="Begin a session")
async def create_session(request: Request, response: Response, wanted: NewSession | None = None) -> dict[str, Any]:
    """All fields are optional; an empty body begins a 21x21 `random` board for you, without a rival.

    `session` in the answer is unguessable: whoever knows it can watch and drive. `frame.episode` and `frame.step` go
    into the first act. A player cookie is set when you bring none. `counts` says whether the episode counts for the
    human score so far: acts over HTTP are a script's and never do.
    """
    lobby, players = _lobby(request), request.app.state.players
    player_id = players.of(request) or lobby.sources.player_id()
    with _bad_input():
        session = await lobby.create(wanted or NewSession(), player_id)
    players.remember(response, request, player_id)
    return about(lobby, session)


@router.get("/sessions/{session_id}", tags=["play"], summary="The current frame", responses=_FRAME)
async def get_frame(request: Request, session_id: str) -> Response:
    """The same bytes as the session's socket sends."""
    return _json((await enter(request, session_id)).frame)


@router.get("/sessions/{session_id}/about", tags=["play"], summary="What POST answered, as it stands now")
async def get_about(request: Request, session_id: str) -> dict[str, Any]:
    """A page that was reloaded begins here."""
    session = await enter(request, session_id)
    return about(_lobby(request), session)


@router.get("/sessions/{session_id}/history", tags=["play"], summary="The path so far", responses={200: {"model": History}})
async def get_history(request: Request, session_id: str) -> Response:
    """Positions and discovered cells per step, the start first."""
    session = await enter(request, session_id)
    return _json(encode_history(session.current.id, session.episode))


_ACT_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {"model": Frame},
    409: {"description": 'not the current frame: `{"detail", "frame"}`, and nothing has changed'},
}


@router.post("/sessions/{session_id}/act", tags=["play"], summary="Make one move", responses=_ACT_ANSWERS)
async def act(request: Request, session_id: str, wanted: Act) -> Response:
    """The move must answer the current frame: its `episode` and its `step`.

    When it does not, 409 brings the current frame and nothing changes, so a repeat after a lost answer is harmless.
    """
    found = await enter(request, session_id)
    session = _not_seated(found, "its moves come over the socket", "open /ws/sessions/{id}")
    try:
        session.act(as_move(wanted, SCRIPT))
    except RefusedError as refusal:
        return _json(f'{{"detail":{json.dumps(str(refusal))},"frame":{session.frame}}}', 409)
    return _json(session.frame)


@router.post("/sessions/{session_id}/episodes", status_code=201, tags=["play"], summary="Begin the next episode")
async def create_episode(request: Request, session_id: str, wanted: NewEpisode | None = None) -> dict[str, Any]:
    """One still running is abandoned: it counts at its return so far minus `r_invalid`. A rival begins anew as well."""
    lobby = _lobby(request)
    found = await enter(request, session_id)
    session = _not_seated(found, "its terrains are the study's", "POST /api/studies/{name}/next begins the next episode")
    with _bad_input():
        await lobby.restart(session, wanted or NewEpisode())
    return about(lobby, session)


@router.post("/sessions/{session_id}/pace", tags=["play"], summary="Change how a policy moves")
async def change_pace(request: Request, session_id: str, wanted: ChangePace) -> Pace:
    """For a session that a policy drives: exactly one of `moves_per_second`, `pause`, `step`, `follow` (rivals only)."""
    session = _not_seated(await enter(request, session_id), "it has no pace and no rival", "its participant moves it")
    with _bad_input():
        return _lobby(request).change_pace(session, wanted)


@router.get("/human-level", tags=["results"], summary="How well people play")
def get_human_level(request: Request) -> dict[str, Any]:
    """Unassisted episodes on terrains neither chosen nor met before, one figure per configuration."""
    with _reader(request) as reader:
        return human_level(reader)


@router.get("/episodes", tags=["results"], summary="Finished episodes")
def get_episodes(
    request: Request,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    offset: Annotated[int, Query(ge=0, le=2**53)] = 0,
    who: Who = "all",
) -> list[dict[str, Any]]:
    """`who=human` gives those that count for the human score."""
    with _reader(request) as reader:
        return reader.episodes(limit, offset, who)


@router.get("/episodes/{episode_id}", tags=["results"], summary="One finished episode: seed, actions, times")
def get_episode(request: Request, episode_id: str) -> dict[str, Any]:
    """404 while it runs: its seed would tell the terrain."""
    with _reader(request) as reader:
        found = reader.episode(episode_id)
    if found is None:
        raise HTTPException(404, f"no finished episode {episode_id!r}; GET /api/episodes lists them")
    return found


@router.get("/export/{table}.{fmt}", tags=["results"], summary="Everything finished, as CSV or JSON Lines")
async def export(
    request: Request, table: Literal["episodes", "steps"], fmt: Literal["csv", "jsonl"], who: Who = "all"
) -> StreamingResponse:
    """Pseudonymous; `who=human` gives the counted ones."""
    kind = "text/csv; charset=utf-8" if fmt == "csv" else "application/jsonl"
    headers = {"Content-Disposition": f'attachment; filename="{table}.{fmt}"', "Cache-Control": "no-store"}
    pieces = rows(request.app.state.store, table, fmt, who, public=True)
    return StreamingResponse(pieces, media_type=kind, headers=headers)
