"""Browsers and networks that withhold something: a key's code, storage, sockets."""

import pytest

from tests.browser.test_attested import ATTESTED, begun, end, level_of, there_and_back
from tests.support.browser import AS_A_PERSON, KEY_OF, NO_3D, free_port
from tests.support.nginx import PREFIXED
from tests.support.study import freeze

BLOCKED = """for (const name of ["localStorage", "sessionStorage"]) Object.defineProperty(window, name, {
    get() { throw new DOMException("Access is denied for this document.", "SecurityError"); } });"""
MISSING = """for (const name of ["localStorage", "sessionStorage"])
    Object.defineProperty(window, name, { value: null });"""
FULL = """Storage.prototype.setItem = () => {
    throw new DOMException("exceeded the quota", "QuotaExceededError"); };"""
NONSENSE = """if (location.protocol.startsWith("http")) for (const storage of [localStorage, sessionStorage])
    for (const name of ["camera", "effects", "events", "keys", "pad", "played", "repeat", "session",
        "study.settings", "study.tiny.events", "tab", "theme", "tried", "view", "visited", "watch"])
        storage.setItem(`humanplay.${name}`, '[{"events": 7}, "\\u00e9 / ?", ' );"""
ARROWS_WITHOUT_CODE = {
    "east": {"key": "ArrowRight", "windowsVirtualKeyCode": 39},
    "west": {"key": "Left", "windowsVirtualKeyCode": 37},
    "north": {"key": "Unidentified", "windowsVirtualKeyCode": 38},
    "south": {"key": "s", "windowsVirtualKeyCode": 83},
}


def press_without_code(me, action):
    step = me.state()["step"]
    devtools = me.page.context.new_cdp_session(me.page)
    key = {"code": "", **ARROWS_WITHOUT_CODE[action]}
    devtools.send("Input.dispatchKeyEvent", {"type": "rawKeyDown", **key})
    devtools.send("Input.dispatchKeyEvent", {"type": "keyUp", **key})
    me.wait(f"window.playground.state.player.frame.step > {step}", 10_000)


def test_arrows_without_a_code_drive_and_count(serve, player, tmp_path):
    _, me = begun(serve, player)
    there, back = there_and_back(me)
    for action in (there, back, there, back):
        press_without_code(me, action)
        me.page.wait_for_timeout(120)
    assert level_of(tmp_path, end(me)) == ATTESTED


def test_the_arrows_of_a_number_pad_drive(serve, player):
    _, me = begun(serve, player)
    there, back = there_and_back(me)
    digit = {"north": 8, "east": 6, "south": 2, "west": 4}
    for action in (there, back):
        step = me.state()["step"]
        me.page.keyboard.press(f"Numpad{digit[action]}")
        me.wait(f"window.playground.state.player.frame.step > {step}", 10_000)


def test_a_key_is_chosen_by_pressing_it_drives_counts_and_is_remembered(serve, player, tmp_path):
    _, me = begun(serve, player)
    me.page.get_by_test_id("open-display").click()
    for action, key in zip(KEY_OF, "ilkj", strict=True):
        me.page.get_by_test_id(f"key-{action}-0").click()
        me.page.keyboard.press(key)
    assert me.page.get_by_test_id("key-north-0").inner_text() == "I"
    me.page.keyboard.press("Escape")
    me.page.reload()
    me.wait("window.playground.state.player && window.playground.state.link === 'open'")
    there, back = there_and_back(me)
    chosen = dict(zip(KEY_OF, "ilkj", strict=True))
    me.page.keyboard.press(KEY_OF[there])  # an arrow whose place was taken drives no more
    for action in (there, back, there, back, "north"):
        step = me.state()["step"]
        me.page.wait_for_timeout(120)
        me.page.keyboard.press(chosen[action])
        me.wait(f"window.playground.state.player.frame.step === {step + 1}", 10_000)
    assert level_of(tmp_path, me.state()["episode"]) == ATTESTED


@pytest.mark.parametrize("state", [BLOCKED, MISSING, FULL, NONSENSE])
def test_storage_in_a_bad_state_stops_nothing(serve, player, tmp_path, state):
    freeze(tmp_path / "playground.db-studies", name="tiny", size=(6, 8), pause_after_s=900)
    server = serve()
    me = player(server, [*NO_3D, *AS_A_PERSON])
    me.page.add_init_script(state)
    ready = "window.playground.state.link === 'open' && window.playground.state.player"
    for path in ("/", "/daily"):
        me.page.goto(server.url + path)
        me.wait(ready, 20_000)
        forgets = me.page.get_by_text("This browser keeps nothing for this page")
        assert forgets.count() == (state != NONSENSE)
        there, _ = there_and_back(me)
        me.press(there)
        forgets.wait_for(state="detached")  # a move has dismissed it
    me.page.goto(f"{server.url}/study/tiny?PROLIFIC_PID=p-77")
    me.wait("window.study.screen === 'consent'", 20_000)
    assert me.page.url == f"{server.url}/study/tiny"
    me.page.get_by_test_id("agree").click()
    me.page.get_by_test_id("to-tutorial").click()
    me.wait("window.study.screen === 'play' && window.study.state.game.link === 'open'", 20_000)
    me.page.keyboard.press("ArrowDown")
    me.page.keyboard.press("ArrowRight")
    me.wait("window.study.state.game.player.frame.step > 0", 20_000)
    for path in ("/leaderboard", "/me", "/about"):
        me.page.goto(server.url + path)
    assert me.errors == []


def test_a_browser_that_keeps_nothing_is_told_what_it_forgets(serve, player):
    me = player(serve(), NO_3D)
    me.page.add_init_script(BLOCKED)
    me.page.goto(f"{me.url}/")
    me.page.get_by_text("so your settings are forgotten when you leave it").wait_for(timeout=20_000)


def test_a_proxy_that_holds_sockets_back_is_named_with_what_to_ask(serve, player, nginx):
    server, port = serve(trusted_proxies=["127.0.0.1"]), free_port()
    without = PREFIXED.replace("proxy_set_header Upgrade $http_upgrade;", "")
    without = without.replace("proxy_set_header Connection $connection_upgrade;", "")
    assert without.count("proxy_set_header") == 2
    without = without.format(folder="{folder}", port=port, upstream=server.port)
    nginx(without)
    me = player(f"https://localhost:{port}/mars", NO_3D, ignore_https_errors=True)
    me.page.goto(f"{me.url}/")
    me.page.get_by_text("pass on the headers Upgrade and Connection").wait_for(timeout=20_000)
    me.page.goto(f"{server.url}/")
    me.wait("window.playground.state.link === 'open'")
    assert me.page.get_by_text("pass on the headers").count() == 0
