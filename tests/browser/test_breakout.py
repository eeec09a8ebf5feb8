"""Breakout in a real browser: time runs, keys are held, the board pauses."""

import re
import sqlite3
from contextlib import closing

import pytest
from playwright.sync_api import expect

from humanplay.board import clock
from humanplay.study.verification import verify_database
from tests.support.browser import AS_A_PERSON, NO_3D, keep_picture, violations
from tests.support.servers import eventually

pytest.importorskip("ale_py")
BREAKOUT = "gymnasium:ale_py:ALE/Breakout-v5"


def clock_is(me, state):
    me.wait(f"window.playground.state.player.clock?.state === '{state}'")


def step(me):
    return me.state()["step"]


def test_breakout_is_played_by_held_keys_and_buttons(serve, player, tmp_path, monkeypatch):
    monkeypatch.setattr(clock, "STALL_S", 60)  # the machine that tests may be busy
    server = serve(task=BREAKOUT)
    me = player(server, [*NO_3D, *AS_A_PERSON]).goto()
    page = me.page
    card = page.get_by_test_id("clock")
    assert "Time runs here: 60 frames a second" in card.inner_text()
    for width, height in ((390, 844), (1440, 900)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
        keep_picture(page, f"breakout-{width}")
    assert violations(page) == []
    page.keyboard.press("ArrowLeft")
    expect(card).to_have_text(re.compile("[123]"))
    clock_is(me, "running")
    expect(card).not_to_be_visible()
    page.keyboard.down("Space")
    me.wait("window.playground.state.player.frame.step > 20")
    page.keyboard.up("Space")
    page.keyboard.down("ArrowRight")
    at = step(me)
    me.wait(f"window.playground.state.player.frame.step > {at + 20}")
    page.keyboard.up("ArrowRight")
    page.get_by_test_id("open-help").click()
    clock_is(me, "standing")  # a dialog lets it stand still
    page.keyboard.press("Escape")
    expect(card).to_contain_text("Paused")
    card.click()
    clock_is(me, "running")
    page.evaluate("document.body.dataset.pad = 'true'")
    box = page.get_by_test_id("pad-left").bounding_box()
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    page.mouse.down()
    at = step(me)
    me.wait(f"window.playground.state.player.frame.step > {at + 20}")
    page.mouse.move(0, 0)  # off the button: it is let go
    page.mouse.up()
    at = step(me)
    me.wait(f"window.playground.state.player.frame.step > {at + 10}")
    episode = me.state()["episode"]
    page.reload()
    clock_is(me, "standing")
    assert me.state()["episode"] == episode
    assert me.errors == []
    with closing(sqlite3.connect(tmp_path / "playground.db")) as conn:
        moves = conn.execute("SELECT action, input, driver FROM steps ORDER BY step").fetchall()
    fire, right, left = 1, 2, 3
    held = {(fire, "key", "human"), (right, "key", "human"), (left, "touch", "human")}
    assert {*moves} >= {(0, None, "human"), *held}
    assert moves[-1] == (0, None, "human")
    session = page.evaluate("() => window.playground.state.player.session")
    next_one = f"{server.url}/api/sessions/{session}/episodes"
    answer = page.request.post(next_one, data={}, headers={"Origin": server.url})
    assert answer.status == 201
    server.stop()
    with closing(sqlite3.connect(tmp_path / "playground.db")) as conn:
        sql = "SELECT driver, attestation, attestation_reason FROM episodes WHERE id = ?"
        assert eventually(lambda: conn.execute(sql, [episode]).fetchone()) == ("human", "attested", None)  # fmt: skip
    assert verify_database(tmp_path / "playground.db").findings == ()
