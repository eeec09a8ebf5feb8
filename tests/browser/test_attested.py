"""Whatever a person does at a real browser is attested.

Keys, mouse, fingers, typing ahead, reloads, lost connections.
"""

import resource
import sqlite3
from contextlib import closing

import pytest

from tests.browser.test_study_page import Participant
from tests.support.browser import AS_A_PERSON, KEY_OF, NO_3D
from tests.support.servers import eventually
from tests.support.study import freeze

ACTIONS = ("north", "east", "south", "west")


def level_of(tmp_path, episode):
    """Return (driver, attestation, reason) of an episode that has ended."""
    with closing(sqlite3.connect(tmp_path / "playground.db")) as db:
        sql = "SELECT driver, attestation, attestation_reason FROM episodes WHERE id = ? AND ended_ms IS NOT NULL"
        return eventually(lambda: db.execute(sql, [episode]).fetchone())


ATTESTED = ("human", "attested", None)


def there_and_back(me):
    """Two actions that can be repeated for ever from the start."""
    return ("east", "west") if me.state()["grid"][0][1] == "." else ("south", "north")


def click_into_the_view(me):
    box = me.page.get_by_test_id("viewer-player").bounding_box()
    me.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert me.page.evaluate("() => document.activeElement.tagName") == "IFRAME"


def begun(serve_or_spawn, player, flags=NO_3D, **context):
    """Return a server and a person at a ranked board of theirs."""
    server = serve_or_spawn()
    me = player(server, [*flags, *AS_A_PERSON], **context)
    me.begin(size=[9, 12])
    return server, me


def end(me):
    """Drive off the grid from the start, and return the episode's id."""
    me.press("north")
    return me.state()["episode"]


def click(me, action, how):
    step = me.state()["step"]
    me.page.wait_for_timeout(80)
    how(me.page.get_by_test_id(f"pad-{action}"))
    me.wait(f"window.playground.state.player.frame.step > {step}")


def test_a_disk_that_was_full_in_the_middle_of_play(spawn, player, tmp_path):
    """The page says that a move was not made, and why.

    Once there is room, the next key press moves, without a reload.
    """
    server, me = begun(spawn, player)
    there, back = there_and_back(me)
    me.press(there)
    pid, limit = server.process.pid, resource.RLIMIT_FSIZE
    before = resource.prlimit(pid, limit)
    resource.prlimit(pid, limit, (4096, before[1]))
    me.press(back, wait=False)
    notice = me.page.get_by_test_id("notices").get_by_text("nothing changed")
    notice.wait_for(state="visible")
    assert "the database playground.db did not take the write" in notice.inner_text()
    assert me.state()["step"] == 1
    resource.prlimit(pid, limit, before)
    me.press(back)
    assert me.state()["step"] == 2
    assert level_of(tmp_path, end(me)) == ATTESTED
    assert me.errors == []


def test_mouse_clicks_on_the_arrows_and_enter_on_them(serve, player, tmp_path):
    _, me = begun(serve, player)
    me.page.evaluate("() => { document.body.dataset.pad = 'true'; }")
    there, back = there_and_back(me)
    click(me, there, lambda arrow: arrow.click())
    click(me, back, lambda arrow: (arrow.focus(), me.page.keyboard.press("Enter")))
    click(me, there, lambda arrow: (arrow.focus(), me.page.keyboard.press("Space")))
    click(me, back, lambda arrow: arrow.click(delay=60))
    assert level_of(tmp_path, end(me)) == ATTESTED
    assert me.errors == []


def swipe(me, action):
    """Draw a finger over the board, as long as it takes for a page to scroll."""
    fingers = me.page.context.new_cdp_session(me.page)
    box = me.page.get_by_test_id("canvas-player").bounding_box()
    down, right = {"north": (-1, 0), "east": (0, 1), "south": (1, 0), "west": (0, -1)}[action]
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    ways = [(x + 12 * part * right, y + 12 * part * down) for part in range(9)]
    for kind, (at_x, at_y) in zip(["touchStart", *["touchMove"] * 8], ways, strict=True):
        touch = {"type": kind, "touchPoints": [{"x": at_x, "y": at_y}]}
        fingers.send("Input.dispatchTouchEvent", touch)
    fingers.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_taps_and_swipes_on_a_phone(serve, player, tmp_path):
    _, me = begun(serve, player, width=390, height=844, has_touch=True, is_mobile=True)
    there, back = there_and_back(me)
    click(me, there, lambda arrow: arrow.tap())
    click(me, back, lambda arrow: arrow.tap())
    thumbs, points = me.page.context.new_cdp_session(me.page), []
    step = me.state()["step"]
    for action in (there, back):  # the second comes down before the first is up
        box = me.page.get_by_test_id(f"pad-{action}").bounding_box()
        points.append({"x": box["x"] + 20, "y": box["y"] + 20, "id": len(points)})
        me.page.wait_for_timeout(150)
        thumbs.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": points})
    thumbs.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    me.wait(f"window.playground.state.player.frame.step === {step + 2}")
    me.page.evaluate("() => { document.body.style.minHeight = '3000px'; }")
    for action in (there, back, there, back):
        step = me.state()["step"]
        swipe(me, action)
        me.wait(f"window.playground.state.player.frame.step === {step + 1}")
    stays = me.page.evaluate("() => [scrollX, scrollY, visualViewport.scale]")
    assert stays == [0, 0, 1]
    assert level_of(tmp_path, end(me)) == ATTESTED


@pytest.mark.long
def test_typing_ahead_in_bursts(serve, player, tmp_path):
    _, me = begun(serve, player)
    there, back = there_and_back(me)
    for _ in range(4):
        step = me.state()["step"]
        for action in (there, back, there, back):
            me.page.keyboard.press(KEY_OF[action])
        me.wait(f"window.playground.state.player.frame.step === {step + 4}")
        me.page.wait_for_timeout(400)
    assert level_of(tmp_path, end(me)) == ATTESTED


@pytest.mark.long
def test_reloads_and_a_second_tab_in_the_middle_of_an_episode(serve, player, tmp_path):
    _, me = begun(serve, player)
    there, back = there_and_back(me)
    # with the first load and the second tab four, as many as an episode may have within seconds
    for _ in range(2):
        me.press(there)
        me.press(back)
        me.page.reload()
        me.wait(
            "window.playground && window.playground.state.player && window.playground.state.link === 'open'"
        )
    tab = type(me)(me.page.context.new_page(), me.url)
    tab.page.goto(me.page.url)
    tab.wait(
        "window.playground && window.playground.state.player && window.playground.state.link === 'open'"
    )
    for who in (tab, me, tab, me):
        steps = who.state()["step"]
        who.press(there if steps % 2 == 0 else back)
        for other in (me, tab):
            other.wait(f"window.playground.state.player.frame.step === {steps + 1}")
    assert level_of(tmp_path, end(me)) == ATTESTED


@pytest.mark.long
def test_a_connection_lost_in_the_middle(spawn, player, tmp_path):
    server, me = begun(spawn, player)
    there, back = there_and_back(me)
    me.press(there)
    server.kill()
    for action in (back, there, back):
        me.page.keyboard.press(KEY_OF[action])  # lost, and their events are not
    me.wait("window.playground.state.link === 'lost'")
    again = spawn(port=server.port)
    me.wait("window.playground.state.link === 'open'")
    assert me.state()["step"] == 1
    me.press(back)
    me.press(there)
    me.press(back)
    assert level_of(tmp_path, end(me)) == ATTESTED
    again.kill()


@pytest.mark.long
def test_keys_inside_the_3d_view(serve, player, tmp_path):
    _, me = begun(serve, player, flags=())
    me.page.frame_locator("[data-testid=viewer-player]").locator("canvas").first.wait_for()
    click_into_the_view(me)
    there, back = there_and_back(me)
    for action in (there, back, there, back):
        me.press(action)
    assert level_of(tmp_path, end(me)) == ATTESTED


def test_remapped_keys_in_a_study(serve, open_browser, tmp_path):
    freeze(tmp_path / "playground.db-studies", name="tiny", size=(6, 8), pause_after_s=900)
    server = serve()
    page = open_browser([*NO_3D, *AS_A_PERSON]).new_context().new_page()
    me = Participant(page, server.url).goto()
    me.choose("agree")
    me.stands("instructions")
    me.choose("open-settings")
    for number, key in enumerate("ijkl"):
        me.choose(f"key-{ACTIONS[number]}-0")
        me.page.keyboard.press(key)
    me.page.keyboard.press("Escape")
    me.choose("to-tutorial")
    me.driving()
    me.keys = dict(zip(ACTIONS, "ijkl", strict=True))
    frame = me.explore()
    assert level_of(tmp_path, frame["episode"]) == ATTESTED
    assert me.errors == []


def test_without_events_the_page_says_that_its_episode_does_not_count(serve, player, tmp_path):
    _, me = begun(serve, player)
    me.page.evaluate("""() => { const send = WebSocket.prototype.send;
        WebSocket.prototype.send = function (text) { if (!text.includes('"kind":"events"')) send.call(this, text); }; }""")
    reason = "step 0: no press of its own was received before the move"
    assert level_of(tmp_path, end(me)) == ("human", "unattested", reason)
    me.page.get_by_text("This episode does not count").first.wait_for()
    me.wait("!window.playground.state.counts")
