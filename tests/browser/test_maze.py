"""A world of one's own in a real browser.

It is played to its end and watched again, with its daily maze and leaderboard.
"""

import pytest

from humanplay import ROOT
from humanplay.task.registration import WORLDS, environment_of, register
from humanplay.web.simulate import NoisyPolicy
from tests.support.browser import AS_A_PERSON, NO_3D, keep_picture, violations
from tests.support.servers import eventually

SIZES = {"390": (390, 844), "1440": (1440, 900)}


@pytest.fixture
def maze(monkeypatch):
    """The example, registered for this test."""
    monkeypatch.setenv(WORLDS, "")
    return register(ROOT / "examples" / "worlds" / "maze")


def play(me, maze):
    """Play the board to its end by keys, as a policy would, and return its last frame."""
    environment = environment_of(maze)
    policy = NoisyPolicy(environment, "far-wall", 0.0, None)
    policy.reset()
    while not (frame := me.state())["outcome"]:
        key = environment.keys[policy.choose(frame)][0]
        me.hand.press(me.page.keyboard, key)
        me.wait(f"window.playground.state.player.frame.step > {frame['step']}")
    me.page.get_by_test_id("end-card").wait_for()
    return frame


def check_screen(page, name):
    """The page fits each size, names no rover, and axe finds nothing.

    A picture of it is kept.
    """
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(300)
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth"), size
        keep_picture(page, f"maze-{name}-{size}", full_page=True)
    text = page.locator("main").inner_text()
    for word in ("terrain", "rover", "lidar", "mapped", "99 %", "Expert", "north-west"):
        assert word not in text, (name, word)
    assert violations(page) == []


def test_a_world_of_ones_own_is_played_watched_again_and_compared(serve, player, maze):
    server = serve(task=maze)
    me = player(server, [*NO_3D, *AS_A_PERSON]).goto()
    page = me.page
    board = page.locator("[data-testid=board-player] canvas[role=img]").first
    assert "column 1 after 0 moves" in board.get_attribute("aria-label")
    check_screen(page, "start")
    frame = play(me, maze)
    assert (
        page.get_by_test_id("end-title").inner_text()
        == f"Reached the goal in {frame['step']} moves"
    )
    check_screen(page, "end")

    page.goto(f"{server.url}/replay/{frame['episode']}")
    me.wait("window.replay?.ghost?.name === 'far-wall'")
    page.get_by_test_id("to-end").click()
    me.wait("window.replay.step === window.replay.playback.last")
    page.get_by_test_id("expert").check()
    page.get_by_test_id("step-back").click()
    advice = page.get_by_test_id("advice")
    eventually(lambda: "needs 1 move from here" in advice.inner_text())
    check_screen(page, "replay")

    page.goto(f"{server.url}/daily")
    me.wait("window.playground?.state.link === 'open' && window.playground.state.player")
    assert page.get_by_test_id("goal").inner_text().startswith("Find the way to the green goal")
    check_screen(page, "daily-start")
    moves = play(me, maze)["step"]
    assert page.get_by_test_id("end-title").inner_text() == f"{moves} moves"
    policies = page.get_by_test_id("policies")
    eventually(lambda: f"Far Wall\n{moves} moves" in policies.inner_text())
    eventually(lambda: "still playing" not in policies.inner_text())
    assert "first person today" in page.get_by_test_id("end-note").inner_text()
    check_screen(page, "daily-end")

    page.goto(f"{server.url}/leaderboard")
    page.get_by_test_id("named").wait_for()
    page.get_by_role("heading", name="Moves behind Far Wall").wait_for()
    check_screen(page, "leaderboard-people")
    page.get_by_test_id("view-policies").click()
    page.get_by_test_id("evaluate").click()
    rank = page.get_by_test_id("rank-far-wall")
    eventually(lambda: "100 %" in rank.inner_text())
    assert "100 mazes" in rank.inner_text()
    check_screen(page, "leaderboard-policies")

    page.goto(f"{server.url}/me")
    page.get_by_test_id("history").wait_for()
    assert "came to the goal in 2 mazes" in page.get_by_test_id("sentence").inner_text()
    eventually(lambda: page.locator("[data-testid=pictures] li").count() == 1)
    page.wait_for_load_state("networkidle")
    assert page.get_by_test_id("tries").is_hidden(), "a way to a goal shows nothing new"
    check_screen(page, "me")
    assert me.errors == []
