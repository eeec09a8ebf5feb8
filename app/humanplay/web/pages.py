"""The pages: templates of `static/`, rendered with what they have in common."""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping
from functools import lru_cache, partial
from typing import NamedTuple

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from starlette.exceptions import HTTPException

from humanplay.db import names
from humanplay.results.puzzles import puzzles_of
from humanplay.study.folder import Folder, StudyError
from humanplay.study.progress import StageError
from humanplay.study.protocol import SOURCE_LANGUAGE
from humanplay.study.translation import OWN
from humanplay.study.wording import Wording, preferred, software_wording, wording_of
from humanplay.task import Environment
from humanplay.web import api, api_docs
from humanplay.web.access import PLAYER, participant_of, player_of, services_of
from humanplay.web.files import reads_gzip
from humanplay.web.protection import NO_CACHE, page_policy
from humanplay.web.templates import addresses, environment, page_text, root_of

PAGES = {
    "/study": "studies", "/leaderboard": "leaderboard", "/about": "about",
    "/daily": "daily", "/me": "me", "/puzzles": "puzzles",
}  # fmt: skip
"""The folders of `static/` whose pages are served, by their addresses."""

OF_BOARDS = frozenset({"daily", "leaderboard"})
"""Those of a world that has boards of people."""

OF_SERVER = (OWN, "refused.", "stage.", "practice.", "outcome.")
"""What the IDs of texts begin with that no page needs; right answers and other arms' texts must not reach a browser."""

router = APIRouter(include_in_schema=False)
admin_router = APIRouter(include_in_schema=False)
"""The operator's page, for a server that has one."""


def offered(environment: Environment) -> tuple[str, ...]:
    """The pages that the bar leads to.

    An environment without boards has no daily page and no leaderboard.
    """
    has_puzzles = bool(puzzles_of(environment.name))
    pages = {
        "play": True,
        "daily": environment.boards is not None,
        "puzzles": has_puzzles,
        "leaderboard": environment.boards is not None,
        "me": True,
    }
    return tuple(name for name, is_there in pages.items() if is_there)


def page(
    request: Request, name: str, headers: dict[str, str] = NO_CACHE, **context: object
) -> Response:
    """The page of a folder of `static/`, with the head and the bar that pages share."""
    return _html(request, f"{name}/index.html", headers, **context)


def waiting_page(request: Request) -> Response:
    """The page of a replay whose episode is still played again; it reloads itself."""
    return _html(request, "replay/waiting.html")


def _html(
    request: Request, template: str, headers: Mapping[str, str] = NO_CACHE, **context: object
) -> Response:
    """A page, gzipped where the browser reads that."""
    text = environment.get_template(template).render(**addresses(request), **context)
    headers = {**headers, "Vary": "Accept-Encoding"}
    if not reads_gzip(request):
        return HTMLResponse(text, headers=headers)
    return HTMLResponse(_zipped(text), headers={**headers, "Content-Encoding": "gzip"})


@lru_cache(maxsize=32)
def _zipped(text: str) -> bytes:
    return gzip.compress(text.encode(), 6, mtime=0)


def _serve(router: APIRouter, path: str, folder: str, headers: dict[str, str]) -> None:
    async def serve(request: Request) -> Response:
        if folder in OF_BOARDS and folder not in request.app.state.offered:
            title = services_of(request).lobby.task.about.title
            raise HTTPException(404, f"{title} has no page {path}")
        return page(request, folder, headers)

    router.add_api_route(path, serve, methods=["GET"], name=f"{folder}_page")


@router.get("/")
async def play_page(request: Request, invitation: str = "") -> Response:
    """Serve the playground.

    A server that asks for names asks for one first, or knows whoever comes by their invitation.
    """
    services = services_of(request)
    if not services.asks_name:
        return await _playground(request)
    if services.player_tokens.read(invitation) is not None:
        response = RedirectResponse("./", 303, NO_CACHE)
        PLAYER.set(response, request, invitation)
        return response
    player = player_of(request)
    is_named = player is not None and await services.store.read(
        lambda: names.own(services.store, player)["name"] is not None
    )
    if is_named:
        return await _playground(request)
    return _html(request, "name/index.html", about=services.lobby.task.about)


async def _playground(request: Request) -> Response:
    """Return the playground, with the answers that it would ask for first."""
    answers: dict[str, object] = {
        "task": await api.task(request),
        "levels": await api.levels(request),
        "policies": await api.policies(request),
        "maps": await api.maps(request),
    }
    if player_of(request) is None:
        answers["me/session"] = None
    return _html(request, "play/index.html", answers=answers)


for _path, _folder in PAGES.items():
    _serve(router, _path, _folder, NO_CACHE)
_serve(admin_router, "/admin", "admin", {"Content-Security-Policy": page_policy(framed="'none'")})
# it stands in no frame: nobody can be made to press a button that they do not see


class PlayedTask(NamedTuple):
    """An environment that is played here, and the studies beside its database."""

    environment: Environment
    studies: Folder


@router.get("/play")
async def offers_page(request: Request) -> Response:
    """Serve the list of the environments that can be played here."""
    first, *others = request.app.state.offers.items()
    root = root_of(request) + "../../" * bool(request.scope.get("root_path"))
    offers = [
        (root or "./", first[1].environment.about),
        *((f"{root}play/{name}/", played.environment.about) for name, played in others),
    ]
    return _html(request, "offers/index.html", offers=offers)


@router.get("/play/{name}")
async def offer_page(request: Request, name: str) -> Response:
    """Lead to an environment that can be played here; 404 for none."""
    names = list(request.app.state.offers)
    if name not in names:
        raise HTTPException(404, f"no environment {name!r} is played here; /play lists them")
    return RedirectResponse("../" if name == names[0] else f"{name}/", 308)


@router.get("/study/{name}")
async def study_page(request: Request, name: str) -> Response:
    """Serve the page of a study, or lead to the environment played here that has it."""
    folder, offers = services_of(request).progress.folder, request.app.state.offers
    if name not in folder.names():  # the page shows what the API says of it
        for number, (offer, played) in enumerate(offers.items()):
            if name in played.studies.names():
                root = root_of(request) + "../../" * bool(request.scope.get("root_path"))
                place = f"play/{offer}/study/{name}" if number else f"study/{name}"
                at = request.url.replace(path=place, netloc="", scheme="")
                return RedirectResponse(f"{root}{at}", 307, NO_CACHE)
    wording = await _wording(request, name)
    texts = {
        ident: text for ident, text in wording.texts.items() if not ident.startswith(OF_SERVER)
    }
    return page(request, "study", language=wording.language, texts=texts, t=page_text(wording))


async def _wording(request: Request, name: str) -> Wording:
    """The words of a study's page.

    They are in the language that a participant chose, else in one that their browser asks for.
    """
    services, player = services_of(request), participant_of(request)
    try:
        protocol = services.progress.study(name).protocol
    except (StudyError, StageError):
        return software_wording(SOURCE_LANGUAGE)
    chosen = None
    if player is not None and len(protocol.languages) > 1:
        find = services.progress.study_store.participant_of_player
        participant = await services.store.read(partial(find, name, player))
        chosen = participant and json.loads(participant.settings).get("language")
    if chosen in protocol.languages:
        return wording_of(protocol, chosen)
    return wording_of(
        protocol, preferred(request.headers.get("accept-language", ""), protocol.languages)
    )


@router.get("/studies")
async def studies_page() -> Response:
    """Lead whoever guesses the address of the studies to their page."""
    return RedirectResponse("study", 308)


@router.get("/docs")
async def docs_page(request: Request) -> Response:
    """Serve the documentation of the API."""
    return HTMLResponse(api_docs.render_docs(request), headers=NO_CACHE)
