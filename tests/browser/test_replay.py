"""A replay in a browser, on the server's page and as a file without a network."""

import re

import pytest

from humanplay.db.store import Store
from humanplay.tasks.mars.course import course_of, play_ghost
from humanplay.web.replays.files import file_of
from marsexplorer.config import EnvConfig
from tests.support.browser import NO_3D, violations
from tests.support.recorded import play
from tests.support.servers import eventually

CONFIG = EnvConfig("random", 9, 13, sensor_radius=3)


@pytest.fixture
def ended(tmp_path):
    """The id of an explored episode, and its record."""
    store = Store(tmp_path / "playground.db")
    row = play(store, 4, explore=True, config=CONFIG)
    record = store.load_record(row.id)
    store.close()
    return row.id, record


class Replay:
    """The page of a replay."""

    def __init__(self, page, url):
        self.page = page
        page.goto(url)
        page.wait_for_function("() => Boolean(window.replay && window.replay.ghost)")

    def step(self):
        return self.page.evaluate("window.replay.step")

    def stands(self, step):
        self.page.wait_for_function(f"() => window.replay.step === {step}")

    def shows(self, test_id, text):
        shows = (
            "([id, text]) => document.querySelector(`[data-testid=${id}]`).innerText.includes(text)"
        )
        self.page.wait_for_function(shows, arg=[test_id, text])


def go_through(replay, record):
    """Drive a replay by keys and by the pointer over the curve; both boards follow."""
    page, moves = replay.page, len(record.actions)
    last = page.evaluate("window.replay.playback.last")
    page.get_by_test_id("to-start").click()
    replay.stands(0)
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    replay.stands(2)
    replay.shows("board-run", "2")
    replay.shows("board-ghost", "2")
    page.keyboard.press("End")
    replay.stands(last)
    replay.shows("board-run", f"of the ground in {moves} moves")
    page.keyboard.press("Home")
    speed = page.evaluate("window.replay.playback.speed")
    page.keyboard.press("+")
    assert page.evaluate("window.replay.playback.speed") == 2 * speed
    page.keyboard.press("+")
    page.keyboard.press("+")
    page.get_by_test_id("scrubber").focus()
    page.keyboard.press(" ")
    replay.stands(last)
    box = page.get_by_test_id("scrubber").bounding_box()
    middle = box["x"] + 44 + (box["width"] - 58) * (last // 2) / last
    height = box["y"] + box["height"] / 2
    page.mouse.move(middle, height)
    replay.stands(last // 2)
    page.mouse.move(box["x"] + 10, box["y"] - 30)
    replay.stands(last)  # the pointer has left
    page.mouse.move(middle, height)
    page.mouse.down()
    page.mouse.move(box["x"] + 46, height, steps=3)
    page.mouse.up()
    page.mouse.move(5, 5)
    replay.stands(0)
    assert page.get_by_test_id("scrubber").get_attribute("aria-valuenow") == "0"


def test_a_replay_is_driven_by_keys_and_by_its_curve_and_has_files(serve, player, ended):
    episode, record = ended
    me = player(serve(), flags=NO_3D, accept_downloads=True)
    replay = Replay(me.page, f"{me.url}/replay/{episode}#move=3")
    assert replay.step() == 3
    go_through(replay, record)
    before = me.still("board-run")
    me.page.get_by_test_id("expert").check()
    replay.shows("advice", "Expert would go")
    me.changes("board-run", before)  # its arrows
    me.page.keyboard.press(" ")  # the switch has the focus: it turns, and nothing is played
    replay.shows("advice", "")
    assert (replay.step(), me.picture("board-run")) == (0, before)
    me.page.keyboard.press(" ")
    me.page.keyboard.press("End")
    replay.shows("advice", "The episode has ended here.")
    me.page.keyboard.press("Home")
    for theme in ("dark", "light"):
        me.page.evaluate(f"document.documentElement.dataset.theme = '{theme}'")
        assert violations(me.page) == [], theme
    me.page.get_by_test_id("ghost").select_option("frontier-cost")
    replay.shows("compared", "Nearest mapped")
    me.page.get_by_test_id("downloads").click()
    with me.page.expect_download() as download:
        me.page.get_by_test_id("download-gif").click()
    assert download.value.suggested_filename == f"humanplay-{episode}.gif"
    me.page.set_viewport_size({"width": 390, "height": 844})
    assert me.page.get_by_test_id("board-ghost").is_hidden()
    me.page.get_by_role("button", name=re.compile("^Nearest")).click()
    assert me.page.get_by_test_id("board-ghost").is_visible()
    assert me.page.get_by_test_id("board-run").is_hidden()
    assert me.page.evaluate("document.documentElement.scrollWidth") == 390
    assert not me.errors


def test_whoever_drives_a_replay_before_the_policy_has_come_goes_on_driving(serve, player, ended):
    episode, record = ended
    me, late = player(serve(), NO_3D), []
    me.page.route("**/ghost?*", lambda route: late.append(route))
    for move, key, stands in (
        ("#move=3", None, 3),
        ("#move=3", "ArrowLeft", 2),
        ("", "End", len(record.actions)),
    ):
        me.page.goto("about:blank")
        me.page.goto(f"{me.url}/replay/{episode}{move}")
        me.wait("window.replay")
        eventually(lambda: me.page.wait_for_timeout(20) or late)
        if key:
            me.page.keyboard.press(key)
        assert me.page.evaluate("window.replay.step") == stands
        late.pop().continue_()
        me.wait("window.replay.ghost")
        me.page.wait_for_timeout(300)
        playback = me.page.evaluate("window.replay.playback")
        assert (playback["at"], playback["isPlaying"]) == (stands, False)
    assert me.errors == []


def test_a_replay_says_that_a_policy_gets_ready_and_shows_it_when_it_has_come(serve, player, ended):
    me, late = player(serve(), NO_3D), []
    me.page.clock.install()
    me.page.route("**/ghost?*", lambda route: late.append(route))
    me.page.goto(f"{me.url}/replay/{ended[0]}")
    waiting = me.page.locator("#waiting")
    waiting.get_by_text("plays the same terrain").wait_for()
    eventually(lambda: me.page.wait_for_timeout(20) or late)
    me.page.clock.fast_forward(60_000)
    waiting.get_by_text("Expert is getting ready.").wait_for()
    me.page.clock.resume()
    late.pop().continue_()
    me.wait("window.replay.ghost")
    waiting.wait_for(state="hidden")
    assert me.errors == []


def test_a_replay_offers_a_policy_again_that_did_not_come(serve, player, ended):
    me, tries = player(serve(), NO_3D), []
    failure = {"detail": "this took longer than 180 s and was ended"}

    def answer(route):
        tries.append(route)
        route.fulfill(status=503, json=failure) if len(tries) == 1 else route.continue_()

    me.page.route("**/ghost?*", answer)
    me.page.goto(f"{me.url}/replay/{ended[0]}")
    text = "Expert did not finish this terrain in time."
    me.page.locator("#waiting").get_by_text(text).wait_for()
    assert me.page.get_by_test_id("compared").inner_text() == text
    me.page.get_by_test_id("try-again").click()
    me.wait("window.replay.ghost")
    me.page.locator("#waiting").wait_for(state="hidden")
    assert "mapped" in me.page.get_by_test_id("compared").inner_text()


def test_a_replay_in_one_file_runs_from_a_disk_without_a_network_and_asks_for_nothing(
    open_browser, tmp_path, ended
):
    episode, record = ended
    path = tmp_path / "replay.html"
    courses = [course_of("A person", record), play_ghost("frontier-cost", record)]
    path.write_bytes(file_of("html", episode, courses))
    browser = open_browser(NO_3D)
    calm = {"reduced_motion": "reduce", "color_scheme": "light"}
    page = browser.new_context(offline=True, **calm).new_page()
    asked, errors = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    go_through(Replay(page, path.as_uri()), record)
    assert page.evaluate("document.documentElement.dataset.theme") == "light", "as the system asks"
    assert [url for url in asked if not url.startswith("data:")] == [path.as_uri()]
    assert not errors
