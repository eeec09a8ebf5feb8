"""The HTTP API for playing, for the page and for any script.

`/docs` describes it.
"""

import json
from functools import lru_cache
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query, Request, Response

from humanplay.board.lobby import Lobby
from humanplay.board.messages import Act, ChangePace, Pace
from humanplay.board.participation import SCRIPT, RefusedError
from humanplay.board.session import Session
from humanplay.task import GETTING_READY, Messages, describe
from humanplay.web.access import (
    is_owner,
    player_of,
    remember_player,
    services_of,
    session_of,
)
from humanplay.web.answers.base import Problem
from humanplay.web.answers.boards import GONE_ON_WITH, Board, NotCurrent
from humanplay.web.answers.server import Alive, Health, Level, Map, Offer, Task
from humanplay.web.errors import bad_input
from humanplay.web.protection import has_own_origin
from humanplay.web.sockets import as_move

router = APIRouter(prefix="/api")
probes = APIRouter(tags=["server"])
"""Whether the server is alive, and whether it can record a move, for whatever watches over it."""
Id = Annotated[str | None, Query(max_length=128)]


def _lobby(request: Request) -> Lobby:
    return services_of(request).lobby


def _json(text: str, status: int = 200) -> Response:
    headers = {"Cache-Control": "no-store"}
    return Response(text, status, media_type="application/json", headers=headers)


def _check_no_study(session: Session, reason: str, instead: str) -> None:
    """Check that a board is no participant's: a study has its own calls.

    Args:
        reason: Why the call is not for such a board.
        instead: What to do instead.

    Raises:
        HTTPException: 409 for a participant's board.
    """
    if session.participation is not None:
        raise HTTPException(409, f"this board is a participant's of a study: {reason}; {instead}")


async def session_summary(lobby: Lobby, session: Session) -> dict[str, object]:
    """What a page needs to show a session.

    That is its driver, its configuration, its frame and its rival's.
    """
    rival, current, store = lobby.rival_of(session), session.current, lobby.store
    pace = None if rival is None or rival.pace is None else rival.pace.model_dump()
    finished = await store.read(lambda: store.episode(current.id)) if session.shown.ended else None
    # a forger in a study may not learn which move did not fit
    attested = None if session.participation is not None else finished
    return {
        "session": session.id,
        "kind": session.kind,
        "challenges": session.row.challenges,
        "player": session.row.driver_name,
        "task": describe(lobby.task),
        **lobby.task.describe(current),
        "daily": current.day,
        "counts": session.counts if finished is None else bool(finished["counts"]),
        "attestation": attested and attested["attestation"],
        "not_attested": attested and attested["attestation_reason"],
        "watch": None if session.participation is not None else lobby.watch_ids.of(session.id),
        "frame": json.loads(session.frame),
        "rival": rival and {
            "session": rival.id, "policy": rival.row.driver_name, "pace": pace, "frame": json.loads(rival.frame),
        },
    }  # fmt: skip


@router.get(
    "/health",
    response_model=Health,
    response_model_exclude_unset=True,
    tags=["server"],
    summary="Is the server well?",
)
async def health(request: Request) -> dict[str, object]:
    """Report the core version, and how many sessions are in memory.

    The core version fixes what a recorded episode replays to.

    `getting_ready` says why a board that was asked for takes longer than a moment on a fresh
    machine; null otherwise.

    Like /healthz it says that the server is alive, with what a page shows; /readyz says whether
    moves are recorded. `status` is "failing", with the reason under `detail`, while the database is
    not where it was opened.
    """
    lobby, store = _lobby(request), services_of(request).store
    fault = store.fault
    return {
        **({"status": "ok"} if fault is None else {"status": "failing", "detail": fault}),
        "getting_ready": GETTING_READY if lobby.task.is_getting_ready() else None,
        "core_version": lobby.task.version,
        "sessions": len(lobby),
        "database": store.path.name,
    }


@probes.get("/healthz", response_model=Alive, summary="Is the server alive?")
async def healthz() -> dict[str, str]:
    """Answer 200 for as long as requests are answered at all, whatever the disk does."""
    return {"status": "ok"}


@probes.get(
    "/readyz",
    response_model=Alive,
    summary="Can the server record a move?",
    responses={503: {"description": "no: `detail` says why"}},
)
async def readyz(request: Request) -> dict[str, str]:
    """Commit a row to the database and answer 200.

    503 with the reason when that fails or takes more than a second, and where the check beside play
    has found damage.
    """
    services_of(request).store.check_recording()
    services_of(request).health.check_whole()
    await services_of(request).health.try_write()
    return {"status": "ok"}


@router.get("/task", response_model=Task, tags=["server"], summary="What is played here")
async def task(request: Request) -> dict[str, object]:
    """Return how it is called, drawn and measured, and how it is played.

    Its actions come by their codes, with the keys that pages begin with.
    """
    return describe(_lobby(request).task)


@router.get("/levels", response_model=list[Level], tags=["server"], summary="What can be played")
async def levels(request: Request) -> list[dict[str, object]]:
    """List the levels, for an environment that has them.

    Each name can be given as `level`.
    """
    return _lobby(request).task.levels()


@router.get(
    "/maps", response_model=list[Map], tags=["server"], summary="The maps that can be played"
)
async def maps(request: Request) -> list[dict[str, object]]:
    """List the maps that the server was started with (`serve --map`).

    Each name can be given as `map`, instead of a level.
    """
    return _lobby(request).task.maps()


@router.get(
    "/policies",
    response_model=list[Offer],
    tags=["server"],
    summary="The policies that can be watched or played against",
)
async def policies(request: Request) -> list[dict[str, str]]:
    """List the policies; each name can be given as `player` or as `rival`."""
    offers = _lobby(request).task.policies.offers()
    return [{"name": offer.name, "summary": offer.summary} for offer in offers]


@router.get(
    "/me/session",
    response_model=Board | None,
    tags=["play"],
    summary="The board that my page goes on with",
)
async def get_my_session(
    request: Request, watch: Id = None, episode: Id = None
) -> dict[str, object] | None:
    """Return your open ranked board, else your newest one, by your cookie alone.

    The answer is that of POST /api/sessions. `watch` asks for the board of that id for watching,
    `episode` for the one on which that episode is the current one. Null when there is no such board
    of yours.
    """
    player_id = player_of(request)
    if player_id is None:
        return None
    boards, link = services_of(request).page_boards, watch or episode
    session = await (boards.with_link(player_id, link) if link else boards.newest(player_id))
    return None if session is None else await session_summary(_lobby(request), session)


@router.get(
    "/sessions/{session_id}/about",
    response_model=Board,
    tags=["play"],
    summary="The session as it stands now",
)
async def get_about(request: Request, session_id: str) -> dict[str, object]:
    """Return what POST /api/sessions returned, as it stands now.

    A page that was reloaded begins here.
    """
    session = await session_of(request, session_id)
    return await session_summary(_lobby(request), session)


@router.post("/sessions/{session_id}/pace", tags=["play"], summary="Change how a policy moves")
async def change_pace(request: Request, session_id: str, wanted: ChangePace) -> Pace:
    """Set how a policy moves: exactly one of the fields.

    They are `moves_per_second`, `pause`, `step` and `follow` (rivals only).
    """
    session = await session_of(request, session_id)
    _check_no_study(session, "it has no pace and no rival", "its participant moves it")
    with bad_input():
        return await _lobby(request).change_pace(session, wanted)


@lru_cache(maxsize=8)
def board_router(messages: Messages) -> APIRouter:
    """The calls in which a task's own messages stand.

    They are what begins a board or an episode, and its frames and paths.
    """
    router = APIRouter(prefix="/api")
    frame: dict[int | str, dict[str, Any]] = {200: {"model": messages.frame}}
    path: dict[int | str, dict[str, Any]] = {200: {"model": messages.history}}
    stale = "not the current frame, or a participant's board; nothing has changed"
    act_answers = {**frame, 409: {"model": NotCurrent | Problem, "description": stale}}

    @router.post(
        "/sessions",
        status_code=201,
        response_model=Board,
        responses=GONE_ON_WITH,
        tags=["play"],
        summary="Begin a session",
    )
    async def create_session(
        request: Request,
        response: Response,
        wanted: messages.board | None = None,  # type: ignore[name-defined]
    ) -> dict[str, object]:
        """Begin a board.

        All fields are optional; an empty body begins the server's usual board for you, without a
        rival.

        `session` in the answer cannot be guessed: whoever knows it can watch and drive.
        `frame.episode` and `frame.step` go into the first act. A player cookie is set when you send
        none. Moves on such a board are a script's and never count.

        `kind` is ranked, practice, challenge, watch, daily or study: what the episode is.
        `challenges` makes it a challenge.

        Whoever has `watch` can watch the board at /watch/{watch}, one episode after the other, and
        do nothing else.

        A page of this server sends its Origin, and the board then belongs to the player's cookie
        alone. `counts` says whether the episode counts for the volunteers' figure so far. Instead
        of a second ranked board the page gets the open one: 200.
        """
        wanted = wanted or messages.board()
        player_id = player_of(request) or _lobby(request).sources.player_id()
        with bad_input():
            terrain = await _lobby(request).first_terrain(wanted)
            await services_of(request).daily_boards.check_seed(terrain.config, terrain.seed)
            if wanted.replays is not None:
                await session_of(request, wanted.replays)
            if has_own_origin(request):
                session, was_open = await services_of(request).page_boards.begin(wanted, player_id)
                response.status_code = 200 if was_open else 201
            else:
                session = await _lobby(request).create(wanted, player_id)
        remember_player(response, request, player_id)
        return await session_summary(_lobby(request), session)

    @router.get(
        "/sessions/{session_id}", tags=["play"], summary="The current frame", responses=frame
    )
    async def get_frame(request: Request, session_id: str) -> Response:
        """Return the same bytes that the session's socket sends."""
        return _json((await session_of(request, session_id)).frame)

    @router.get(
        "/sessions/{session_id}/history", tags=["play"], summary="The path so far", responses=path
    )
    async def get_history(request: Request, session_id: str) -> Response:
        """Return what was known at the start and after each move, as the world has it."""
        return _json((await session_of(request, session_id)).history())

    @router.post(
        "/sessions/{session_id}/act", tags=["play"], summary="Make one move", responses=act_answers
    )
    async def act(request: Request, session_id: str, wanted: Act) -> Response:
        """Make a move that answers the current frame: its `episode` and its `step`.

        When it does not, 409 returns the current frame and nothing changes: repeating a move after
        a lost answer is harmless.
        """
        session = await session_of(request, session_id)
        _check_no_study(session, "its moves come over the socket", "open /ws/sessions/{id}")
        try:
            with bad_input():
                move = as_move(wanted, session.task, SCRIPT)
            await session.act(move)
        except RefusedError as refusal:
            return _json(f'{{"detail":{json.dumps(str(refusal))},"frame":{session.frame}}}', 409)
        return _json(session.frame)

    @router.post(
        "/sessions/{session_id}/episodes",
        status_code=201,
        response_model=Board,
        tags=["play"],
        summary="Begin the next episode",
    )
    async def create_episode(
        request: Request,
        session_id: str,
        wanted: messages.episode | None = None,  # type: ignore[name-defined]
    ) -> dict[str, object]:
        """Begin the next episode, the rival's too.

        A running episode is abandoned, and counts so.

        On a board of the page, a ranked terrain that waits for its first move is not exchanged: the
        answer is then the board on which it waits, or a new board, with a `session` of its own.
        """
        lobby, boards = _lobby(request), services_of(request).page_boards
        wanted = wanted or messages.episode()
        session = await session_of(request, session_id)
        player_id = session.row.player_id  # None: a rival's
        instead = "POST /api/studies/{name}/next begins the next episode"
        _check_no_study(session, "its terrains are the study's", instead)
        if session.current.day is not None:
            once = "this board is of a daily terrain, which is played once"
            raise HTTPException(409, f"{once}; POST /api/sessions begins another")
        if session.row.challenges is not None:
            one = "this board is a challenge's, which has one terrain"
            raise HTTPException(409, f"{one}; POST /api/sessions begins another")
        with bad_input():
            terrain = lobby.task.next(session.current, wanted)
            await services_of(request).daily_boards.check_seed(terrain.config, terrain.seed)
            if session.row.control == "cookie":
                session, _ = await boards.begin_next(session, wanted)
            elif has_own_origin(request) and is_owner(request, session) and player_id is not None:
                rival = lobby.rival_of(session)
                again = lobby.task.wanted_again(
                    terrain.config, wanted, player=session.row.driver_name,
                    rival=None if rival is None else rival.row.driver_name,
                )  # fmt: skip
                session, _ = await boards.begin(again, player_id)
            else:
                await lobby.restart(session, wanted)
        return await session_summary(lobby, session)

    return router
