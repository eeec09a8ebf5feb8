"""A real Chromium in front of a real server."""

from pathlib import Path

import pytest

from tests.support.browser import QUIET, SOFTWARE_3D, Player, chromium_path
from tests.support.servers import PATIENCE_S


def pytest_collection_modifyitems(items):
    for item in items:
        if "browser" in Path(item.fspath).parts:
            item.add_marker(pytest.mark.browser)
            if chromium_path() is None:
                packages = "`apt-get install chromium-headless-shell` or `chromium`"
                reason = f"NO CHROMIUM: install it ({packages}) to run the browser tests"
                item.add_marker(pytest.mark.skip(reason=reason))


class Browsers:
    """Chromium with each set of flags that tests ask for.

    Each is started once, and used by all tests of this folder.
    """

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
    """Close the browsers after the browser tests.

    Otherwise the driver's event loop would be in the way of other tests' own.
    """
    del item
    if nextitem is None or "browser" not in Path(nextitem.fspath).parts:
        BROWSERS.close()


@pytest.fixture
def open_browser():
    """`open_browser(flags)` is Chromium without any profile.

    Every profile that a test opens is closed at its end.
    """

    def start(flags=()):
        drawing = () if "--disable-3d-apis" in flags else SOFTWARE_3D
        return BROWSERS.start((*QUIET, *drawing, *flags))

    yield start
    for browser in BROWSERS.started.values():
        for profile in list(browser.contexts):
            profile.close()


@pytest.fixture
def player(open_browser):
    """`player(server, ...)` opens the page in a fresh browser profile.

    It is that of a returning visitor, unless `is_new`.
    """

    def start(server, flags=(), width=1440, height=900, is_new=False, **context):
        browser = open_browser(flags)
        profile = browser.new_context(viewport={"width": width, "height": height}, **context)
        if not is_new:
            visited = 'localStorage.setItem("humanplay.visited", "yes")'
            profile.add_init_script(f'if (location.protocol.startsWith("http")) {visited}')
        profile.set_default_timeout(1000 * PATIENCE_S)
        return Player(profile.new_page(), server if isinstance(server, str) else server.url)

    return start
