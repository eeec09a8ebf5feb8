"""No page writes to the browser's console: a visitor's developer tools stay empty."""

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
    """A server with an open study and an ended episode; the addresses of its pages."""
    freeze(tmp_path / "playground.db-studies", "dunes", recruitment="open")
    store = Store(tmp_path / "playground.db")
    episode = play(store, 4, explore=True).id
    store.close()
    server = serve(admin_password="only-for-this-test", public_url="http://mars.example")
    return server, (*PAGES, f"replay/{episode}", f"watch/{episode}")


def listen_to(page):
    """Return a list that gets what the page says in the console, and its errors."""
    lines = []
    page.on("console", lambda message: lines.append(f"{page.url}: {message.type}: {message.text}"))
    page.on("pageerror", lambda error: lines.append(f"{page.url}: {error}"))
    return lines


def test_no_page_says_anything_in_the_console(site, open_browser):
    """Over plain HTTP from another machine, browsers complain of more headers."""
    server, pages = site
    page = open_browser((*NO_3D, "--host-resolver-rules=MAP mars.example 127.0.0.1")).new_page()
    page.set_default_timeout(1000 * PATIENCE_S)
    lines = listen_to(page)
    for path in pages:
        page.goto(f"{server.url}/{path}", wait_until="load")
    page.goto(f"http://mars.example:{server.port}/about", wait_until="load")
    assert [line for line in lines if NOT_LOGGED_IN not in line] == []
