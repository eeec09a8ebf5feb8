"""Boards of other environments: key to picture, and twelve at 60 ticks a second.

    python -m research.speed.real_time [--presses 100] [--boards 12] [--seconds 60] [--json FILE]

First a person presses keys in a real Chromium: FourRooms and Crafter in turns, Breakout in real
time, as far as installed. In turns a time goes from the key's event to the task after the animation
frame with the picture of the move. In real time it has two parts: from the key to the tick that took
it, and from that tick to the task after the animation frame with its picture. Beside these stands
what step and picture take the environment itself, as `humanplay doctor` measures them.
Then `--boards` people play Breakout for `--seconds`, the server and its boards' processes on
one core and the people on another, chain and commits on. The exit code is 1 where a board makes
fewer than 59 ticks a second, or `verify` finds something. Wants a quiet machine.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import secrets
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import httpx
import numpy as np
from websockets.asyncio.client import connect

from humanplay.board.controls import COUNTDOWN_S, late_share
from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.doctor import examine
from tests.support.browser import AS_A_PERSON, NO_3D, QUIET, chromium_path, free_port

if TYPE_CHECKING:
    from playwright.sync_api import Page

ROOMS, CRAFTER, BREAKOUT = (
    "minigrid:MiniGrid-FourRooms-v0", "humanplay.tasks.gymnasium.adapters:Crafter-v0", "ale_py:ALE/Breakout-v5",
)  # fmt: skip
IN_TURNS_MS, FROM_TICK_MS, TO_TICK_MS = 20.0, 25.0, 3.0
"""What p95 is to stay under on a quiet machine: from key, or tick, to picture beside what step and
picture take the environment, and from key to tick beside one tick."""
PACKAGES = {CRAFTER: "crafter"}
"""What an environment needs where its module is ours."""
LEAST_RATE = 59.0
WATCH = """() => {
  const img = document.querySelector("img.picture");
  const now = () => performance.timeOrigin + performance.now();
  let seen = -1;
  window.pictures = [];
  window.since = performance.now();
  const look = () => {
    setTimeout(() => {
      const { step, picture } = window.playground.state.player.frame;
      // a picture that is complete at once is decoded and shown with the frame that sets it
      if (step !== seen && img.complete && img.src === picture) window.pictures.push([seen = step, now()]);
    });
    requestAnimationFrame(look);
  };
  look();
}"""


class Press(NamedTuple):
    """A key that went down.

    to_tick_ms     to the tick that took it; None in turns
    to_picture_ms  from there, or from the key, to the picture that shows it
    """

    to_tick_ms: float | None
    to_picture_ms: float


@contextmanager
def served(env: str, folder: Path, cores: set[int] | None = None) -> Iterator[tuple[str, int]]:
    """Yield the address and the process of a server of an environment.

    It is kept on some cores if they are named.
    """
    port, database = free_port(), folder / "boards.db"
    command = [sys.executable, "-m", "humanplay.cli", "serve", "--env", env, "--port", str(port)]
    command += ["--database", str(database)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        if cores is not None:
            os.sched_setaffinity(process.pid, cores)  # before it has begun others
        url = f"http://127.0.0.1:{port}"
        deadline = time.monotonic() + 120
        while True:
            try:
                httpx.get(f"{url}/healthz")
                break
            except httpx.HTTPError as error:
                if time.monotonic() > deadline or process.poll() is not None:
                    raise RuntimeError(f"no server of {env}") from error
                time.sleep(0.2)
        yield url, process.pid
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        process.wait(60)


class Log(NamedTuple):
    """What a page noted while keys were pressed.

    origin_ms  beginning of its clock, since the epoch
    since_ms   by its clock, from when on keys count
    pictures   steps of the frames that were shown, and when, since the epoch
    """

    episode: str
    origin_ms: float
    since_ms: float
    pictures: list[tuple[int, float]]


def press_keys(page: Page, presses: int) -> Log:
    """Press arrows at a person's pace on a board that is open."""
    page.wait_for_function(
        "() => document.querySelector('img.picture')?.complete && "
        "window.playground.state.link === 'open'"
    )
    keys = page.evaluate("() => Object.values(window.playground.state.task.keys).flat()")
    keys = [key for key in keys if key in ("ArrowLeft", "ArrowRight")]
    if page.evaluate("() => window.playground.state.task.clock !== null"):
        page.keyboard.press(keys[0])
        page.wait_for_function("() => window.playground.state.player.clock.state === 'running'")
    page.evaluate(WATCH)
    dice = random.Random(1)
    for number in range(presses):
        key = keys[number % len(keys)]
        page.keyboard.down(key)
        page.wait_for_timeout(dice.randint(90, 150))
        page.keyboard.up(key)
        page.wait_for_timeout(dice.randint(150, 250))
    noted = (
        "() => [window.playground.state.player.frame.episode, performance.timeOrigin, "
        "window.since, window.pictures]"
    )
    return Log(*page.evaluate(noted))


def presses_of(log: Log, database: Path, has_clock: bool) -> list[Press]:
    """The presses of a log that a picture shows."""
    with closing(sqlite3.connect(database)) as conn:
        sql = """SELECT client_ms, server_ms, step FROM input_events WHERE episode_id = ?
            AND kind = 'keydown' AND NOT repeat AND client_ms >= ? ORDER BY number"""
        downs = conn.execute(sql, [log.episode, log.since_ms]).fetchall()
        sql = "SELECT server_ms, step FROM steps WHERE episode_id = ? ORDER BY step"
        ticks = conn.execute(sql, [log.episode]).fetchall()
    presses = []
    for client_ms, came_ms, on_screen in downs:
        key_ms = log.origin_ms + client_ms
        from_ms, step = key_ms, on_screen
        if has_clock:
            # an event belongs to the ticks after it
            from_ms, step = next((tick for tick in ticks if tick[0] > came_ms), (key_ms, np.inf))
        shown_ms = next((at_ms for shown, at_ms in log.pictures if shown > step), None)
        if shown_ms is not None:
            presses.append(Press(from_ms - key_ms if has_clock else None, shown_ms - from_ms))
    return presses


def played(env: str, presses: int) -> list[Press]:
    """The presses of a person who plays in a browser; RuntimeError without a server."""
    from playwright.sync_api import sync_playwright

    options = {"executable_path": chromium_path(), "args": [*QUIET, *NO_3D, *AS_A_PERSON]}
    with tempfile.TemporaryDirectory() as folder:
        with (
            served(env, Path(folder)) as (url, _),
            sync_playwright() as playwright,
            playwright.chromium.launch(**options) as browser,
        ):
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            page.goto(url)
            log = press_keys(page, presses)
        has_clock = environment_of(f"gymnasium:{env}").clock is not None
        return presses_of(log, Path(folder) / "boards.db", has_clock)


def p95_of(times_ms: Iterable[float]) -> float:
    """Print the median and p95 of some times, and return p95."""
    p50, p95 = np.percentile([*times_ms], (50, 95))
    print(f"p50 {p50:.1f}, p95 {p95:.1f} ms", end="")
    return float(p95)


def measure_presses(env: str, presses: int) -> dict[str, float]:
    """The times of an environment's presses, which it prints too."""
    times = played(env, presses)
    figures: dict[str, float] = {"presses": len(times)}
    print(f"{env}, {len(times)} of {presses} presses", end="")
    if not times:
        print()
        return figures
    task = f"gymnasium:{env}"
    examination = examine(task, seeds=1, steps=200)
    own_ms = examination.step_ms + examination.picture_ms
    clock, begins, most_ms = environment_of(task).clock, "key", IN_TURNS_MS
    if clock:
        begins, most_ms = "tick", FROM_TICK_MS
        print("; from key to the tick that took it: ", end="")
        ticks = [press.to_tick_ms for press in times if press.to_tick_ms is not None]
        figures["to_tick_p95_ms"] = p95_of(ticks)
        print(f", wanted {1000 / clock + TO_TICK_MS:.1f}", end="")
    print(f"; from {begins} to picture: ", end="")
    figures["to_picture_p95_ms"] = p95_of(press.to_picture_ms for press in times)
    figures["environment_ms"] = own_ms
    above_ms = figures["to_picture_p95_ms"] - own_ms
    print(f", {above_ms:.1f} above the {own_ms:.1f} of step and picture, wanted {most_ms:g}")
    return figures


async def _play(url: str, number: int, seconds: float, begun: asyncio.Barrier) -> str:
    """Play a board for some seconds, with a new key three times a second.

    Return its episode.
    """
    dice, browser = random.Random(number), httpx.AsyncClient(base_url=url, headers={"Origin": url})
    board = (await browser.post("/api/sessions", json={}, timeout=60)).json()
    cookie = "; ".join(f"{stored.name}={stored.value}" for stored in browser.cookies.jar)
    at = f"{url.replace('http', 'ws')}/ws/sessions/{board['session']}"
    plain: dict[str, Any] = {"compression": None, "proxy": None, "origin": url}
    episode: str = board["frame"]["episode"]
    async with connect(at, additional_headers={"Cookie": cookie}, **plain) as socket:
        step, down = 0, ""
        load = {"page_load": secrets.token_hex(16), "tab": secrets.token_hex(16)}

        async def send(*events: tuple[str, str | None]) -> None:
            now = round(time.monotonic() * 1000, 1)
            sent = [
                {
                    "kind": kind,
                    "code": code,
                    "repeat": False,
                    "trusted": True,
                    "client_ms": now,
                    "step": step,
                }
                for kind, code in events
            ]
            batch = {"episode": episode, "batch": secrets.token_hex(8), "events": sent}
            await socket.send(json.dumps({"kind": "events", **batch, **load}))

        async def read() -> None:
            nonlocal step
            async for text in socket:
                if (message := json.loads(text))["kind"] == "frame":
                    step = message["step"]

        await begun.wait()
        await send(("resume", None))
        reading = asyncio.create_task(read())
        ends = time.monotonic() + COUNTDOWN_S + seconds
        while time.monotonic() < ends:
            key = dice.choice(("ArrowLeft", "ArrowRight"))
            await send(*([("keyup", down)] if down else []), ("keydown", key))
            down = key
            await asyncio.sleep(dice.uniform(0.25, 0.4))
        reading.cancel()
    await browser.aclose()
    return episode


def cpu_s(pid: int) -> float:
    """Return the processor seconds that a process and those below it have taken."""
    place = Path(f"/proc/{pid}")
    try:
        fields = (place / "stat").read_text().rpartition(")")[2].split()
        below = [
            child for task in place.glob("task/*/children") for child in task.read_text().split()
        ]
    except FileNotFoundError:
        return 0.0
    seconds = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return seconds + sum(cpu_s(int(child)) for child in below)


def many_boards(boards: int, seconds: float) -> tuple[list[float], list[float], int, float, float]:
    """Each board's ticks a second and late share, `verify`'s findings, kB a minute.

    The last is the processor time (ms) that server and boards took a tick, their beginning left
    out.
    """

    async def play(url: str, pid: int) -> tuple[list[str], float]:
        begun = asyncio.Barrier(boards + 1)

        async def paid() -> float:
            await begun.wait()
            before = cpu_s(pid)
            await asyncio.sleep(COUNTDOWN_S + seconds)
            return cpu_s(pid) - before

        *episodes, cpu = await asyncio.gather(
            *(_play(url, number, seconds, begun) for number in range(boards)), paid()
        )
        return cast("list[str]", episodes), cast(float, cpu)

    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cores[-1]})
    try:
        with tempfile.TemporaryDirectory() as folder:
            with served(BREAKOUT, Path(folder), {cores[0]}) as (url, pid):
                episodes, cpu = asyncio.run(play(url, pid))
            path = Path(folder) / "boards.db"
            rates, late, ticks = [], [], 0
            with closing(sqlite3.connect(path)) as conn:
                for episode in episodes:
                    sql = "SELECT server_ms FROM steps WHERE episode_id = ? ORDER BY step"
                    times = [row[0] for row in conn.execute(sql, [episode])]
                    ticks += len(times)
                    rates.append(1000 * (len(times) - 1) / (times[-1] - times[0]))
                    late.append(late_share(times, 60))
            size = path.stat().st_size / 1000 / boards * 60 / seconds
            return rates, late, len(verify_database(path).findings), size, 1000 * cpu / ticks
    finally:
        os.sched_setaffinity(0, cores)


def main() -> int:
    """Measure, print and perhaps write the figures; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--presses", type=int, default=100, help="keys an environment; 0: none")
    parser.add_argument(
        "--boards", type=int, default=12, help="boards of Breakout at once; 0: none"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="for which they are played")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    wanted = parser.parse_args()
    figures: dict[str, Any] = {"load": os.getloadavg()[0]}
    print(f"load average {figures['load']:.1f}, cores {len(os.sched_getaffinity(0))}", flush=True)
    for env in (ROOMS, CRAFTER, BREAKOUT) if wanted.presses else ():
        if find_spec(PACKAGES.get(env, env.partition(":")[0])) is None:
            print(f"{env}: its package is not installed")
            continue
        try:
            figures[env] = measure_presses(env, wanted.presses)
        except RuntimeError as error:
            print(f"{error}: it said why")
    fails = False
    if wanted.boards:
        rates, late, findings, size, cpu = many_boards(wanted.boards, wanted.seconds)
        fails = min(rates) < LEAST_RATE or findings > 0
        figures["boards"] = {
            "rates": rates,
            "late": late,
            "findings": findings,
            "kb": size,
            "cpu_ms": cpu,
        }
        print(f"{wanted.boards} boards of Breakout on one core for {wanted.seconds:g} s: ", end="")
        print(f"{min(rates):.2f} to {max(rates):.2f} ticks a second, wanted {LEAST_RATE:g};")
        print(
            f"late {min(late):.2%} to {max(late):.2%}, {cpu:.2f} ms of processor a tick, ", end=""
        )
        print(f"{findings} findings, {size:.0f} kB a minute and board")
    if wanted.json:
        wanted.json.write_text(json.dumps(figures, indent=1))
    return int(fails)


if __name__ == "__main__":
    sys.exit(main())
