"""Measure a first and a second visit: `python -m research.speed.visits`.

A browser with nothing in its cache opens the page, and once more in a new tab, over a line that is throttled. Bytes are those
of the line; requests are those that it carries, answers from the browser's own cache left out. Needs Chromium, and nginx for
the rows behind it.
"""

from __future__ import annotations

import base64
import hashlib
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import click
from playwright.sync_api import Browser, BrowserContext, sync_playwright

from humanplay.command.console import print_table
from tests.support.browser import NO_3D, QUIET, WATCH_SHIFTS, chromium_path, free_port
from tests.support.command_server import command_server
from tests.support.nginx import PREFIXED, running_nginx, shipped

LATENCY_MS = 150
BITS_PER_S = 1_600_000
COMPILED_S = 300
"""For the first board of all, on a machine that has compiled nothing."""
SETTLED_MS = 2_000
"""After the first frame, so that what is loaded behind it is counted."""
WANTED = {"first": ("40", "150", "1.7", "0.05"), "second": ("8", "", "0.65", "0.05")}
"""At most."""
FIRST_FRAME = "performance.getEntriesByName('humanplay.first-frame')[0]?.startTime"


class Visit(NamedTuple):
    """What one opening of the page took."""

    requests: int
    kb: float
    first_frame_s: float
    shift: float


def visit(profile: BrowserContext, address: str) -> Visit:
    """Open the page in a new tab of a profile, over the throttled line."""
    page = profile.new_page()
    page.add_init_script(WATCH_SHIFTS)
    network, carried, sizes = page.context.new_cdp_session(page), set[str](), []
    network.send("Network.enable")
    line = BITS_PER_S / 8
    throttle = {"downloadThroughput": line, "uploadThroughput": line, "latency": LATENCY_MS}
    network.send("Network.emulateNetworkConditions", {"offline": False, **throttle})

    def note_answer(event: dict[str, Any]) -> None:
        response = event["response"]
        if not response.get("fromDiskCache") and not response["url"].startswith("data:"):
            carried.add(event["requestId"])

    def note_bytes(event: dict[str, Any]) -> None:
        if event["requestId"] in carried:
            sizes.append(event["encodedDataLength"])

    network.on("Network.responseReceived", note_answer)
    network.on("Network.loadingFinished", note_bytes)
    page.goto(address)
    page.wait_for_function(f"() => {FIRST_FRAME}", timeout=1000 * COMPILED_S)
    page.wait_for_timeout(SETTLED_MS)
    first_frame_ms, shift = page.evaluate(f"() => [{FIRST_FRAME}, window.shift]")
    page.close()
    return Visit(len(carried), sum(sizes) / 1000, first_frame_ms / 1000, shift)


def medians(visits: list[Visit]) -> list[float]:
    """Return the median of each figure, in the order of the printed columns."""
    return [statistics.median(column) for column in zip(*visits, strict=True)]


def measure(browser: Browser, address: str, rounds: int) -> dict[str, list[float]]:
    """Return the medians of first and of second visits to an address."""
    visits: dict[str, list[Visit]] = {"first": [], "second": []}
    for _ in range(rounds):
        profile = browser.new_context(viewport={"width": 1440, "height": 900})
        for name in visits:
            visits[name].append(visit(profile, address))
        profile.close()
    return {name: medians(rows) for name, rows in visits.items()}


@contextmanager
def places(folder: Path) -> Iterator[dict[str, str]]:
    """Yield a server's addresses: its own, below a prefix, and behind nginx."""
    front, plain, prefixed = free_port(), free_port(), free_port()
    public = f"https://localhost:{front}"
    command = [sys.executable, "-m", "humanplay.cli", "serve", "--port", "0"]
    command += ["--database", str(folder / "visits.db"), "--public-url", public]
    command += ["--trusted-proxy", "127.0.0.1"]
    with ExitStack() as stack:
        _, address = stack.enter_context(command_server(command))
        addresses = {"the server alone": address}
        if shutil.which("nginx"):
            port = int(address.rpartition(":")[2].strip("/"))
            below = PREFIXED.format(folder="{folder}", port=prefixed, upstream=port)
            stack.enter_context(running_nginx(folder / "prefix", below))
            stack.enter_context(running_nginx(folder / "nginx", shipped(front, plain, port)))
            addresses["below a prefix"] = f"https://localhost:{prefixed}/mars/"
            addresses["behind nginx"] = f"{public}/"
        yield addresses


def trusted_keys(folder: Path) -> str:
    """Return the certificates' key hashes: a browser caches nothing it does not trust."""
    hashes = []
    for path in folder.glob("*/certificate.pem"):
        command = f"openssl x509 -in {path} -noout -pubkey | openssl pkey -pubin -outform der"
        key = subprocess.run(command, shell=True, check=True, capture_output=True).stdout
        hashes.append(base64.b64encode(hashlib.sha256(key).digest()).decode())
    return ",".join(hashes)


@click.command()
@click.option(
    "--rounds", default=5, show_default=True, help="First and second visits to each place."
)
def main(rounds: int) -> None:
    """Measure two visits over a throttled line, and print medians beside the targets."""
    rows = []
    with tempfile.TemporaryDirectory() as name, places(Path(name)) as addresses:
        trusted = f"--ignore-certificate-errors-spki-list={trusted_keys(Path(name))}"
        with (
            sync_playwright() as playwright,
            playwright.chromium.launch(
                executable_path=chromium_path(), args=[*QUIET, *NO_3D, trusted]
            ) as browser,
        ):
            for place, address in addresses.items():
                measure(browser, address, 1)  # what the server does once is not a visit's
                for order, figures in measure(browser, address, rounds).items():
                    rows.append((place, order, *(f"{value:.3g}" for value in figures)))
    title = f"Visits at {LATENCY_MS} ms and {BITS_PER_S / 1e6:g} Mbit/s, medians of {rounds}"
    rows += [("at most", order, *wanted) for order, wanted in WANTED.items()]
    print_table(title, ("place", "visit", "requests", "kB", "first frame, s", "shift"), rows)


if __name__ == "__main__":
    main()
