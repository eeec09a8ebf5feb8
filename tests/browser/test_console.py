"""No page says anything in the browser's console: what a visitor's developer tools show is empty."""

import pytest

from humanplay.db.store import Store
from tests.support.browser import NO_3D
from tests.support.recorded import play
from tests.support.servers import PATIENCE_S
from tests.support.study import freeze

PAGES = (
    "", "daily", "me", "leaderboard", "about", "evaluations", "study", "study/dunes", "docs", "admin",
)  # fmt: skip
NOT_LOGGED_IN = "the server responded with a status of 401"
"""What the browser itself notes when /admin asks whether the operator is logged in, and is told no."""


@pytest.fixture
def site(serve, tmp_path):
    """A server with an open study and an ended episode, and the addresses of its pages."""
    freeze(tmp_path / "playground.db-studies", "dunes", recruitment="open")
    store = Store(tmp_path / "playground.db")
    episode = play(store, 4, explore=True).id
    store.close()
    server = serve(admin_password="only-for-this-test", public_url="http://mars.example")
    return server, (*PAGES, f"replay/{episode}", f"watch/{episode}")


def listen_to(page):
    """Return the list that everything goes to which the page says in the console from now on, or fails at."""
    said = []
    page.on("console", lambda message: said.append(f"{page.url}: {message.type}: {message.text}"))
    page.on("pageerror", lambda error: said.append(f"{page.url}: {error}"))
    return said


def test_no_page_says_anything_in_the_console(site, open_browser):
    """Over plain HTTP from another machine, too, where browsers complain of headers that they do not heed there."""
    server, pages = site
    page = open_browser((*NO_3D, "--host-resolver-rules=MAP mars.example 127.0.0.1")).new_page()
    page.set_default_timeout(1000 * PATIENCE_S)
    said = listen_to(page)
    for path in pages:
        page.goto(f"{server.url}/{path}", wait_until="load")
    page.goto(f"http://mars.example:{server.port}/about", wait_until="load")
    assert [each for each in said if NOT_LOGGED_IN not in each] == []
