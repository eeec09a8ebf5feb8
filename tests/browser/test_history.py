"""One bar on every page; Back, Forward and reload lead to the board one was on.

They drop nothing unasked.
"""

from itertools import pairwise

import pytest

from tests.browser.test_attested import there_and_back
from tests.support.browser import ANIMATED, AS_A_PERSON, NO_3D

PERSON = [*NO_3D, *AS_A_PERSON]
PAGES = ("/", "/daily", "/leaderboard", "/me", "/about", "/study")
BAR = """() => [document.querySelector('.site'), document.querySelector('.brand')].map((part) => {
    const { left, top, height } = part.getBoundingClientRect()
    return [left, top, height].map(Math.round)
})"""


def session_of(me):
    return me.state("player.session")


def stands(me, query):
    """Wait until the address has this query."""
    me.wait(f"location.search === {query!r}")


def go(me, mode):
    me.page.get_by_test_id(f"mode-{mode}").click()
    me.wait(f"window.playground.state.mode === '{mode}' && window.playground.state.link === 'open'")


def is_on(me, session):
    me.wait(f"window.playground.state.player.session === {session!r}")


def test_back_forward_and_reload_lead_from_mode_to_mode(server, player):
    me = player(server, PERSON).goto()
    practice = session_of(me)
    go(me, "watch")
    stands(me, "?mode=watch")
    watched = session_of(me)
    go(me, "ranked")
    stands(me, "?mode=ranked")
    ranked = session_of(me)
    me.page.go_back()
    is_on(me, watched)
    me.page.go_back()
    is_on(me, practice)
    stands(me, "")
    me.page.reload(wait_until="domcontentloaded")
    is_on(me, practice)
    me.page.go_forward()
    is_on(me, watched)
    me.page.reload(wait_until="domcontentloaded")
    is_on(me, watched)
    assert len({practice, watched, ranked}) == 3
    assert me.errors == []


def test_a_terrain_under_way_is_asked_for_before_it_goes(server, player):
    me = player(server, PERSON).goto()
    practice = session_of(me)
    me.press(there_and_back(me)[0])
    me.page.get_by_test_id("mode-watch").click()
    dialog = me.page.get_by_test_id("leave-dialog")
    assert "Nothing counts here" in dialog.inner_text()
    me.page.get_by_test_id("keep-playing").click()
    assert (session_of(me), me.state()["step"]) == (practice, 1)
    me.page.get_by_test_id("mode-watch").click()
    me.page.get_by_test_id("leave-episode").click()
    stands(me, "?mode=watch")
    me.page.go_back()
    is_on(me, practice)
    assert me.state()["step"] == 1


def test_back_leaves_no_ranked_terrain_unasked_and_its_address_holds_no_seed(server, player):
    me = player(server, PERSON).goto()
    practice = session_of(me)
    go(me, "ranked")
    ranked = session_of(me)
    me.press(there_and_back(me)[0])
    address = me.page.url
    assert "seed" not in address
    dialog = me.page.get_by_test_id("leave-dialog")
    me.page.go_back()
    dialog.wait_for()
    assert "counts as abandoned" in dialog.inner_text()
    me.page.get_by_test_id("keep-playing").click()
    me.wait(f"location.href === {address!r}")
    assert (session_of(me), me.state()["step"]) == (ranked, 1)
    me.page.go_back()
    dialog.wait_for()
    me.page.get_by_test_id("leave-episode").click()
    is_on(me, practice)


def test_an_address_names_a_terrain_and_a_ranked_one_names_none(server, player):
    me, friend = player(server, PERSON), player(server, PERSON)
    for visitor in (me, friend):
        visitor.page.goto(f"{server.url}/?level=cave&size=15x20&seed=7")
        visitor.wait("window.playground?.state.player && window.playground.state.link === 'open'")
    state = me.page.evaluate("() => window.playground.state")
    assert (state["mode"], state["level"], state["size"]) == ("practice", "cave", [15, 20])
    assert me.state()["grid"] == friend.state()["grid"]
    stands(me, "?level=cave&size=15x20&seed=7")
    me.page.goto("about:blank")
    me.page.goto(f"{server.url}/?mode=ranked&level=cave&size=21&seed=7")
    me.wait("window.playground?.state.mode === 'ranked' && window.playground.state.counts")
    me.page.goto("about:blank")
    me.page.goto(f"{server.url}/?level=nothing&size=21")
    me.page.get_by_test_id("notices").get_by_text("What this address asks for").wait_for()


@pytest.mark.parametrize(
    ("width", "height"), [(1440, 900), (1024, 768), (820, 1180), (390, 844), (320, 568)]
)
def test_the_bar_stands_alike_on_every_page_and_nothing_is_cut(server, player, width, height):
    me = player(server, NO_3D, width, height)
    places = []
    for path in PAGES:
        me.page.goto(server.url + path)
        me.page.evaluate(ANIMATED)
        places.append(me.page.evaluate(BAR))
        me.wait(f"document.documentElement.scrollWidth === {width}")
        links = me.page.locator(".site a")
        assert "Play" in links.first.inner_text()
        boxes = [link.bounding_box() for link in links.all()]
        assert len({box["y"] for box in boxes}) == 1, f"{path}: a row of links"
        for left, right in pairwise(boxes):
            assert left["x"] + left["width"] <= right["x"] + 0.5
        if width <= 480:
            assert boxes[0]["y"] + boxes[0]["height"] <= height
            assert boxes[0]["y"] > height - 70, "at the foot of the screen"
    assert places == [places[0]] * len(PAGES)


def test_the_bar_has_what_the_environment_offers_alone(serve, player):
    server = serve(task="gymnasium:FrozenLake-v1")
    me = player(server, NO_3D)
    me.page.goto(server.url + "/about")
    assert me.page.locator(".site a .full").all_inner_texts() == ["Play", "You"]
