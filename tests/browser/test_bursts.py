"""Every key press is answered or visibly dropped.

Bursts without pauses, a held key, presses after the end, and Enter there.
"""

import asyncio
import time

from humanplay.web.protection import LimitedClients
from tests.browser.test_attested import ATTESTED, level_of, there_and_back
from tests.support.browser import AS_A_PERSON, KEY_OF, NO_3D
from tests.support.servers import eventually

PRESSES = 40
FASTEST_GAP_S = 0.065
"""As fast as a hand keeps up for three seconds (`humanplay.board.attestation.FASTEST`)."""


COUNT_DROPPED = """() => {
  const mark = document.querySelector("[data-testid=dropped]");
  let cause = "", counted = 0;
  window.dropped = 0;
  const read = () => {
    const [reason, count] = mark.hidden ? ["", ""] : mark.textContent.split(": ");
    const now = reason.split(" before ")[0];
    if (now !== cause) counted = 0; // the mark counts anew for another cause, and once it was hidden
    window.dropped += (parseInt(count) || 0) - counted;
    [cause, counted] = [now, parseInt(count) || 0];
  };
  new MutationObserver(read).observe(mark, { childList: true, characterData: true, subtree: true, attributes: true });
}"""
"""Adds up the presses that the mark on the board says were dropped, however long the burst takes."""


def burst_at_once(me, actions):
    """Press keys five milliseconds apart by the browser's clock.

    So a slow machine does not spread them.
    """
    keys = me.page.context.new_cdp_session(me.page)
    began_s = time.time()
    for number, action in enumerate(actions):
        for kind, late_ms in (("keyDown", 5 * number), ("keyUp", 5 * number + 2)):
            press = {"type": kind, "timestamp": began_s + late_ms / 1000}
            key = {"code": KEY_OF[action], "key": KEY_OF[action]}
            keys.send("Input.dispatchKeyEvent", press | key)


def burst(me, actions, gap_s):
    """Press keys without waiting for any answer."""
    for action in actions:
        pressed_s = time.monotonic()
        me.page.keyboard.press(KEY_OF[action])
        time.sleep(max(0.0, pressed_s + gap_s - time.monotonic()))


def test_a_burst_of_forty_loses_no_press(serve, player, tmp_path):
    me = player(serve(), [*NO_3D, *AS_A_PERSON])

    # in practice: to the first rock or edge that comes into sight, and the rest is dropped in sight
    me.begin(size=[9, 12], seed=3, rival="frontier-cost")
    there, back = there_and_back(me)
    me.page.evaluate(COUNT_DROPPED)
    burst_at_once(me, [there] * PRESSES)
    eventually(lambda: me.state()["step"] + me.page.evaluate("window.dropped") == PRESSES)
    stopped = me.state()
    assert stopped["outcome"] is None
    assert stopped["step"] > 2
    me.wait("document.getElementById('announcer').textContent.startsWith('Stopped before')")

    # a key that is held repeats, and stops before the edge by itself
    me.page.keyboard.down(KEY_OF[back])
    me.wait("window.playground.state.player.frame.position.join() === '0,0'")
    mark = me.page.get_by_test_id("dropped")
    eventually(lambda: "Stopped before the edge" in mark.text_content())
    assert me.state()["outcome"] is None
    assert me.state()["step"] == 2 * stopped["step"]
    me.page.keyboard.up(KEY_OF[back])

    # in ranked play each press is a move with an event of its own
    me.begin(size=[9, 12])
    there, back = there_and_back(me)
    burst(me, [there, back] * (PRESSES // 2), FASTEST_GAP_S)
    me.wait(f"window.playground.state.player.frame.step === {PRESSES}")

    # what comes after the end of an episode is dropped in sight
    burst(me, ["north"] * 5, FASTEST_GAP_S)
    eventually(lambda: "The episode has ended: 4 presses dropped." in mark.text_content())
    assert me.state()["outcome"] == "out_of_bounds"
    assert me.state()["step"] == PRESSES + 1
    episode = me.state()["episode"]
    assert level_of(tmp_path, episode) == ATTESTED

    # Enter goes on, also after a dialog and after a click on something else
    is_next = "document.activeElement.dataset.part === 'next'"
    me.page.get_by_test_id("open-settings").click()
    me.page.keyboard.press("Escape")
    me.wait(is_next)
    me.page.get_by_test_id("open-display").click()
    me.page.get_by_test_id("sound").click()
    me.page.get_by_test_id("close-display").click()
    me.wait(is_next)
    me.page.keyboard.press("Enter")
    me.wait(f"window.playground.state.player.frame.episode !== '{episode}'")
    assert me.errors == []


def test_a_press_waits_for_the_socket_of_a_new_session(serve, player, monkeypatch):
    """Each socket of this server opens late, as over a slow line."""
    admit = LimitedClients.__call__

    async def admit_late(self, scope, receive, send):
        await asyncio.sleep(0.7 if scope["type"] == "websocket" else 0)
        await admit(self, scope, receive, send)

    monkeypatch.setattr(LimitedClients, "__call__", admit_late)
    me = player(serve(), NO_3D)
    me.goto()
    me.page.get_by_test_id("mode-ranked").click()
    me.wait(
        "window.playground.state.mode === 'ranked' && window.playground.state.link === 'connecting'"
    )
    me.hand.press(me.page.keyboard, KEY_OF["south"])
    assert me.state("link") == "connecting", "the socket opened too soon for this test"
    me.wait("window.playground.state.player.frame.step === 1")
    assert me.page.get_by_test_id("dropped").text_content() == ""
    assert me.errors == []
