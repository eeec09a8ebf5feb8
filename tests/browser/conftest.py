"""A real Chromium in front of a real server."""

from pathlib import Path

import pytest

from app.web.simulate import occupancy_codes
from tests.support.browser import KEY_OF, QUIET, SOFTWARE_3D, Hand, chromium_path
from tests.support.servers import PATIENCE_S, eventually


def pytest_collection_modifyitems(items):
    for item in items:
        if "browser" in Path(item.fspath).parts:
            item.add_marker(pytest.mark.browser)
            if chromium_path() is None:
                why = (
                    "NO CHROMIUM: install it (`apt-get install chromium-headless-shell` or `chromium`) to run the browser "
                    "tests"
                )
                item.add_marker(pytest.mark.skip(reason=why))


class Browsers:
    """Chromium with each set of flags that the tests ask for: started once, used by all tests of this folder."""

    def __init__(self):
        self.started = {}
        self._driver = None

    def start(self, flags):
        if self._driver is None:
            from playwright.sync_api import sync_playwright

            self._driver = sync_playwright().start()
        if flags not in self.started:
            self.started[flags] = self._driver.chromium.launch(
                executable_path=chromium_path(), headless=True, args=list(flags)
            )
        return self.started[flags]

    def close(self):
        for browser in self.started.values():
            browser.close()
        self.started = {}
        if self._driver is not None:
            self._driver.stop()
        self._driver = None


BROWSERS = Browsers()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item, nextitem):
    """Close the browsers after a run of browser tests: the driver's event loop would be in the way of other tests' own."""
    del item
    if nextitem is None or "browser" not in Path(nextitem.fspath).parts:
        BROWSERS.close()


@pytest.fixture
def open_browser():
    """`open_browser(flags)` is Chromium without any profile; every profile that a test opens is closed at its end."""

    def start(flags=()):
        return BROWSERS.start(
            (*QUIET, *(flags if "--disable-3d-apis" in flags else [*SOFTWARE_3D, *flags]))
        )

    yield start
    for browser in BROWSERS.started.values():
        for profile in list(browser.contexts):
            profile.close()


class Player:
    """A person at the page: presses keys, looks at boards."""

    def __init__(self, page, url):
        self.page, self.url, self.hand = page, url, Hand()
        self.errors = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    def goto(self, watch=None):
        self.page.goto(self.url + ("/" if watch is None else f"/#watch={watch}"))
        self.wait("window.mars && window.mars.state.player && window.mars.state.link === 'open'")
        return self

    def wait(self, claim, timeout_ms=1000 * PATIENCE_S):
        self.page.wait_for_function(f"() => Boolean({claim})", timeout=timeout_ms)

    def state(self, path="player.frame"):
        return self.page.evaluate(f"() => window.mars.state.{path}")

    def open_session(self, **wish):
        """Open a session of one's own (the page's cookie) and return what the server says of it."""
        origin = "/".join(self.url.split("/")[:3])
        answer = self.page.request.post(
            f"{self.url}/api/sessions", data=wish, headers={"Origin": origin}
        )
        assert answer.status in (200, 201), answer.text()
        return answer.json()

    def begin(self, **wish):
        """Open a session of one's own and look at it."""
        about = self.open_session(**wish)
        self.page.goto("about:blank")
        self.goto(about["watch"])
        return about

    def press(self, action, wait=True):
        self.wait(
            "window.mars.state.link === 'open'"
        )  # a page that is starved of time may call its server lost
        step = self.state()["step"]
        self.hand.press(self.page.keyboard, KEY_OF[action])
        if wait:
            self.wait(f"window.mars.state.player.frame.step > {step}")

    def explore(self, policy, until):
        """Drive as a policy would, key by key, until `until(frame)`."""
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
        """Wait until an element says just that: the page paints in the frame after its state has changed."""
        eventually(lambda: self.page.get_by_test_id(test_id).inner_text() == text)


@pytest.fixture
def player(open_browser):
    """`player(server, ...)` opens the page in a fresh browser profile, of somebody who has been here before unless `is_new`."""

    def start(server, flags=(), width=1440, height=900, is_new=False, **context):
        browser = open_browser(flags)
        profile = browser.new_context(viewport={"width": width, "height": height}, **context)
        if not is_new:
            profile.add_init_script(
                'if (location.protocol.startsWith("http")) localStorage.setItem("mars.visited", "yes")'
            )
        profile.set_default_timeout(1000 * PATIENCE_S)
        return Player(profile.new_page(), server if isinstance(server, str) else server.url)

    return start
