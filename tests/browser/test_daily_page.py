"""The daily page and the page of one's own episodes, from nothing to the result."""

import re
from contextlib import closing

import pytest

from humanplay.db.reader import utc_day
from humanplay.db.store import Store
from humanplay.study.days import day_before
from humanplay.tasks.mars.boards import MarsBoards
from humanplay.web.access import PLAYER_COOKIE
from marsexplorer.config import EnvConfig
from marsexplorer.policies import load
from tests.support.browser import AS_A_PERSON, NO_3D, keep_picture, violations
from tests.support.recorded import NOW, play
from tests.support.recorded_daily import play_daily
from tests.support.servers import eventually

SIZES = {"1440": (1440, 900), "820": (820, 1180), "390": (390, 844)}


ROUTES_FIT = """() => [...document.querySelectorAll("#routes canvas")].every(
    (canvas) => canvas.clientWidth <= canvas.parentElement.clientWidth && canvas.parentElement.clientWidth <= 480
)"""
"""Whether no route is cut off by its place, nor lost in it."""
ROUTE = """() => document.querySelector("#routes canvas")?.toDataURL() ?? null"""
IS_DARK = "() => matchMedia('(prefers-color-scheme: dark)').matches"
ROWS_FIT = """() => [...document.querySelectorAll(".rows")].every((rows) => rows.scrollWidth <= rows.clientWidth)"""
"""Whether no row of results spills over."""


@pytest.fixture
def small(monkeypatch):
    """A daily terrain of 7x9 cells."""
    monkeypatch.setattr(MarsBoards, "daily", EnvConfig.of("random", (7, 9)))


def check_screen(page, name, problems, themes=("dark",)):
    """Collect findings of axe, and a picture of each size; nothing is wider."""
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth"), (
            f"{name} at {size}"
        )
        eventually(lambda: page.evaluate(ROUTES_FIT))
        assert page.evaluate(ROWS_FIT), f"{name} at {size}"
        keep_picture(page, f"{name}-{size}", full_page=True)
    for theme in themes:
        route, was_dark = page.evaluate(ROUTE), page.evaluate(IS_DARK)
        page.emulate_media(color_scheme=theme)
        if route and was_dark != (theme == "dark"):
            eventually(lambda before=route: page.evaluate(ROUTE) != before)  # in its colours
        problems += [f"{name}, {theme}: {problem}" for problem in violations(page)]


def test_a_visitor_plays_todays_terrain_by_the_prompt_and_sees_what_it_came_to(
    server, player, small
):
    me = player(server, [*NO_3D, *AS_A_PERSON], permissions=["clipboard-read", "clipboard-write"])
    page, wrong = me.page, []
    page.goto(f"{server.url}/me")
    page.get_by_test_id("nothing").wait_for()
    check_screen(page, "me-empty", wrong)
    page.get_by_role("link", name="Today's terrain").click()
    me.wait(
        "window.playground && window.playground.state.link === 'open' && window.playground.state.player"
    )
    assert page.get_by_test_id("prompt").inner_text().startswith("Press an arrow key")
    check_screen(page, "daily-start", wrong)
    policy = load("frontier-cost")
    me.explore(policy, lambda frame: frame["step"] >= 2)
    page.goto(f"{server.url}/me")
    page.get_by_text("No episode has ended").wait_for()  # two moves were played
    page.go_back()
    me.wait(
        "window.playground && window.playground.state.link === 'open' && window.playground.state.player?.frame.step >= 2"
    )
    frame = me.explore(policy, lambda frame: frame["outcome"])
    page.get_by_test_id("end-card").wait_for()
    moves = frame["step"]
    title = f"{moves} moves, {page.get_by_test_id('coverage').inner_text()} % mapped"
    assert page.get_by_test_id("end-title").inner_text() == title
    assert "first person today" in page.get_by_test_id("end-note").inner_text()
    eventually(lambda: "Expert needed" in page.get_by_test_id("share-text").input_value())
    page.get_by_test_id("copy-text").click()
    me.shows("copy-text", "Copied")
    shared = page.evaluate("() => navigator.clipboard.readText()")
    assert shared.startswith("MarsExplorer daily 20")
    shared_link = shared.splitlines()[-1]
    assert shared_link.startswith(f"{server.url}/daily/20")
    # the sentence counts the rows that stand below it
    eventually(lambda: "still playing" not in page.get_by_test_id("policies").inner_text())
    took = page.locator("#policies li b").all_inner_texts()
    beaten = sum("stopped" in text or int(text.split()[0]) > moves for text in took)
    counted = {0: "none of", len(took): "all"}.get(beaten, f"{beaten} of")
    comparison = f"better than {counted} {len(took)} policies."
    eventually(lambda: page.get_by_test_id("end-note").inner_text().endswith(comparison))
    line = shared.splitlines()[1]
    assert len(line) == 8, "how much was mapped when, and nothing of where"
    assert set(line) <= set("▁▂▃▄▅▆▇█")
    days = page.get_by_test_id("calendar").locator("li")
    title = days.get_attribute("title")
    assert days.all_inner_texts() == [f"{title.split()[0]}\n{moves}\n{title}"]
    check_screen(page, "daily-end", wrong, ("light", "dark"))
    page.reload()
    page.get_by_test_id("end-card").wait_for()
    assert me.state()["step"] == moves
    page.keyboard.press("ArrowUp")
    played = [moves]
    for day in ("2", "3"):
        server.clock.wait(24 * 3600 * 1000)  # the next day
        page.goto("about:blank")
        page.goto(f"{server.url}/daily")
        me.wait(
            "window.playground?.state.link === 'open' && window.playground.state.player?.frame.step === 0"
        )
        page.get_by_test_id("routes").get_by_text(f"You: {played[-1]} moves").wait_for()
        newest = me.explore(policy, lambda frame: frame["outcome"])
        played.append(newest["step"])
        me.shows("streak", f"{day} days in a row")
        assert days.count() == int(day)
    check_screen(page, "daily-third-day", wrong, ("light", "dark"))
    page.set_viewport_size({"width": 1440, "height": 900})
    board, past = (page.locator(part).bounding_box() for part in (".board", "#yesterday"))
    assert past["x"] == board["x"], "nothing is empty below the board"
    assert past["y"] >= board["y"] + board["height"]
    page.set_viewport_size({"width": 1024, "height": 768})
    board, side = (page.locator(part).bounding_box() for part in (".board", ".side"))
    assert side["y"] + side["height"] - board["y"] - board["height"] < 60, "nor on a small screen"
    page.goto(shared_link)
    page.get_by_test_id("routes").get_by_text(f"You: {moves} moves").wait_for()
    assert page.locator("#yesterday-title").inner_text() == title.split(":")[0]
    hidden = [".intro", ".board", ".side", "#calendar-part"]
    assert not any(page.locator(part).is_visible() for part in hidden), "a past day stands alone"
    ways = page.get_by_test_id("days").get_by_role("link")
    ways.last.wait_for()
    assert [way.get_attribute("href").split("/")[-1] for way in ways.all()][-1] == "daily"
    assert len(ways.all()) == 2, "the day after it, and today's; before the first is none"
    check_screen(page, "daily-past", wrong, ("light", "dark"))
    page.locator("#yesterday-rows").get_by_role("link").first.click()
    page.get_by_role("heading", name=f"in {moves} moves").wait_for()
    page.goto(f"{server.url}/watch/{newest['episode']}")  # its replay is secret today
    page.get_by_text("Its replay opens once the day is over.").wait_for()
    assert page.locator("#name").inner_text() == "You"
    page.goto(f"{server.url}/me")
    best = min(played)
    assert page.get_by_test_id("best").inner_text() == str(best)
    page.get_by_text("No ranked terrain yet.").wait_for()
    check_screen(page, "me", wrong, ("light", "dark"))
    # the best may be today's, whose replay is as secret as its terrain; the first day is over
    page.get_by_test_id("history").get_by_role("link").last.click()
    page.get_by_role("heading", name=f"in {moves} moves").wait_for()
    assert wrong == []
    assert me.errors == []


def test_a_past_day_leads_past_days_that_nobody_opened(serve, player, tmp_path):
    today = utc_day(NOW)
    oldest, middle, newest = (day_before(today, days) for days in (9, 5, 2))
    with closing(Store(tmp_path / "playground.db")) as store:
        for day in (oldest, middle, newest):
            play_daily(store, "ada", day, explore=True)
    me = player(serve(), NO_3D)
    for day, beside in ((oldest, [middle]), (middle, [oldest, newest]), (newest, [middle])):
        me.page.goto(f"{me.url}/daily/{day}")
        ways = me.page.get_by_test_id("days").get_by_role("link")
        ways.last.wait_for()
        hrefs = [way.get_attribute("href").split("/")[-1] for way in ways.all()]
        assert hrefs == [*beside, "daily"]
    for size in ("1440", "390"):
        width, height = SIZES[size]
        me.page.set_viewport_size({"width": width, "height": height})
        keep_picture(me.page, f"daily-beside-{size}", full_page=True)
    assert me.errors == []


LINE_PX = 18
PLACES_ON_A_LONG_DAY = """() => {
  document.getElementById("day").textContent = "30 September 2026";
  document.getElementById("countdown").textContent = "next terrain in 23:59:59";
  return [".date", ".board-head", ".pad", ".site"].map(
    (place) => document.querySelector(place).getBoundingClientRect().toJSON()
  );
}"""
"""Where things are while the date and the time to the next terrain are longest."""


def test_on_a_phone_the_head_in_3d_is_one_row_and_the_arrows_are_on_the_screen(server, player):
    page = player(server, AS_A_PERSON).page
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(f"{server.url}/daily")
    page.locator("iframe[data-drawn]").wait_for(state="attached")
    for size in ((390, 844), (320, 640)):
        page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
        page.get_by_role("button", name="Matrix").wait_for()
        date, head, pad, bar = page.evaluate(PLACES_ON_A_LONG_DAY)
        assert date["height"] < 2 * LINE_PX, size
        assert head["height"] < 50, size
        assert pad["bottom"] + LINE_PX <= bar["top"], (size, "days in a row take a line")


PICTURES_FIT = """() => [...document.querySelectorAll(".pictures canvas")].every((canvas) => {
  const { clientWidth, clientHeight } = canvas.parentElement;
  return canvas.clientWidth <= clientWidth && canvas.clientHeight <= clientHeight;
})"""
CURVE = """() => {
  const place = document.getElementById("gap-chart");
  const canvas = place.querySelector("canvas");
  return { fits: canvas.clientWidth <= place.clientWidth, drawn: canvas.toDataURL() };
}"""


def test_the_page_of_ones_own_episodes_heals_and_shows_each_once(serve, player, tmp_path):
    with closing(Store(tmp_path / "playground.db")) as store:
        for seed in range(5):
            # east of the third one's start is a rock
            play(store, seed, explore=seed != 2, config=EnvConfig.of("random", 21), actions=[1])
    server = serve()
    me = player(server, NO_3D)
    page, failed = me.page, set()
    token = server.services.player_tokens.sign("ada")
    page.context.add_cookies([{"name": PLAYER_COOKIE, "value": token, "url": server.url}])

    def fail_once(route):
        url = route.request.url
        if url in failed or "after" in url:
            return route.continue_(url=url.replace("limit=50", "limit=2"))
        failed.add(url)
        return route.abort()

    for path in ("task", "people", "me/history?limit=50*"):
        page.route(f"**/api/{path}", fail_once)
    page.goto(f"{server.url}/me")
    page.get_by_text("You have played 5 episodes").wait_for()
    page.get_by_test_id("name").wait_for()
    rows = page.get_by_test_id("history").locator("tbody tr")
    assert rows.count() == 2
    page.get_by_test_id("more").dblclick()
    me.wait("document.activeElement.dataset.testid === 'more'")
    page.wait_for_timeout(300)
    assert rows.count() == 4
    page.keyboard.press("Enter")
    page.get_by_test_id("more").wait_for(state="hidden")
    assert rows.count() == 5
    assert rows.locator("td.good").all_inner_texts() == ["mapped"] * 4, "no mark, in words"
    assert rows.locator("td.bad").all_inner_texts() == ["crashed"], "as the board says"
    page.get_by_text("on average, over 4 finished episodes").wait_for(timeout=120_000)
    assert page.get_by_test_id("pictures").locator("canvas").count() == 2, "of the page of two"
    eventually(lambda: page.evaluate(PICTURES_FIT))
    assert page.get_by_test_id("streaks").get_by_text("not played today").count() == 1
    assert page.get_by_test_id("streaks").get_by_text("not answered today").count() == 1
    page.get_by_text("1 episode was not finished (a cross).").wait_for()
    keep_picture(page, "me-gaps-1440")
    page.set_viewport_size({"width": 390, "height": 844})
    eventually(lambda: page.evaluate(CURVE)["fits"])
    keep_picture(page, "me-gaps-390", full_page=True)
    before = page.evaluate(CURVE)
    page.get_by_test_id("theme").click()
    eventually(lambda: page.evaluate(CURVE)["drawn"] != before["drawn"])
    position = page.get_by_test_id("positions").get_by_role("link").first
    moves = int(re.search(r"after (\d+) move", position.inner_text())[1])
    position.click()
    me.wait(f"window.playground.state.player.frame.step === {moves}")
    assert (me.state("mode"), me.state("counts")) == ("practice", False)
    page.get_by_text(f"Practice from move {moves + 1}").wait_for()
    assert me.errors == []


def test_the_front_page_says_how_today_stands(serve, player):
    me = player(serve(), NO_3D).goto()
    pill = me.page.get_by_test_id("daily-pill")
    pill.get_by_text("not played \u00b7 0 people").wait_for()
    pill.get_by_role("link").click()
    me.page.wait_for_url("**/daily")
    assert me.errors == []
