"""What the server's wiring calls to let agents play: routes, and a start."""

from __future__ import annotations

from fastapi import FastAPI, Request
from fastapi.responses import Response

from humanplay.agents import mcp, page, wire
from humanplay.agents.cards import CardError, Cards
from humanplay.agents.evaluation import create_tables
from humanplay.web.errors import answer
from humanplay.web.services import Services


def add_routes(app: FastAPI) -> None:
    """Add the page and the addresses of cards to an app."""
    for router in (page.router, wire.router, mcp.router):
        app.router.routes.extend(router.routes)
    app.add_exception_handler(CardError, _answer_card_error)


async def start(app: FastAPI, services: Services) -> None:
    """Let agents play on a server that has started."""
    store, lobby = services.store, services.lobby

    def create() -> None:
        with store.transaction():
            create_tables(store.connection)

    await store.write(create)
    app.state.agents = Cards(store, lobby.task, services.progress.folder, lobby.sources.clock_ms)


async def _answer_card_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, CardError)
    return answer(request, error.status, str(error))
