"""A player's chosen name stands on the leaderboard until an operator hides it."""

from contextlib import closing

from humanplay.db import names
from humanplay.db.store import Store
from humanplay.web.access import PLAYER_COOKIE
from marsexplorer.config import EnvConfig
from tests.support.browser import AS_A_PERSON, NO_3D, judge, violations
from tests.support.recorded import NOW, play

FITS = """(table) => {
    const { right } = table.parentElement.getBoundingClientRect();
    return table.getBoundingClientRect().right < right;
}"""
"""Whether a table ends within its panel."""


def test_a_name_is_chosen_shown_with_its_gap_to_expert_and_hidden(serve, player, tmp_path):
    with closing(Store(tmp_path / "playground.db")) as store:
        for seed in range(10):
            config = EnvConfig.of("random", 21)
            play(store, seed, ("ada", "bob")[seed % 2], explore=seed < 9, config=config)
        with store.transaction():
            names.set_name(store.connection, "bob", "Bob", "bob", NOW)
    server = serve(admin_password="correct horse battery")
    me = player(server, [*NO_3D, *AS_A_PERSON])
    page, wrong = me.page, []
    token = server.services.player_tokens.sign("ada")
    page.context.add_cookies([{"name": PLAYER_COOKIE, "value": token, "url": server.url}])
    page.goto(f"{server.url}/leaderboard")
    page.get_by_role("link", name="Choose a name to stand here by it").click()
    page.get_by_test_id("name").fill("Bob")
    page.get_by_test_id("save-name").click()
    page.get_by_text("somebody has this name").wait_for()
    page.get_by_test_id("name").fill("Ada of the Dunes")
    page.keyboard.press("Enter")
    page.get_by_text("Saved. The leaderboard shows it.").wait_for()
    wrong += judge(page, "me-name", full_page=True)
    page.goto(f"{server.url}/leaderboard")
    page.locator("#named tbody [aria-current]").wait_for(timeout=120_000)
    assert page.locator("#named tbody th").all_inner_texts() == ["Ada of the Dunesyou", "Bob"]
    page.get_by_test_id("period-all").click()
    page.locator("#named tbody [aria-current]").wait_for()
    wrong += judge(page, "leaderboard-people", full_page=True)
    page.set_viewport_size({"width": 320, "height": 640})
    assert page.locator("#named").evaluate(FITS)
    page.emulate_media(color_scheme="light")
    wrong += violations(page)
    page.context.clear_cookies()
    page.reload()
    page.locator("#named tfoot [aria-current]").wait_for()
    line, foot = page.get_by_test_id("own"), page.locator("#named tfoot")
    assert line.inner_text().startswith("5 ranked terrains, and you have a place.")
    assert foot.locator("th").inner_text() == "You"
    assert line.get_by_role("link", name="Play ranked").is_visible(), "what a stranger can do first"
    assert foot.bounding_box()["height"] <= 50, "one line over the foot of the page"
    assert page.locator("#named thead tr").bounding_box()["height"] <= 34, "no heading wraps"
    assert page.evaluate("document.documentElement.scrollWidth") == 320
    page.goto(f"{server.url}/admin")
    page.get_by_test_id("password").fill("correct horse battery")
    page.keyboard.press("Enter")
    page.get_by_test_id("show-names").click()
    page.get_by_role("button", name="Hide Ada of the Dunes").click()
    page.get_by_role("button", name="Show Ada of the Dunes").wait_for()
    page.goto(f"{server.url}/leaderboard")
    page.get_by_text("Bob", exact=True).wait_for()
    assert not page.get_by_text("Ada of the Dunes").count()
    page.context.add_cookies([{"name": PLAYER_COOKIE, "value": token, "url": server.url}])
    page.goto(f"{server.url}/me")
    page.get_by_text("The operator of this server has hidden your name").wait_for()
    assert wrong == []
    assert me.errors == []


def test_a_board_that_is_left_alone_stays_the_board(serve, player, tmp_path):
    with closing(Store(tmp_path / "playground.db")) as store:
        play(store, 1, "p1", explore=True)
    server = serve()
    me = player(server, NO_3D)
    page, requests = me.page, []
    page.clock.install()
    me.begin(size=[9, 12])
    before = me.state()
    page.on("request", lambda request: requests.append(request.url))
    for _settled in (False, True):  # at first its last files may load, and an answer be owed
        api = [url for url in requests if not url.startswith(f"{server.url}/static/")]
        assert set(api) <= {f"{server.url}/api/health"}
        requests.clear()
        page.clock.fast_forward(60_000)
        page.wait_for_timeout(500)
    board = page.locator(".board[data-role=player]")
    lies_on_top = """board => {
        const { x, y, width, height } = board.querySelector(".matrix").getBoundingClientRect();
        const top = document.elementFromPoint(x + width / 2, y + height / 2);
        return top.closest(".matrix") !== null;
    }"""
    assert board.evaluate(lies_on_top)
    assert (board.locator("canvas").count(), requests, me.state()) == (1, [], before)
    assert me.errors == []
