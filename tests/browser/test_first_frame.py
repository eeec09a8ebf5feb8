"""Before its board comes, the page has its places: nothing moves when it comes.

Both boards stand level.
"""

import pytest

from tests.support.browser import AS_A_PERSON, NO_3D, WATCH_SHIFTS, free_port
from tests.support.nginx import PREFIXED

MOST_SHIFT = 0.05
SHIFT_OF_WORDS = 0.005
"""Of a label that gets its words, in a place that stays."""
FRAMES = """() => {
  window.frames_shown = []
  const frame = new MessageChannel()
  frame.port1.onmessage = () => {
    const boards = ['canvas-player', 'canvas-rival'].map((name) => {
      const { top, width } = document.querySelector(`[data-testid=${name}]`).getBoundingClientRect()
      return [Math.round(top), Math.round(width)]
    })
    if (boards[1][1]) window.frames_shown.push(boards)
  }
  const next = () => {
    frame.port2.postMessage(null)  // read once this frame is laid out and painted
    requestAnimationFrame(next)
  }
  requestAnimationFrame(next)
}"""


@pytest.mark.parametrize(
    ("width", "height"), [(1440, 900), (1024, 768), (820, 1180), (390, 844), (320, 568)]
)
@pytest.mark.parametrize("is_new", [True, False], ids=["first", "again"])
def test_nothing_moves_when_the_board_comes(server, player, width, height, is_new):
    me = player(server, NO_3D, width, height, is_new=is_new)
    me.page.add_init_script(WATCH_SHIFTS)
    me.goto()
    me.page.wait_for_timeout(500)
    assert me.page.evaluate("() => window.shift") < MOST_SHIFT


def test_nothing_moves_while_the_page_arrives_in_parts(serve, player, nginx):
    server, port = serve(trusted_proxies=["127.0.0.1"]), free_port()
    slowly = PREFIXED.replace("proxy_http_version", "limit_rate 60k; proxy_http_version")
    nginx(slowly.format(folder="{folder}", port=port, upstream=server.port))
    page = f"https://localhost:{port}/mars"
    me = player(page, NO_3D, 390, 844, is_new=False, ignore_https_errors=True)
    me.page.add_init_script(WATCH_SHIFTS)
    me.goto()
    assert me.page.evaluate("() => window.shift") < SHIFT_OF_WORDS


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (820, 1180), (390, 844), (320, 640)])
def test_nothing_moves_when_todays_board_comes(server, player, width, height):
    me = player(server, NO_3D, width, height, is_new=True, has_touch=width < 1000)
    me.page.add_init_script(WATCH_SHIFTS)
    me.page.goto(f"{server.url}/daily")
    me.page.locator(".prompt:not([hidden])").wait_for()
    me.page.wait_for_timeout(500)
    assert me.page.evaluate("() => window.shift") < MOST_SHIFT


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (1366, 768), (1024, 768), (820, 1180)])
def test_both_boards_stand_level_and_the_pad_goes_at_the_end(server, player, width, height):
    flags = [*NO_3D, *AS_A_PERSON]
    me = player(server, flags, width, height, has_touch=True, reduced_motion="reduce").goto()
    me.page.evaluate(FRAMES)
    me.wait("window.frames_shown.length")
    pad = me.page.get_by_test_id("pad-north")
    me.page.get_by_test_id("open-display").click()
    me.page.get_by_test_id("show-pad").check()
    me.page.get_by_test_id("close-display").click()
    pad.wait_for()
    me.page.get_by_test_id("mode-ranked").click()
    me.wait("window.playground.state.mode === 'ranked' && window.playground.state.link === 'open'")
    me.press("north")
    me.page.get_by_test_id("end-card").wait_for()
    pad.wait_for(state="hidden")
    me.wait("window.playground.state.rival")
    me.page.get_by_test_id("board-rival").wait_for()
    me.wait("document.querySelector('[data-testid=canvas-rival]').clientWidth > 200")
    me.page.evaluate("() => window.frames_shown.push('end')")
    me.wait("window.frames_shown.at(-1) !== 'end'")
    boards = [shown for shown in me.page.evaluate("() => window.frames_shown") if shown != "end"]
    assert [(mine, theirs) for mine, theirs in boards if mine != theirs] == []


LARGEST_NUMBERS = """() => {
  const head = document.querySelector("[data-testid=board-player] .board-head");
  head.querySelector("[data-part=steps]").textContent = "441";
  head.querySelector("[data-part=coverage]").textContent = "99.9";
  Object.assign(head.querySelector("[data-part=view]"), { hidden: false, textContent: "Matrix" });
  return head.offsetHeight;
}"""


def test_the_players_head_is_one_row_on_the_narrowest_screen(server, player):
    me = player(server, NO_3D, 320, 640, has_touch=True).goto()
    assert me.page.evaluate(LARGEST_NUMBERS) <= 44
