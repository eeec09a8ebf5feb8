"""A first-time visitor is led by the screen alone, until the second terrain."""

import re

import pytest

from humanplay.board.sources import Sources
from marsexplorer import policies
from tests.support.browser import KEY_OF, NO_3D, keep_picture

WAYS = ("east", "south", "west", "north")


class Visitor:
    """A person who reads the page and does what it says."""

    def __init__(self, me):
        self.me, self.page = me, me.page

    def reads(self, test_id):
        """Return the text of an element that is on the screen; "" when it is not."""
        element = self.page.get_by_test_id(test_id)
        return element.inner_text() if element.is_visible() else ""

    def sees(self, test_id, pattern):
        """Wait until an element says something, and return the match."""
        self.page.get_by_test_id(test_id).get_by_text(re.compile(pattern)).first.wait_for()
        return re.search(pattern, self.reads(test_id))

    def way(self):
        """A way that the board's own description calls free."""
        words = self.page.get_by_test_id("canvas-player").get_attribute("aria-label")
        return next(way for way in WAYS if f"{way} free" in words)


def arrive(serve, player, **context):
    """Open the page for the first time, on a terrain that begins without rock nearby.

    The coach would warn of one.
    """
    me = player(serve(Sources(seed=lambda: 3)), NO_3D, is_new=True, **context)
    me.goto()
    return Visitor(me)


def test_a_first_time_visitor_plays_an_episode_by_the_prompts_on_the_screen_alone(serve, player):
    visitor = arrive(serve, player, reduced_motion="reduce")
    me, page = visitor.me, visitor.page
    assert visitor.reads("goal") == "Map 99 % of the ground in as few moves as you can"
    key = ("unknown", "ground", "rock", "you", "policy", "lidar range")
    assert all(word in visitor.reads("key") for word in key)
    assert visitor.reads("board-rival") == "", "one board, until the first episode has ended"
    assert visitor.reads("coach-player") == ""
    assert "Puzzles" in visitor.reads("ways"), "what else there is, before the first move"

    assert visitor.sees("prompt-player", "Press an arrow key")
    before, way = me.state()["discovered"], visitor.way()
    me.press(way)
    gained = me.state()["discovered"] - before
    hint = r"(\+\d+ new cells?)?\s*Your lidar uncovers what is in sight"
    hint_shown = visitor.sees("coach-player", hint)
    assert hint_shown.group(1) == (f"+{gained} new cell{'s' * (gained > 1)}" if gained else None)
    assert visitor.reads("prompt-player") == ""
    assert visitor.reads("ways") == ""
    me.shows("steps-player", "1")
    assert "score" not in page.locator("main").inner_text().lower(), "the score waits for the end"

    while "right in front of you" not in visitor.reads("coach-player"):
        me.press(way)
        painted = me.state()["step"]
        me.shows("steps-player", str(painted))
    warning = visitor.reads("coach-player")
    assert re.search(r"(Hitting|Driving over) it ends the episode", warning)
    page.wait_for_timeout(400)  # the visitor reads it, and wants to know
    me.press(way)
    end = me.state()
    assert end["outcome"] == ("collided" if "rock" in warning else "out_of_bounds")

    title = visitor.sees("end-card", r"(Crashed|Off the map) at ([\d.]+) % after (\d+) moves?")
    assert (title[2], int(title[3])) == (visitor.reads("coverage-player"), end["step"])
    assert "score" not in visitor.reads("end-card").lower(), "it stands in tables"
    visitor.sees("board-rival", "Expert")
    assert visitor.reads("coach-player") == ""
    visitor.sees("end-compare", "Expert")
    # it goes on by itself
    me.wait("window.playground.state.rival.frame.step > window.playground.state.player.frame.step")

    visitor.sees("end-card", "Next terrain\\s+Enter")
    page.keyboard.press("Enter")
    me.wait(f"window.playground.state.player.frame.episode !== '{end['episode']}'")
    page.get_by_test_id("end-card").wait_for(state="hidden")
    assert page.get_by_test_id("board-rival").is_visible()
    assert visitor.reads("prompt-player") == visitor.reads("coach-player") == ""
    page.reload(wait_until="domcontentloaded")
    body = page.evaluate("() => ({...document.body.dataset})")
    assert (body["visit"], body["boards"]) == ("again", "2")
    me.wait("window.playground?.state.player && window.playground.state.link === 'open'")
    begun = me.state()
    me.press("north")
    me.wait("window.playground.state.player.frame.outcome")
    page.keyboard.press("r")  # the same again
    me.wait(f"window.playground.state.player.frame.episode !== '{begun['episode']}'")
    assert me.state()["grid"] == begun["grid"]
    assert me.errors == []


@pytest.mark.long
def test_a_visitor_with_a_phone_taps_hides_the_hints_and_maps_the_whole_terrain(serve, player):
    visitor = arrive(serve, player, width=390, height=844, has_touch=True, is_mobile=True)
    me, page = visitor.me, visitor.page
    assert visitor.sees("prompt-player", "Swipe or tap an arrow")
    page.get_by_test_id(f"pad-{visitor.way()}").tap()
    visitor.sees("coach-player", "Your lidar uncovers")
    policy = policies.load("frontier-cost")
    me.explore(policy, lambda frame: frame["step"] >= 4)
    page.get_by_role("button", name="Hide hints").tap()
    frame = me.explore(policy, lambda frame: frame["outcome"])
    assert visitor.reads("coach-player") == ""
    assert frame["outcome"] == "explored"
    visitor.sees("end-card", f"(Mapped in|You needed) {frame['step']} moves")
    page.get_by_test_id("tab-rival").tap()
    visitor.sees("board-rival", "Expert")
    assert page.get_by_test_id("board-player").is_hidden()
    page.get_by_role("button", name="Next terrain").tap()
    me.wait(f"window.playground.state.player.frame.episode !== '{frame['episode']}'")
    page.get_by_test_id("board-player").wait_for()
    assert me.errors == []


def test_help_opens_by_button_and_by_key_and_says_what_everything_is(serve, player):
    me = player(serve(), NO_3D, reduced_motion="reduce")
    me.goto()
    page = me.page
    page.keyboard.press("?")
    dialog = page.get_by_test_id("help-dialog")
    dialog.wait_for()
    text = dialog.inner_text()
    words = ("Rules", "Score", "Who is Expert?", "rock", "Ranked", "Enter")
    assert all(word in text for word in words)
    links = {link.get_attribute("href") for link in dialog.get_by_role("link").all()}
    assert links >= {"about", "about#policies", "leaderboard", "docs", "daily", "study"}
    page.keyboard.press(KEY_OF["east"])
    page.keyboard.press("Escape")
    dialog.wait_for(state="hidden")
    assert me.state()["step"] == 0, "keys belong to the dialog while it is open"
    page.get_by_test_id("open-help").click()
    page.get_by_test_id("close-help").click()
    dialog.wait_for(state="hidden")
    page.set_viewport_size({"width": 390, "height": 844})
    page.get_by_test_id("open-help").click()
    keep_picture(page, "help-390")
    assert dialog.evaluate("part => part.scrollHeight <= part.clientHeight"), "one screen"
    dialog.get_by_role("link", name="Who is Expert?").click()
    page.get_by_text("is a small neural network").wait_for()
    page.go_back()
    me.wait("window.playground.state.link === 'open'")
    me.press("east" if me.state()["grid"][0][1] == "." else "south")
    assert me.errors == []


def test_on_a_tablet_the_key_stands_right_below_the_board(serve, player):
    page = arrive(serve, player, width=820, height=1180).page
    board, key = page.get_by_test_id("board-player"), page.get_by_test_id("key")
    gap = key.bounding_box()["y"] - board.bounding_box()["y"] - board.bounding_box()["height"]
    assert 0 <= gap < 30


def test_a_first_visit_makes_at_most_forty_requests(server, player):
    me, requests = player(server, NO_3D, is_new=True), []
    me.page.on("request", lambda request: requests.append(request.url))
    me.goto()
    me.wait("performance.getEntriesByName('humanplay.first-frame')[0]")
    me.page.wait_for_timeout(2_000)
    assert len(requests) <= 40
