"""What a person does with the page, checked against the database and the export.

In a real browser on a real server.
"""

import csv
import io
import itertools
import os
import signal
import sqlite3
from contextlib import closing

import numpy as np
import pytest

from humanplay.board.messages import RepeatProgress
from marsexplorer import policies
from tests.browser.test_attested import click_into_the_view, there_and_back
from tests.support.browser import AS_A_PERSON, KEY_OF, NO_3D, fetched, keep_picture
from tests.support.map_files import WAREHOUSE, write_map
from tests.support.servers import eventually

SMALL = (1010, 540)
"""A screen that the processor soon draws in 3-D."""
MATRIX_HAS_THE_STAGE = """() => {
  const find = (name) => document.querySelector(`[data-testid=${name}-player]`);
  return find("viewer").dataset.drawn ? null : find("canvas").clientHeight > 0.8 * find("stage").clientHeight;
}"""


def test_keys_drive_inside_and_outside_the_3d_view_and_every_step_is_kept(serve, player, tmp_path):
    server = serve()
    me = player(server, AS_A_PERSON, *SMALL)
    asked = []
    me.page.on("request", lambda request: asked.append(request.url))
    about = me.begin(size=[9, 12])
    me.page.frame_locator("[data-testid=viewer-player]").locator("canvas").first.wait_for()
    # until the board is drawn in 3-D there is a matrix to play on, then it is a small map in a corner
    assert me.page.evaluate(MATRIX_HAS_THE_STAGE) in (True, None)
    me.page.locator("[data-testid=viewer-player][data-drawn]").wait_for()
    stage, _ = boxes_of(me.page, "stage-player", "canvas-player")
    # it draws back into its corner
    eventually(lambda: boxes_of(me.page, "canvas-player")[0]["width"] < stage["width"] / 3)

    # the map lies on the stage
    view, matrix = me.still("stage-player"), me.picture("canvas-player")
    there, back = there_and_back(me)
    me.press(there)
    me.changes("canvas-player", matrix)
    me.changes("stage-player", view)  # the rover moves in the 3-D view

    click_into_the_view(me)
    view, matrix = me.still("stage-player"), me.picture("canvas-player")
    me.press(back)
    assert me.state()["position"] == [0, 0]
    me.changes("canvas-player", matrix)
    me.changes("stage-player", view)

    assert not [url for url in asked if url.endswith("/api/health")], (
        "an open socket needs no polls"
    )
    corner = "() => document.querySelector('[data-testid=board-player]').dataset.corner"
    assert me.page.evaluate(corner) == "north-east"

    # from here on the matrix alone
    me.page.route("**/viewer/**", lambda route: route.fulfill(body=""))
    me.page.reload()
    me.wait("window.playground?.state.player?.trail.length === 3")
    assert me.state()["step"] == 2, "a reload goes on where the episode stood"

    policy = policies.load("frontier-cost")
    frame = me.explore(policy, lambda frame: frame["outcome"])
    assert frame["outcome"] == "explored"
    me.page.get_by_test_id("end-card").wait_for(state="visible")
    moves = frame["step"]
    assert_map_is_beside_the_route(me)

    table = fetched(me.page, f"{server.url}/api/export/steps.csv?who=human").text()
    exported = list(csv.DictReader(io.StringIO(table)))
    assert len(exported) == moves
    sql = "select step, action, input from steps where episode_id = ? order by step"
    with closing(sqlite3.connect(tmp_path / "playground.db")) as db:
        steps = db.execute(sql, [frame["episode"]]).fetchall()
    assert [row[0] for row in steps] == list(range(moves))
    assert {row[2] for row in steps} == {"key"}
    words = ["north", "east", "south", "west"]
    assert [row["action"] for row in exported] == [words[row[1]] for row in steps]
    assert [words[row[1]] for row in steps[:2]] == [there, back]
    level = fetched(me.page, f"{server.url}/api/human-level").json()["figures"]
    assert [(figure["players"], figure["episodes"]) for figure in level] == [(1, 1)]

    me.page.keyboard.press("Enter")
    me.wait(f"window.playground.state.player.frame.episode !== '{frame['episode']}'")
    assert me.state()["step"] == 0
    assert me.page.url.endswith(f"#watch={about['watch']}"), "the board keeps its link"
    assert about["session"] not in me.page.url
    assert me.errors == []


def assert_map_is_beside_the_route(me):
    """The small map covers a corner where the rover never was, or it is hidden."""
    corner = me.page.get_by_test_id("board-player").get_attribute("data-corner")
    frame = me.state()
    down, across = [np.array(axis) for axis in zip(*me.state("player.trail"), strict=True)]
    down = down if corner.startswith("north") else frame["rows"] - 1 - down
    across = across if corner.endswith("west") else frame["cols"] - 1 - across
    is_covered = (down < frame["rows"] / 4) & (across < frame["cols"] / 4)
    assert corner == "none" or not is_covered.any()


@pytest.mark.long
def test_on_a_tablet_the_small_map_covers_neither_the_rover_nor_its_way(serve, player, tmp_path):
    server = serve(maps=(write_map(tmp_path),), cell_m=1.0)
    me = player(server, AS_A_PERSON, 820, 1180, reduced_motion="reduce")
    me.begin(map="warehouse", rival="frontier-cost")
    me.page.locator("[data-testid=viewer-player][data-drawn]").wait_for()
    for action in [*8 * ["north"], *13 * ["east"]]:  # from its south-west, along the north edge
        me.press(action)
    assert me.state()["outcome"] is None

    def covers():
        stage, small = boxes_of(me.page, "stage-player", "canvas-player")
        is_small = small["width"] < stage["width"] / 3
        return is_small, small["y"] > stage["y"] + stage["height"] / 2

    eventually(lambda: covers() == (True, True))
    assert me.page.evaluate("() => document.documentElement.scrollWidth") == 820
    assert me.errors == []


def test_a_driven_browser_is_never_human(serve, player):
    server = serve()
    me = player(server, NO_3D)
    me.begin(size=[5, 7])
    me.press("north")
    assert me.state()["outcome"] == "out_of_bounds"
    assert fetched(me.page, f"{server.url}/api/human-level").json()["figures"] == []
    episodes = fetched(me.page, f"{server.url}/api/episodes").json()
    drivers = {episode["driver"] for episode in episodes}
    assert "script" in drivers
    assert "human" not in drivers


def test_a_rival_follows_the_player_and_keeps_its_own_pace_when_asked_to(serve, player):
    server = serve()
    me = player(server, NO_3D)
    me.begin(rival="frontier-cost", size=[15, 21])
    policy = policies.load("frontier-utility")
    me.explore(policy, lambda frame: frame["step"] == 10)
    me.wait("window.playground.state.rival.frame.step === 10")
    me.shows("steps-player", "10")
    me.shows("steps-rival", "10")
    assert me.page.get_by_test_id("badge").is_hidden(), "nothing counts beside a policy"

    me.page.get_by_test_id("pace-timed-rival").click()
    me.wait("window.playground.state.rival.frame.step > 14")
    assert me.state()["step"] == 10
    me.page.get_by_test_id("pace-paused-rival").click()
    me.wait("window.playground.state.rival.pace.mode === 'paused'")
    me.page.wait_for_timeout(400)
    paused = me.state("rival.frame")["step"]
    me.page.get_by_test_id("pace-step-rival").click()
    me.wait(f"window.playground.state.rival.frame.step === {paused + 1}")
    me.page.wait_for_timeout(500)
    assert me.state("rival.frame")["step"] == paused + 1
    assert me.errors == []


def test_holding_a_key_in_ranked_play_moves_once_and_typing_moves_never(serve, player):
    server = serve()
    me = player(server, NO_3D)
    me.begin(size=[15, 21], seed=3)
    for _ in range(4):
        me.page.keyboard.down(KEY_OF["east"])
    me.page.keyboard.up(KEY_OF["east"])
    me.wait("window.playground.state.player.frame.step === 1")
    me.page.get_by_test_id("open-settings").click()
    me.page.get_by_test_id("seed").click()
    me.page.keyboard.type("wasd77")
    me.page.keyboard.press("ArrowLeft")
    me.page.keyboard.press("Escape")
    me.page.wait_for_timeout(300)
    assert me.state()["step"] == 1


def test_watching_two_policies_and_then_on_a_map(serve, player, tmp_path):
    server = serve(maps=(write_map(tmp_path, cells=WAREHOUSE[:6, :7]),), cell_m=1.0)
    me = player(server, NO_3D)
    me.goto()
    me.page.get_by_test_id("mode-watch").click()
    me.wait(
        "window.playground.state.mode === 'watch' && window.playground.state.player.frame.step > 3"
    )
    me.wait("window.playground.state.rival.frame.step > 3")
    assert "99 % of the ground" in me.page.get_by_test_id("goal").inner_text()

    me.page.get_by_test_id("open-settings").click()
    pictures = me.page.get_by_test_id("level-pictures").get_by_role("button")
    assert pictures.all_inner_texts() == ["Open", "Scattered", "Boulders", "Building", "Cave"]
    pictures.filter(has_text="Cave").click()
    assert me.page.get_by_test_id("level").input_value() == "cave"
    me.page.get_by_test_id("more-levels").click()
    me.page.get_by_role("button", name="warehouse").click()
    assert {button.get_attribute("aria-pressed") for button in pictures.all()} == {"false"}
    assert me.page.get_by_test_id("seed").is_hidden(), "a map has a terrain of its own"
    me.page.get_by_test_id("start").click()
    me.wait("window.playground.state.level === 'warehouse'")
    me.wait("window.playground.state.player.frame.outcome === 'explored'")
    frame = me.state()
    assert frame["discovered"] <= frame["cells"] < frame["rows"] * frame["cols"]
    assert "99 % of what can be seen" in me.page.get_by_test_id("goal").inner_text()
    share = 100 * frame["discovered"] // frame["cells"]
    assert f"{share} percent" in me.page.get_by_test_id("chart").get_attribute("aria-label")
    me.page.reload()
    me.wait("window.playground.state.level === 'warehouse'")
    me.wait("document.querySelector('[data-testid=level]').value === 'map:warehouse'")
    assert me.errors == []


def test_a_lost_server_is_shown_within_two_seconds_and_heals_by_itself(spawn, player):
    server = spawn()
    me = player(server, NO_3D)
    me.begin(size=[9, 12], seed=3, rival="frontier-cost")
    me.press("east")
    server.kill()
    me.page.keyboard.press("ArrowDown")
    me.wait("window.playground.state.link === 'lost'", 2_000)
    again = spawn(port=server.port)
    me.wait("window.playground.state.link === 'open'")
    assert me.state()["step"] == 1
    me.press("east")
    eventually(lambda: me.state()["step"] == 2)

    sockets = []
    me.page.on("websocket", lambda socket: sockets.append(socket.url))
    os.kill(again.process.pid, signal.SIGSTOP)
    me.page.keyboard.press(KEY_OF["west"])
    me.wait("window.playground.state.link === 'lost'")  # its answer is overdue
    os.kill(again.process.pid, signal.SIGCONT)
    me.wait(
        "window.playground.state.link === 'open' && window.playground.state.player.frame.step === 3"
    )
    # a server that was only slow keeps its connection
    assert not [url for url in sockets if "/ws/sessions/" in url]
    again.kill()


def test_a_server_that_answers_while_the_browser_is_offline_is_not_lost(serve, player):
    me = player(serve(), NO_3D)
    me.begin(size=[9, 12], seed=3)
    went = "dispatchEvent(new Event('offline')), window.playground.state.link"
    assert me.page.evaluate(went) == "lost"
    me.wait("window.playground.state.link === 'open'")
    me.shows("link", "live")
    me.press("east")
    assert me.state()["step"] == 1


def test_a_page_says_how_far_an_environment_that_was_lost_is_made_again(serve, player):
    server = serve()
    me = player(server, NO_3D)
    about = me.begin(size=[9, 12], seed=3)
    session = server.services.lobby.in_memory(about["session"])

    async def tell():
        session.remade = RepeatProgress(episode=about["frame"]["episode"], done=2, of=5)
        session.channel.notify()

    server.on_loop(tell())
    sentence = "The environment was lost. It is made again: move 2 of 5."
    me.page.get_by_test_id("clock").get_by_text(sentence).wait_for()
    me.press("east")
    me.page.get_by_test_id("clock").wait_for(state="hidden")


def test_a_size_that_is_not_asked_for_any_more_holds_nothing_up(serve, player):
    me = player(serve(), NO_3D).goto()
    me.page.get_by_test_id("open-settings").click()
    me.page.get_by_test_id("size-custom").check()
    me.page.get_by_test_id("rows").fill("3")
    me.page.get_by_role("radio", name="42").check()
    me.page.get_by_test_id("start").click()
    me.wait("window.playground.state.player.frame.rows === 42")
    assert me.errors == []


def test_enter_at_the_end_opens_what_has_the_focus(serve, player):
    me = player(serve(), NO_3D)
    me.begin(size=[9, 12])
    me.press("north")
    episode = me.state()["episode"]
    me.page.get_by_test_id("end-card").wait_for(state="visible")
    me.page.get_by_test_id("open-settings").focus()
    me.page.keyboard.press("Enter")
    me.page.get_by_test_id("terrain-dialog").wait_for(state="visible")
    assert me.state()["episode"] == episode


def test_a_second_tab_is_harmless(serve, player):
    server = serve()
    me = player(server, NO_3D)
    about = me.begin(size=[9, 12], seed=3)
    tab = type(me)(me.page.context.new_page(), me.url)
    tab.goto(about["watch"])
    me.press("east")
    tab.wait("window.playground.state.player.frame.step === 1")
    tab.press("west")
    me.wait("window.playground.state.player.frame.step === 2")
    me.press("east")
    assert me.state()["position"] == [0, 1]


def boxes_of(page, *test_ids):
    return [page.get_by_test_id(test_id).bounding_box() for test_id in test_ids]


def fits(page, test_ids, width, height):
    """These elements are wholly on the screen, without scrolling.

    It is checked once a canvas has taken the size of its place.
    """

    def is_whole(box):
        right, end = box["x"] + box["width"], box["y"] + box["height"]
        return box["x"] >= 0 and right <= width + 1 and end <= height + 1

    eventually(lambda: all(box and is_whole(box) for box in boxes_of(page, *test_ids)))
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width


def whole(page, *test_ids):
    """Nothing covers these elements: at each of their corners they are what is seen."""
    seen = """(element) => {
      const { left, right, top, bottom } = element.getBoundingClientRect();
      const corners = [[left, top], [right, top], [left, bottom], [right, bottom]];
      return corners.every(([x, y]) => {
        const [across, along] = [Math.sign((left + right) / 2 - x), Math.sign((top + bottom) / 2 - y)];
        return element.contains(document.elementFromPoint(x + 6 * across, y + 6 * along));
      });
    }"""
    assert [
        test_id for test_id in test_ids if not page.get_by_test_id(test_id).evaluate(seen)
    ] == []


def apart(page, *test_ids):
    """None of these elements covers another."""
    for one, other in itertools.permutations(boxes_of(page, *test_ids), 2):
        shared = [
            min(one[at] + one[side], other[at] + other[side]) - max(one[at], other[at])
            for at, side in (("x", "width"), ("y", "height"))
        ]
        assert min(shared) <= 0, test_ids


@pytest.mark.parametrize(("name", "flags"), [("desktop", ()), ("no-webgl", NO_3D)])
def test_mid_episode_looks_like_a_product(serve, player, name, flags):
    server = serve()
    me = player(server, flags)
    me.begin(seed=11, rival=policies.names()[0])
    frame = me.explore(policies.load("frontier-utility"), lambda frame: frame["step"] == 3)
    me.wait(f"window.playground.state.rival.frame.step >= {frame['step']}")
    keep_picture(me.page, name)
    shown = ("board-player", "board-rival", "chart", "steps-player", "steps-rival")
    fits(me.page, shown, 1440, 900)
    apart(me.page, "board-player", "board-rival", "chart")
    board, stage = boxes_of(me.page, "board-player", "stage-player")
    assert stage["width"] * stage["height"] > 0.8 * board["width"] * board["height"]
    assert me.errors == []


def test_a_phone_shows_one_board_at_a_time_and_a_tablet_both(serve, player):
    phone = {"device_scale_factor": 2, "has_touch": True, "reduced_motion": "reduce"}
    me = player(serve(), NO_3D, 390, 844, **phone)
    me.begin(size=[9, 12], rival="frontier-cost")
    page = me.page
    names = (
        "board-player",
        "steps-player",
        "canvas-player",
        "pad-north",
        "pad-south",
        "daily-link",
    )
    names = (*names, "leaderboard-link")
    fits(page, names, 390, 844)
    apart(page, "board-player", "pad-north")
    whole(page, "daily-link", "leaderboard-link")
    assert page.get_by_test_id("board-rival").is_hidden()
    page.get_by_test_id("tab-rival").click()
    assert page.get_by_test_id("board-player").is_hidden()
    theirs = ("board-rival", "steps-rival", "canvas-rival", "pick-rival", "pace-paused-rival")
    fits(page, theirs, 390, 844)
    page.get_by_test_id("tab-map").click()
    fits(page, ("canvas-player", "canvas-rival", "chart", "pad-south"), 390, 844)
    apart(page, "board-player", "board-rival", "chart", "pad-north")
    page.set_viewport_size({"width": 820, "height": 1180})
    fits(page, ("board-player", "board-rival", "chart", "pad-south"), 820, 1180)
    apart(page, "board-player", "board-rival", "chart", "pad-north", "pad-east")
    assert me.errors == []
