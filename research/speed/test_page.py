"""The page in real Chromium: to the first picture, and from keydown to repaint."""

import json
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest

pytest.importorskip("axe_playwright_python", reason="of the extra `dev`: `make bench` has it")

from humanplay.tasks.mars.run import occupancy_codes
from marsexplorer import policies
from tests.support.browser import KEY_OF, NO_3D, QUIET, SOFTWARE_3D, chromium_path

pytestmark = [pytest.mark.bench, pytest.mark.skipif(chromium_path() is None, reason="NO CHROMIUM")]

PRESSES = 300
"""The policy makes 385 moves on the terrain of 42x42."""
MOST_MS = {42: 50, 84: 100}
"""Side of the grid in cells -> what p95 is to stay under."""

OPENINGS = 4
WANTED_S = {"playable": 1.0, "drawn": 2.5}
"""On an idle machine; reported, since they are absolute times."""
MOST_BYTES = {"matrix alone": 300_000, "matrix and 3-D by the processor": 900_000}
WATCH = """(() => {
  const look = () => {
    const mars = window.playground
    if (!window.playable && mars?.state.player?.frame && mars.state.link === 'open') window.playable = performance.now()
    if (!window.drawn && document.querySelector('[data-testid=viewer-player][data-drawn]')) window.drawn = performance.now()
    requestAnimationFrame(look)
  }
  requestAnimationFrame(look)
})()"""


DRAWN = pytest.mark.parametrize(
    ("drawn", "flags"), [("matrix alone", NO_3D), ("matrix and 3-D by the processor", SOFTWARE_3D)]
)


@contextmanager
def page_in_browser(flags):
    """A page in a browser of its own, with nothing in its cache."""
    from playwright.sync_api import sync_playwright

    options = {"executable_path": chromium_path(), "headless": True, "args": [*QUIET, *flags]}
    with sync_playwright() as playwright, playwright.chromium.launch(**options) as browser:
        yield browser.new_page(viewport={"width": 1440, "height": 900})


def sent(event):
    return event["encodedDataLength"]


def note(sizes, size, event):
    """Note a request's bytes; a data URL is part of the file that holds it."""
    if event["requestId"] in sizes or event.get("request", {}).get("url", "data:")[:5] != "data:":
        sizes[event["requestId"]] = size(event)


@DRAWN
def test_first_picture(spawn, drawn, flags):
    server, seen = spawn(), []
    for _ in range(OPENINGS):
        with page_in_browser(flags) as page:
            page.add_init_script(WATCH)
            network, sizes = page.context.new_cdp_session(page), {}
            network.send("Network.enable")
            for event, size in (("requestWillBeSent", lambda _: 0), ("loadingFinished", sent)):
                network.on(f"Network.{event}", partial(note, sizes, size))
            page.goto(server.url)
            ready = "window.playable" if flags is NO_3D else "window.playable && window.drawn"
            page.wait_for_function(f"() => {ready}")
            page.wait_for_timeout(1500)
            times = page.evaluate("() => [window.playable / 1e3, (window.drawn ?? 0) / 1e3]")
            seen.append((*times, sum(sizes.values())))
    playable, picture, weight = zip(*seen, strict=True)
    print(f"\n\n{OPENINGS} first visits, {drawn}: {max(weight):,.0f} bytes")
    for stage, times in [("playable", playable), ("drawn", picture)][: 1 if flags is NO_3D else 2]:
        print(f"{stage} after {min(times):.2f} to {max(times):.2f} s, wanted {WANTED_S[stage]}")
    assert max(weight) < MOST_BYTES[drawn]


@pytest.mark.parametrize("side", MOST_MS)
@DRAWN
def test_keydown_to_repaint(spawn, drawn, flags, side):
    server, policy = spawn(), policies.load("frontier-cost")
    with page_in_browser(flags) as page:
        page.goto(server.url)
        # the cookie is there: the next board is the same player's
        page.wait_for_function("() => window.playground?.state.player")
        asked = page.request.post(f"{server.url}/api/sessions", data={"size": side, "seed": 3})
        about = asked.json()
        page.goto("about:blank")
        page.goto(f"{server.url}/#watch={about['watch']}")
        is_open = "window.playground?.state.player && window.playground.state.link === 'open'"
        page.wait_for_function(f"() => {is_open}")
        assert page.evaluate("() => window.playground.state.player.session") == about["session"]
        policy.reset(0)
        for number in range(PRESSES):
            text = page.evaluate("() => JSON.stringify(window.playground.state.player.frame)")
            codes = occupancy_codes(json.loads(text))
            page.keyboard.press(KEY_OF[("north", "east", "south", "west")[policy.act(codes)]])
            page.wait_for_function(f"() => window.playground.latencies.length > {number}")
        times = np.array(page.evaluate("() => window.playground.latencies"))
    print(f"\n\nkeydown to repaint over {len(times)} presses at {side}x{side}, {drawn}: ", end="")
    print(", ".join(f"p{p} {np.percentile(times, p):.1f} ms" for p in (50, 95, 99)))
    assert np.percentile(times, 95) < MOST_MS[side]
