"""What the browser tests share: where Chromium is, how it is started, where pictures go."""

import os
import random
import shutil
import socket
import time
from contextlib import suppress
from pathlib import Path

from axe_playwright_python.base import AXE_SCRIPT

from app.board.attestation import FASTEST

SCREENSHOTS = Path(__file__).parents[1] / "browser" / "screenshots"
"""Where pictures of the screens go, when MARS_PICTURES is set."""

KEY_OF = {"north": "ArrowUp", "east": "ArrowRight", "south": "ArrowDown", "west": "ArrowLeft"}
QUIET = [
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--no-sandbox",
]
SOFTWARE_3D = ["--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
NO_3D = ["--disable-gpu", "--disable-3d-apis"]
AS_A_PERSON = ["--disable-blink-features=AutomationControlled"]
"""The page never calls a driven browser's keys human; tests of what a person's keys do take that mark away."""


CHROMIUMS = ("chromium-headless-shell", "chromium", "google-chrome", "chromium-browser")
"""The first that is installed is taken: without windows Chromium loads a page at half the cost."""


def chromium_path():
    """Return where Chromium is, or None."""
    return next(filter(None, map(shutil.which, CHROMIUMS)), None)


def free_port():
    """Return a port nobody listens on, below those that the system hands out meanwhile."""
    while True:
        port = random.randrange(20_000, 32_000)
        with socket.socket() as sock, suppress(OSError):
            sock.bind(("127.0.0.1", port))
            return port


def violations(page, **options):
    """What axe finds on the page as it stands: "rule: what it is (first place)"."""
    if not page.evaluate("() => 'axe' in window"):
        page.evaluate(AXE_SCRIPT)
    wanted = {
        "resultTypes": ["violations"],
        "preload": False,
        **options,
    }  # the default rules look at nothing preloaded
    found = page.evaluate(
        "options => axe.run(options).then(({ violations }) => violations)", wanted
    )
    return [f"{each['id']}: {each['help']} ({each['nodes'][0]['html'][:120]})" for each in found]


def keep_picture(page, name, full_page=False):
    """Keep a picture of a screen for people to look at, when MARS_PICTURES is set."""
    if os.environ.get("MARS_PICTURES"):
        SCREENSHOTS.mkdir(exist_ok=True)
        page.screenshot(path=SCREENSHOTS / f"{name}.png", full_page=full_page)


class Hand:
    """A person's pace: as fast as a hand can be for a moment, and no faster than it can keep up (`FASTEST`)."""

    def __init__(self):
        self._pressed_s = []

    def press(self, keyboard, key):
        """Press a key as soon as a hand can.

        The times are those after each press, so the page had taken it by then: however busy the machine is, the page sees
        no presses closer together than these.
        """
        rested = [
            self._pressed_s[1 - presses] + 1.1 * least_ms / 1000
            for presses, least_ms in FASTEST
            if presses <= len(self._pressed_s) + 1
        ]
        time.sleep(max(0.0, max(rested, default=0.0) - time.monotonic()))
        keyboard.press(key)
        self._pressed_s.append(time.monotonic())
