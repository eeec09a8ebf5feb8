"""Every page in a browser.

Axe finds nothing in either theme, nothing is too wide, and the choice of colours stays.
"""

import pytest

from humanplay.db.store import Store
from tests.support.agents import closed_evaluation
from tests.support.browser import NO_3D, violations
from tests.support.recorded import play
from tests.support.servers import PATIENCE_S
from tests.support.study import freeze

SIZES = {"desktop": (1440, 900), "phone": (390, 844)}
ZOOMED = (720, 450)
"""What 1440 x 900 leaves of CSS pixels at 200 % zoom."""
READ = ("about", "study", "leaderboard", "docs", "nowhere/at/all")


@pytest.fixture
def site(serve, tmp_path):
    """A server with two studies and an ended episode, and where its pages are.

    One study is open to everybody, one by invitation.
    """
    title = "How well do people explore dunes?"
    freeze(tmp_path / "playground.db-studies", "dunes", recruitment="open", title=title)
    freeze(tmp_path / "playground.db-studies", "secret", recruitment="invitation")
    store = Store(tmp_path / "playground.db")
    episode = play(store, 4, explore=True).id
    store.close()
    pages = [
        *READ,
        "",
        "daily",
        "me",
        f"replay/{episode}",
        f"watch/{episode}",
        "study/dunes",
        "admin",
    ]
    return serve(admin_password="only-for-this-test"), pages


class Reader:
    """Opens pages one after the other in one tab and keeps what is wrong with them."""

    def __init__(self, browser, server, theme):
        self.profile = browser.new_context(color_scheme=theme, reduced_motion="reduce")
        self.profile.set_default_timeout(1000 * PATIENCE_S)
        self.page, self.url, self.theme = self.profile.new_page(), server.url, theme
        self.found = []

    def look(self, path, size):
        """Open a page at a size and judge it."""
        width, height = SIZES[size]
        self.page.set_viewport_size({"width": width, "height": height})
        self.page.goto(f"{self.url}/{path}", wait_until="load")
        is_there = "document.fonts.status === 'loaded' && Boolean(document.querySelector('main'))"
        self.page.wait_for_function(f"() => {is_there}")
        screen = f"/{path} {self.theme} {size}"
        self.found += [f"{screen}: {problem}" for problem in violations(self.page)]
        self.check_width(screen, width)

    def check_width(self, screen, width):
        reached = self.page.evaluate("document.documentElement.scrollWidth")
        if reached > width:
            self.found.append(f"{screen}: {reached} px wide")


def test_pages_that_are_read_have_nothing_that_axe_finds(site, open_browser):
    server, _ = site
    dark, light = (Reader(open_browser(NO_3D), server, theme) for theme in ("dark", "light"))
    for path in READ:
        dark.look(path, "phone")
    for path in READ[:3]:
        light.look(path, "desktop")
    assert [*dark.found, *light.found] == []

    light.page.goto(f"{server.url}/study")
    light.page.get_by_test_id("open-studies").wait_for(state="visible")
    listed = light.page.get_by_test_id("open-studies").inner_text()
    assert "How well do people explore dunes?" in listed
    assert "secret" not in light.page.content()

    ground = "() => getComputedStyle(document.documentElement).backgroundColor"
    bright = light.page.evaluate(ground)
    light.page.get_by_test_id("theme").click()
    night = light.page.evaluate(ground)
    assert night != bright
    light.page.goto(f"{server.url}/about")
    assert light.page.evaluate(ground) == night, "the choice holds on every page"
    light.page.goto(f"{server.url}/study/dunes")
    assert light.page.evaluate(ground) == night
    light.page.evaluate("() => localStorage.setItem('humanplay.theme', 'light')")
    light.page.reload()
    assert light.page.evaluate(ground) == night, "a study shows every participant the same colours"


@pytest.mark.long
@pytest.mark.parametrize("theme", ["dark", "light"])
def test_axe_finds_nothing_on_any_page(site, open_browser, theme):
    server, pages = site
    reader = Reader(open_browser(NO_3D), server, theme)
    for path in pages:
        for size in SIZES:
            reader.look(path, size)
        reader.page.set_viewport_size({"width": ZOOMED[0], "height": ZOOMED[1]})
        reader.check_width(f"/{path} {theme} at 200 %", ZOOMED[0])
        for width, height in ((820, 1180), (1920, 1080)):
            reader.page.set_viewport_size({"width": width, "height": height})
            reader.check_width(f"/{path} {theme} at {width}", width)
    assert reader.found == []


@pytest.mark.long
def test_the_page_of_a_closed_evaluation_has_people_and_agents_on_one_scale(
    serve, open_browser, shipped_policies, tmp_path
):
    server = serve(database=closed_evaluation(tmp_path, shipped_policies) / "playground.db")
    for theme in ("dark", "light"):
        reader = Reader(open_browser(NO_3D), server, theme)
        for path in ("evaluations", "evaluations/agents"):
            for size in SIZES:
                reader.look(path, size)
        assert reader.found == []
    page = reader.page
    rows = page.get_by_test_id("row").all()
    who = [row.get_attribute("data-who") for row in rows]
    assert sorted(who) == ["agent", "agent", "agent", "people", "policy"]
    dots = [row.locator(".dot").bounding_box()["x"] for row in rows]
    assert dots == sorted(dots, reverse=True), "one scale, the best first"
    further = rows[0].inner_text()  # it knew the maps
    assert "has seen these instances, and does not rank" in further
    receipt = rows[who.index("people") - 1].get_by_role("link")
    with page.expect_download() as download:
        receipt.click()
    assert download.value.suggested_filename == f"{receipt.inner_text()}.json"


def test_a_replay_a_live_board_and_a_leaderboard_fit_a_screen_320_pixels_wide(site, player):
    server, pages = site
    me = player(server, NO_3D, 320, 640)
    replay = next(path for path in pages if path.startswith("replay/"))
    watch = me.open_session()["watch"]
    for path in ("leaderboard#random-84x84&score", replay, f"watch/{watch}"):
        me.page.goto(f"{server.url}/{path}")
        me.page.get_by_test_id("theme").wait_for()
        if path.startswith("leaderboard"):
            me.page.get_by_text("0.973").first.wait_for()
        assert me.page.evaluate("document.documentElement.scrollWidth") == 320, path
        if path == replay:
            me.page.get_by_test_id("downloads").click()
            assert me.page.locator("#downloads ul").bounding_box()["x"] >= 0
    me.page.get_by_text("connected").wait_for()
    server.stop()
    me.page.get_by_text("connection lost").wait_for()
    assert me.page.evaluate("document.documentElement.scrollWidth") == 320
