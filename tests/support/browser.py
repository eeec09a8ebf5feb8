"""What the browser tests share: Chromium, its options, and the pictures' folder."""

import os
import random
import shutil
import socket
import time
from contextlib import suppress
from pathlib import Path

from axe_playwright_python.base import AXE_SCRIPT
from playwright import sync_api

from humanplay.board.attestation import FASTEST
from tests.support.servers import PATIENCE_S, eventually

SCREENSHOTS = Path(__file__).parents[1] / "browser" / "screenshots"
"""Where pictures of the screens go, when TESTS_PICTURES is set."""

KEY_OF = {"north": "ArrowUp", "east": "ArrowRight", "south": "ArrowDown", "west": "ArrowLeft"}
QUIET = [
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run", "--no-sandbox",
]  # fmt: skip
SOFTWARE_3D = ["--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
NO_3D = ["--disable-gpu", "--disable-3d-apis"]
AS_A_PERSON = ["--disable-blink-features=AutomationControlled"]
"""The page never calls a driven browser's keys human; tests of what a person's keys do take that mark away."""
WATCH_SHIFTS = """(() => {
  window.shift = 0
  new PerformanceObserver((list) => {
    for (const entry of list.getEntries()) if (!entry.hadRecentInput) window.shift += entry.value
  }).observe({ type: 'layout-shift', buffered: true })
})()"""
"""Adds up how much of a page has moved by itself."""
STANDING = """() => {
  const state = (window.playground ?? window.study)?.state, game = state?.game ?? state
  return JSON.stringify({
    address: location.pathname, screen: window.study?.screen, link: game?.link, step: game?.player?.frame?.step,
    painted: window.study?.painted?.game?.player?.frame?.step, outcome: game?.player?.frame?.outcome,
    paused: state?.isPaused, focus: document.activeElement?.outerHTML.slice(0, 200),
    dialogs: [...document.querySelectorAll("dialog[open]")].map(({ innerText }) => innerText.slice(0, 200)),
    says: [...document.querySelectorAll("[role=alert], [role=status]")].map(({ innerText }) => innerText.slice(0, 200)),
  })
}"""
"""How a page stands, for whoever reads why a test waited in vain."""


CHROMIUMS = ("chromium-headless-shell", "chromium", "google-chrome", "chromium-browser")
"""The first that is installed is taken: without windows Chromium loads a page at half the cost."""


def chromium_path():
    """Return where Chromium is, or None."""
    return next(filter(None, map(shutil.which, CHROMIUMS)), None)


def free_port():
    """Return a free port below those that the system hands out."""
    while True:
        port = random.randrange(20_000, 32_000)
        with socket.socket() as sock, suppress(OSError):
            sock.bind(("127.0.0.1", port))
            return port


ANIMATED = """() => Promise.allSettled(document.getAnimations()
    .filter((each) => each.effect.getComputedTiming().iterations < Infinity).map((each) => each.finished))"""


def violations(page, **options):
    """What axe finds on a page at rest: "rule: what it is (first place)"."""
    if not page.evaluate("() => 'axe' in window"):
        page.evaluate(AXE_SCRIPT)
    page.evaluate(ANIMATED)
    # the default rules look at nothing preloaded
    wanted = {"resultTypes": ["violations"], "preload": False, **options}
    run = "options => axe.run(options).then(({ violations }) => violations)"
    broken_rules = page.evaluate(run, wanted)
    return [
        f"{rule['id']}: {rule['help']} ({rule['nodes'][0]['html'][:120]})" for rule in broken_rules
    ]


def keep_picture(page, name, full_page=False):
    """Keep a picture of a screen for people to look at, when TESTS_PICTURES is set."""
    if os.environ.get("TESTS_PICTURES"):
        SCREENSHOTS.mkdir(exist_ok=True)
        page.screenshot(path=SCREENSHOTS / f"{name}.png", full_page=full_page)


SIZES = {"phone": (390, 844), "desktop": (1440, 900)}


def judge(page, name, full_page=False):
    """What axe finds on a screen at both sizes, and where it is too wide.

    A picture of each is kept.
    """
    faults = []
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        faults += [f"{name}, {size}: {violation}" for violation in violations(page)]
        reached = page.evaluate("() => document.documentElement.scrollWidth")
        faults += [f"{name}, {size}: {reached} px wide"] if reached > width else []
        keep_picture(page, f"{name}-{size}", full_page)
    return faults


def fetched(page, url):
    """GET with the page's cookies, once more if an idle connection was just closed."""
    return page.request.get(url, max_retries=1)


class Hand:
    """A person's pace: fast for a moment, and no faster than a hand can (`FASTEST`)."""

    def __init__(self):
        self._pressed_s = []

    def press(self, keyboard, key):
        """Press a key as soon as a hand can.

        The times are those after each press, so the page had taken it by then: however busy the machine is, the page sees
        no presses closer together than these.
        """
        limits = [limit for limit in FASTEST if limit[0] <= len(self._pressed_s) + 1]
        rested = [
            self._pressed_s[1 - presses] + 1.1 * least_ms / 1000 for presses, least_ms in limits
        ]
        time.sleep(max(0.0, max(rested, default=0.0) - time.monotonic()))
        keyboard.press(key)
        self._pressed_s.append(time.monotonic())


class Player:
    """A person at the page: presses keys, looks at boards."""

    def __init__(self, page, url):
        self.page, self.url, self.hand = page, url, Hand()
        self.errors = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    def goto(self, watch=None):
        self.page.goto(self.url + ("/" if watch is None else f"/#watch={watch}"))
        self.wait(
            "window.playground && window.playground.state.player && window.playground.state.link === 'open'"
        )
        return self

    def wait(self, claim, timeout_ms=1000 * PATIENCE_S):
        """Wait until an expression is true; an error while a page loads counts as false."""
        claim = f"() => {{ try {{ return Boolean({claim}) }} catch (error) {{ return false }} }}"
        try:
            self.page.wait_for_function(claim, timeout=timeout_ms)
        except sync_api.TimeoutError as error:
            with suppress(sync_api.Error):
                standing = self.page.locator("html").evaluate(STANDING, timeout=5000)
                error.add_note(f"{claim} was still false: {standing}")
            raise

    def state(self, path="player.frame"):
        return self.page.evaluate(f"() => window.playground.state.{path}")

    def open_session(self, **wish):
        """Open a session with the page's cookie; return the server's answer."""
        origin = "/".join(self.url.split("/")[:3])
        url, headers = f"{self.url}/api/sessions", {"Origin": origin}
        answer = self.page.request.post(url, data=wish, headers=headers, max_retries=1)
        assert answer.status in (200, 201), answer.text()
        return answer.json()

    def begin(self, **wish):
        """Open a session of one's own and look at it."""
        about = self.open_session(**wish)
        self.page.goto("about:blank")
        self.goto(about["watch"])
        return about

    def press(self, action, wait=True):
        # a page that is starved of time may call its server lost
        self.wait("window.playground.state.link === 'open'")
        step = self.state()["step"]
        self.hand.press(self.page.keyboard, KEY_OF[action])
        if wait:
            self.wait(f"window.playground.state.player.frame.step > {step}")

    def explore(self, policy, until):
        """Drive as a policy would, key by key, until `until(frame)`."""
        from humanplay.tasks.mars.run import occupancy_codes

        policy.reset(0)
        while not until(frame := self.state()):
            self.press(("north", "east", "south", "west")[policy.act(occupancy_codes(frame))])
        return frame

    def picture(self, test_id):
        """The pixels of an element as they are on screen."""
        return self.page.get_by_test_id(test_id).screenshot()

    def still(self, test_id, looks=4):
        """The pixels of an element once they have stayed the same for some looks in a row."""
        seen = []

        def is_still():
            self.page.wait_for_timeout(100)
            seen.append(self.picture(test_id))
            return len(seen) >= looks and len(set(seen[-looks:])) == 1

        eventually(is_still, 60)
        return seen[-1]

    def changes(self, test_id, before):
        """Wait until the pixels of an element are others than those before."""
        eventually(lambda: self.picture(test_id) != before)

    def shows(self, test_id, text):
        """Wait until an element says just that: a page paints after its state changes."""
        eventually(lambda: self.page.get_by_test_id(test_id).inner_text() == text)
