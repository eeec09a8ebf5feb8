"""The operator's requests, on a server that has an operator's page.

Every request needs the operator's cookie. One that changes anything must come from our own page as
well: its Origin says so, and browsers send the cookie from nowhere else.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncGenerator, Callable, Coroutine
from contextlib import aclosing, closing
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Depends, HTTPException, Request, Response, WebSocket
from fastapi.responses import FileResponse
from fastapi.routing import APIRoute
from pydantic import Field

from humanplay.board.lobby import Lobby
from humanplay.board.messages import Message
from humanplay.board.session import Session
from humanplay.db import names
from humanplay.db.reader import Reader
from humanplay.db.series import StudyStore
from humanplay.db.store import Store
from humanplay.db.study_rows import Participant, participant_label
from humanplay.db.trial import Trial
from humanplay.study.closing import close_study as close_study_of
from humanplay.study.folder import SECRET_KEPT
from humanplay.study.invitations import MAX_INVITATIONS, token_of
from humanplay.study.places import places_taken
from humanplay.study.protocol import DraftStudyError, StudyError, UnknownStudyError
from humanplay.task import describe
from humanplay.web.access import ADMIN, close, is_operator, services_of
from humanplay.web.answers import operator as answers
from humanplay.web.answers.base import file_of
from humanplay.web.answers.server import Task
from humanplay.web.operator import participants, payments
from humanplay.web.operator.exports import ExportError, ExportKind
from humanplay.web.operator.login import TooManyAttemptsError, WrongPasswordError
from humanplay.web.operator.participants import recruiting
from humanplay.web.operator.services import AdminServices
from humanplay.web.protection import client_address, has_own_origin
from humanplay.web.sockets import ignore_all, send_while, serve_session

NOT_LOGGED_IN, NOT_OUR_PAGE = 4401, 4403
"""Close codes: without the operator's cookie, and where no page of this server opened the socket."""
MAX_BOARDS, MAX_FAILURES = 60, 20
"""Boards, and failures of environments, in a list."""


class Login(Message):
    """What the operator types."""

    password: str = Field(max_length=1024)


class CloseStudy(Message):
    """The study's name once more, since a closed study cannot be opened again.

    `now` closes it while somebody is at it.
    """

    name: str
    now: bool = False


class NewInvitations(Message):
    """How many links are wanted."""

    count: int = Field(ge=1, le=MAX_INVITATIONS)


class Revocation(Message):
    """Which invitations are taken back, by their ids."""

    ids: list[Annotated[str, Field(max_length=40)]] = Field(
        min_length=1, max_length=MAX_INVITATIONS
    )


class ShownName(Message):
    """A player's name, and whether it is hidden."""

    name: str = Field(max_length=100)
    hidden: bool


class OutcomeTexts(Message):
    """What people read when they finish or leave, by the outcome.

    An empty text takes one away.
    """

    texts: dict[str, Annotated[str, Field(max_length=2000)]] = Field(max_length=20)


class ReleaseOptions(Message):
    """Who is to be cited."""

    authors: list[Annotated[str, Field(min_length=1, max_length=200)]] = Field(
        default_factory=list, max_length=50
    )


async def check_page(request: Request) -> None:
    """Check that our own page asks, or a reading request without an Origin.

    Raises:
        HTTPException: 403 otherwise.
    """
    is_ours = has_own_origin(request)
    if is_ours is False or (is_ours is None and request.method not in ("GET", "HEAD")):
        raise HTTPException(
            403, "this call must come from the operator's own page, at /admin of this server"
        )


async def check_operator(request: Request, response: Response) -> AdminServices:
    """The operator's services.

    Raises:
        HTTPException: 401 or 403 unless the operator asks from our page.
    """
    response.headers["Cache-Control"] = "no-store"
    await check_page(request)
    if not is_operator(request):
        raise HTTPException(401, "log in at /admin first: this is the operator's alone")
    return _admin_of(request)


def _admin_of(connection: Request | WebSocket) -> AdminServices:
    admin = services_of(connection).admin
    assert admin is not None, "these routes belong to a server with an operator's page"
    return admin


Operator = Annotated[AdminServices, Depends(check_operator)]


class StudyRoute(APIRoute):
    """A route that tells what is wrong with a study as it is."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[object, object, Response]]:
        """Return the handler with its errors turned into answers."""
        handle = super().get_route_handler()

        async def handler(request: Request) -> Response:
            try:
                return await handle(request)
            except (StudyError, ExportError) as error:
                is_none = isinstance(error, (UnknownStudyError, DraftStudyError))
                raise HTTPException(404 if is_none else 409, str(error)) from error

        return handler


router = APIRouter(route_class=StudyRoute, tags=["operator"])


@router.post("/api/admin/login", dependencies=[Depends(check_page)], summary="Log in")
async def login(request: Request, response: Response, typed: Login) -> answers.LoggedIn:
    """Set the operator's cookie for the right password."""
    try:
        token = _admin_of(request).login.issue(client_address(request), typed.password)
    except WrongPasswordError as error:
        raise HTTPException(401, str(error)) from error
    except TooManyAttemptsError as error:
        raise HTTPException(429, str(error), {"Retry-After": str(error.wait_s)}) from error
    ADMIN.set(response, request, token)
    return answers.LoggedIn(logged_in=True)


@router.post("/api/admin/logout", dependencies=[Depends(check_page)], summary="Log out")
async def logout(request: Request, response: Response) -> answers.LoggedIn:
    """Revoke the token and delete the cookie."""
    _admin_of(request).login.revoke(ADMIN.token(request))
    ADMIN.set(response, request, "")
    return answers.LoggedIn(logged_in=False)


@router.get("/api/admin/overview", summary="Studies, boards and health")
async def overview(request: Request, admin: Operator) -> answers.Overview:
    """The studies, the boards that somebody plays now, and the server's health."""
    database = await asyncio.to_thread(admin.health.state)
    lobby = admin.progress.lobby
    gauges = await asyncio.to_thread(lobby.store.metrics.values, *answers.Gauges.model_fields)
    owners = request.app.state.protection.charges.largest()
    health = answers.ServerHealth(
        **dict(database),
        watched=answers.Gauges(**gauges),
        owners=[answers.StorageOwner(**owner) for owner in owners],
        sessions=len(lobby),
        up_s=round(time.monotonic() - admin.began),
    )
    chosen = await lobby.store.read(partial(names.newest_names, lobby.store))

    def failures() -> list[answers.Failure]:
        with closing(Reader.open(lobby.store.path)) as reader:
            return [answers.Failure(**row) for row in reader.newest_failures(MAX_FAILURES)]

    return answers.Overview(
        studies=await asyncio.to_thread(admin.studies),
        boards=await list_boards(lobby, admin.progress.study_store),
        health=health,
        names=[answers.ChosenName(**name) for name in chosen],
        failures=await asyncio.to_thread(failures),
        now_ms=lobby.sources.clock_ms(),
    )


@router.get("/api/admin/studies/{name}", summary="A study as it stands")
async def show_study(admin: Operator, name: str) -> answers.ConsoleStudy:
    """Its participants, the estimate, data-quality flags, invitations and exports."""
    study = admin.progress.folder.study(name)
    store, now = admin.progress.lobby.store, admin.progress.lobby.sources.clock_ms()

    def read() -> tuple[list[answers.Participant], answers.Recruiting, answers.OutcomeTexts, int]:
        texts = payments.show_outcomes(admin.progress.folder, name)
        with closing(Reader.open(store.path)) as reader:
            invited = recruiting(reader, admin.progress.recruitment.invitations, study, now)
            present = participants.list_participants(reader, name, now, study.is_open)
            taken = places_taken(reader, study, now)
        return present, invited, texts, taken

    present, invited, texts, taken = await asyncio.to_thread(read)
    figures = await asyncio.to_thread(admin.figures.of, name)
    protocol = study.protocol
    return answers.ConsoleStudy(
        **dict(invited),
        **dict(figures),
        **dict(texts),
        name=name,
        title=protocol.title,
        status=study.status,
        frozen_ms=study.frozen_ms,
        closed_ms=study.closed_ms,
        task=Task(**describe(protocol.environment)),
        where=protocol.environment.texts(protocol.env_config).setting,
        max_steps=protocol.env_config.limit,
        planned=protocol.players,
        cap=protocol.cap,
        places_taken=taken,
        warm_up=protocol.warm_up,
        ranked=protocol.ranked,
        stages=participants.count_stages(present),
        participants=present,
        exports=admin.exports.state(name),
        now_ms=now,
    )


@router.post("/api/admin/studies/{name}/close", summary="Close a study for good")
async def close_study(admin: Operator, name: str, typed: CloseStudy) -> answers.ClosedStudy:
    """Close the study for good.

    422 unless its name was typed; 409 while somebody has moved within ten minutes, unless `now`.
    """
    if typed.name != name:
        raise HTTPException(
            422, f"type the study's name, {name!r}, to close it for ever; got {typed.name[:60]!r}"
        )
    admin.progress.folder.study(name)
    store, at_ms = admin.progress.lobby.store, admin.progress.lobby.sources.clock_ms()
    close = partial(close_study_of, admin.progress.folder, store, name, at_ms, typed.now)
    closed = await store.read(close)
    await admin.progress.note_if_closed(closed)
    await asyncio.to_thread(admin.figures.forget, name)
    return answers.ClosedStudy(closed_ms=closed.closed_ms)


@router.post("/api/admin/studies/{name}/invitations", status_code=201, summary="Issue invitations")
async def issue_invitations(
    admin: Operator, name: str, wanted: NewInvitations
) -> answers.IssuedInvitations:
    """Issue invitations and return their tokens."""
    study = admin.progress.folder.study(name)
    issue = admin.progress.recruitment.invitations.issue
    issued = await asyncio.to_thread(issue, name, wanted.count)
    return answers.IssuedInvitations(tokens=[token_of(study, one.id) for one in issued])


@router.post("/api/admin/studies/{name}/invitations/revoke", summary="Take invitations back")
async def revoke_invitations(
    admin: Operator, name: str, wanted: Revocation
) -> answers.RevokedInvitations:
    """Let nobody in by them any more; whoever has agreed with one goes on."""
    admin.progress.folder.study(name)
    revoke = admin.progress.recruitment.invitations.revoke
    revoked = await asyncio.to_thread(revoke, name, wanted.ids)
    return answers.RevokedInvitations(revoked=[invitation.id for invitation in revoked])


@router.post(
    "/api/admin/studies/{name}/outcomes",
    summary="Change what people read when they finish or leave",
)
async def change_outcomes(admin: Operator, name: str, wanted: OutcomeTexts) -> answers.ChangedTexts:
    """Change what people read when they finish or leave.

    An entry of the chain says that it changed.
    """
    folder = admin.progress.folder
    study = folder.study(name)
    changes = await asyncio.to_thread(payments.change_outcomes, folder, study, wanted.texts)
    if changes:
        note = partial(admin.progress.study_store.note_act, study.row(), "outcomes changed")
        await admin.progress.lobby.store.write(note)
    return answers.ChangedTexts(changed=changes)


@router.post("/api/admin/studies/{name}/payments", summary="Whom to pay")
async def list_payments(admin: Operator, name: str) -> answers.Payments:
    """List everybody who agreed.

    If amounts that follow from play are shown of an open study, an entry of the chain says so.
    """
    folder, store = admin.progress.folder, admin.progress.lobby.store
    study = folder.study(name)
    listed = await asyncio.to_thread(payments.list_payments, folder, study, store.path)
    if listed.shows_play and not listed.waits:
        people = listed.finished
        note = partial(
            admin.progress.study_store.note_act, study.row(), "amounts listed", people=people
        )
        await store.write(note)
    return payments.in_answer(listed)


@router.post(
    "/api/admin/studies/{name}/exports/{kind}",
    status_code=202,
    summary="Begin the report or the release",
)
async def begin_export(
    admin: Operator, name: str, kind: ExportKind, wanted: ReleaseOptions | None = None
) -> answers.Exports:
    """Begin to make a report or a release; a release needs a closed study."""
    study = admin.progress.folder.study(name)
    if study.keeps_secret:
        raise HTTPException(409, SECRET_KEPT.format(name))
    if kind == "release" and study.is_open:
        raise HTTPException(409, f"the study {name!r} is open: close it first, then release it")
    admin.exports.begin(name, kind, tuple(wanted.authors) if wanted else ())
    return admin.exports.state(name)


@router.get(
    "/api/admin/studies/{name}/files/{file}",
    response_class=FileResponse,
    responses=file_of("text/html", "application/json", "application/zip"),
    summary="A file that was made",
)
async def download(admin: Operator, name: str, file: str) -> FileResponse:
    """Send a file of the newest report or release; 404 before it is ready."""
    path = admin.exports.file(name, file)
    if path is None:
        raise HTTPException(404, f"no file {file!r} was made; make report or release first")
    return FileResponse(path, filename=file, headers={"Cache-Control": "no-store"})


@router.post("/api/admin/names", summary="Hide a name, or show it again")
async def hide_name(admin: Operator, chosen: ShownName) -> answers.HiddenName:
    """Show a player's name no more, or again; 404 if nobody has it."""
    store = admin.progress.lobby.store
    if not await store.change(names.hide_name, chosen.name, chosen.hidden):
        raise HTTPException(404, f"nobody is called {chosen.name!r} any more")
    return answers.HiddenName(name=chosen.name, hidden=chosen.hidden)


@router.post("/api/admin/check", summary="Check the database")
async def check_database(admin: Operator) -> answers.DatabaseHealth:
    """Check the whole database now, which takes milliseconds to minutes."""
    await asyncio.to_thread(admin.health.check)
    return await asyncio.to_thread(admin.health.state)


@router.websocket("/ws/admin/sessions/{session_id}")
async def watch_board(websocket: WebSocket, session_id: str) -> None:
    """Send a board's frames as they come; what the operator sends is ignored."""
    if has_own_origin(websocket) is not True:
        await close(websocket, NOT_OUR_PAGE, "the Origin of this page is not this server's")
        return
    if not is_operator(websocket):
        await close(websocket, NOT_LOGGED_IN, "log in at /admin first")
        return

    async def watch(session: Session) -> None:
        await send_while(ignore_all(websocket), _send(websocket, session))

    await serve_session(websocket, partial(services_of(websocket).lobby.get, session_id), watch)


async def _send(websocket: WebSocket, session: Session) -> None:
    """Send each message of a board for as long as the operator is logged in."""
    store = services_of(websocket).store
    async with aclosing(board_messages(store, session)) as messages:
        async for message in messages:
            if not is_operator(websocket):
                await close(websocket, NOT_LOGGED_IN, "logged out")
                return
            await websocket.send_text(message)


async def list_boards(lobby: Lobby, study_store: StudyStore) -> list[answers.LiveBoard]:
    """The boards that may be watched and that somebody plays now.

    Those of participants come first. No player's id is in them.
    """
    live = [one for one in lobby.sessions() if not one.has_policy and one.channel.subscribers]

    def newest(present: Participant | None) -> Trial | None:
        trials = [] if present is None else study_store.trials(present.id)
        return trials[-1] if trials else None

    def read() -> list[tuple[Session, Participant | None, Trial | None]]:
        shown = sorted(
            (session for session in live if not _is_secret(session, session.current.id)),
            key=lambda session: session.participation is None,
        )[:MAX_BOARDS]
        present = ((one, study_store.participant_of_session(one.id)) for one in shown)
        return [(session, person, newest(person)) for session, person in present]

    boards = [
        answers.LiveBoard(
            session=session.id,
            study=person and person.study,
            label=person and participant_label(person.id),
            kind=person.kind if person else session.current.driver,
            phase=trial and trial.phase,
            trial=trial and trial.trial,
        )
        for session, person, trial in await lobby.store.read(read)
    ]
    return sorted(boards, key=lambda board: (board.study is None, board.label or board.session))


def _is_secret(session: Session, episode_id: str) -> bool:
    """Whether nobody but its participant sees anything of a board's episode.

    It asks the database.
    """
    participation = session.participation
    return participation is not None and participation.is_secret(episode_id)


async def board_messages(store: Store, session: Session) -> AsyncGenerator[str, None]:
    """Yield the newest frame of a board whenever it changes, until it is closed.

    Its history comes as well wherever frames were missed. Nothing is yielded while the episode is
    secret. The operator is no subscriber: a board that its player has left is not kept alive by
    being watched.
    """
    frame, episode, steps = "", "", 0
    woken = asyncio.Event()
    woken.set()
    leave = session.channel.add_listener(woken.set)
    try:
        while await woken.wait():
            woken.clear()
            # what is checked is what is shown: the next episode may begin meanwhile
            current, shown = session.current.id, session.shown
            if await store.read(partial(_is_secret, session, current)):
                continue
            newest = shown.frame(current)
            if newest == frame:
                continue
            frame = newest
            yield frame
            if current != episode or shown.steps > steps + 1:
                yield shown.history(current)
            episode, steps = current, shown.steps
    finally:
        leave()
