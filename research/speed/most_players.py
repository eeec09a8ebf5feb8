"""How many people may play before the server's p99 passes 20 ms, on one core.

Each makes five moves a second.

    python -m research.speed.most_players [--seconds 10] [--most 900] [--bound 20]

The server runs on one core. The players are simulated by this process on another one, which
measures its own lag: how much later than due a timer of 10 ms is served. Where that is too much it
could not tell a slow server from its own slowness, so it reports nothing of that number of players
and ends with exit code 1.

A move's time on the server is taken from when the application takes its message until it comes for
the next: the move is committed and its frame published. What waits before that is not in it; the
server's own lag, printed beside it, bounds that.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import random
import secrets
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from websockets.asyncio.client import connect

MOVES_PER_SECOND = 5
CONNECT_S = 60.0
"""Seconds in which a player has a connection: the server serves eighty new ones in a second."""
MOST_LAG_MS = 10.0
"""The 99th percentile of the generator's own lag above which it reports nothing."""

SERVER = """
import asyncio, json, os, sys, time
import uvicorn
os.sched_setaffinity(0, {int(sys.argv[1])})
from humanplay.web.settings import Settings
from humanplay.web import server

moves, lags, tasks = [], [], []

def timed(app):
    async def run(scope, receive, send):
        began = None
        async def receive_timed():
            nonlocal began
            if began is not None:  # the application has handled the message before
                moves.append((time.perf_counter() - began) * 1000)
            message = await receive()
            began = time.perf_counter() if message["type"] == "websocket.receive" else None
            return message
        if not tasks:
            tasks.append(asyncio.create_task(measure_lag()))
        await app(scope, receive_timed if scope["type"] == "websocket" else receive, send)
    return run

async def measure_lag():
    while True:
        due = time.perf_counter() + 0.01
        await asyncio.sleep(0.01)
        lags.append((time.perf_counter() - due) * 1000)
        if os.path.exists(sys.argv[3]):
            done = sys.argv[3] + ".json"
            with open(done + ".new", "w") as file:
                json.dump({"moves": moves, "lags": lags, "cpu_s": time.process_time()}, file)
            os.rename(done + ".new", done)
            os.remove(sys.argv[3])
            moves.clear(), lags.clear()

class TimedConfig(uvicorn.Config):
    def __init__(self, app, **options):
        super().__init__(timed(app), **options)

uvicorn.Config = TimedConfig
server.run(Settings(database=sys.argv[2], port=0))
"""

HEADER = """times in ms
| players | moves | server, median | server, p99 | server's lag, p99 | round trip, p99 | own lag, p99 | core |
|---|---|---|---|---|---|---|---|"""


class StarvedError(Exception):
    """The generator was too slow itself; the text says by how much."""


@dataclass(frozen=True)
class Level:
    """The measures at a number of players; times in ms, `cpu` a share of one core."""

    players: int
    moves: int
    median_ms: float
    p99_ms: float
    lag_p99_ms: float
    trip_p99_ms: float
    own_lag_p99_ms: float
    cpu: float


class Server:
    """A server on one core, in a folder of its own."""

    def __init__(self, core: int, folder: str) -> None:
        self._asked, self.token = Path(folder) / "measure", secrets.token_hex(16)
        limits = {"TOKEN": self.token, "HANDSHAKES_PER_ADDRESS": "1000000+1000000/s"}
        limits |= dict.fromkeys(("SOCKETS", "SOCKETS_PER_ADDRESS"), "100000")
        environment = os.environ | {
            f"HUMANPLAY_LIMITS__{name}": limit for name, limit in limits.items()
        }
        files = str(Path(folder) / "playground.db"), str(self._asked)
        command = [sys.executable, "-c", SERVER, str(core), *files]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        assert self.process.stdout is not None
        line = next(line for line in self.process.stdout if "is open at" in line)
        self.url = "http://" + line.split("http://")[1].split()[0]

    def measured(self) -> dict[str, list[float]]:
        """Return the moves and lags since this was called last."""
        done = self._asked.with_name("measure.json")
        done.unlink(missing_ok=True)
        self._asked.touch()
        while not done.exists():
            time.sleep(0.02)
        measured: dict[str, list[float]] = json.loads(done.read_text())
        return measured


def next_action(grid: list[str], position: tuple[int, int], chance: random.Random) -> str:
    """A way to a known free cell, at random; any way if there is none."""
    ways = {"north": (-1, 0), "east": (0, 1), "south": (1, 0), "west": (0, -1)}
    inside, free = [], []
    for way, (down, right) in ways.items():
        row, col = position[0] + down, position[1] + right
        if 0 <= row < len(grid) and 0 <= col < len(grid[0]):
            inside.append(way)
            if grid[row][col] == ".":
                free.append(way)
    return chance.choice(free or inside)


async def play(
    server: Server, begun: dict[str, str], come: asyncio.Barrier, seconds: float, trips: list[float]
) -> None:
    """Play at the pace for `seconds` once everybody has come; keep the round trips.

    In ms, of each move.
    """
    chance = random.Random(begun["session"])
    url = f"ws{server.url.removeprefix('http')}/ws/sessions/{begun['session']}"
    token = {"X-Humanplay-Token": server.token}
    options: dict[str, Any] = {"proxy": None, "compression": None, "open_timeout": CONNECT_S}
    async with connect(url, additional_headers=token, **options) as socket:
        frame = json.loads(await socket.recv())
        await come.wait()
        until_s = time.monotonic() + seconds
        due = time.monotonic() + chance.random() / MOVES_PER_SECOND
        while due < until_s and not frame["outcome"]:
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            began, step = time.perf_counter(), frame["step"]
            action = next_action(frame["grid"], frame["position"], chance)
            move = {"kind": "act", "episode": frame["episode"], "step": step, "action": action}
            await socket.send(json.dumps(move))
            while frame["step"] == step:
                text = await socket.recv()
                frame = json.loads(text) if text[9:14] == "frame" else frame
            trips.append((time.perf_counter() - began) * 1000)
            due = max(due + 1 / MOVES_PER_SECOND, time.monotonic())


async def _lag(lags: list[float]) -> None:
    while True:
        due = time.perf_counter() + 0.01
        await asyncio.sleep(0.01)
        lags.append((time.perf_counter() - due) * 1000)


async def _campaign(
    server: Server, boards: list[dict[str, str]], seconds: float
) -> tuple[float, list[float], list[float]]:
    """The server's processor time at the beginning, round trips, and own lags.

    In s, and in ms; the lags are those of this process.
    """
    trips: list[float] = []
    lags: list[float] = []
    come = asyncio.Barrier(len(boards) + 1)  # the server lets so many connections begin in a second
    # one that fails ends the others: the barrier would wait for it for ever
    async with asyncio.TaskGroup() as group:
        games = (play(server, begun, come, seconds + 2, trips) for begun in boards)
        players = [group.create_task(game) for game in games]
        await come.wait()
        await asyncio.sleep(2)
        cpu = float((await asyncio.to_thread(server.measured))["cpu_s"])  # type: ignore[arg-type]
        trips.clear()
        lag = group.create_task(_lag(lags))
        await asyncio.wait(players)
        lag.cancel()
    return cpu, trips, lags


def measure(server: Server, players: int, seconds: float) -> Level:
    """The measures at `players` people; StarvedError if this process was too slow."""
    token = {"X-Humanplay-Token": server.token}
    with httpx.Client(base_url=server.url, trust_env=False, headers=token) as client:
        boards = [client.post("/api/sessions", json={"size": 42}).json() for _ in range(players)]
        cpu, trips, lags = asyncio.run(_campaign(server, boards, seconds))
    own_lag = float(np.percentile(lags, 99))
    if own_lag > MOST_LAG_MS:
        raise StarvedError(
            f"{players} players: this process was starved, its own timers were {own_lag:.1f} ms "
            "late in one of a hundred cases "
            f"(at most {MOST_LAG_MS:g}), so nothing is reported: let it run on a core that does "
            "nothing else"
        )
    served = server.measured()
    used = (float(served["cpu_s"]) - cpu) / seconds  # type: ignore[arg-type]
    median, p99 = (float(np.percentile(served["moves"], p)) for p in (50, 99))
    lag, trip = float(np.percentile(served["lags"], 99)), float(np.percentile(trips, 99))
    return Level(players, len(served["moves"]), median, p99, lag, trip, own_lag, used)


def search(server: Server, most: int, seconds: float, bound_ms: float) -> int:
    """The highest number of players whose p99 stays under the bound.

    In steps of a tenth; every level is printed.
    """
    print(HEADER, flush=True)
    good, bad, players = 0, most + 1, min(50, most)
    while bad - good > max(1, good // 10) and players < bad:
        level = measure(server, players, seconds)
        print(
            f"| {level.players} | {level.moves:,} | {level.median_ms:.2f} | {level.p99_ms:.2f} "
            f"| {level.lag_p99_ms:.2f} "
            f"| {level.trip_p99_ms:.2f} | {level.own_lag_p99_ms:.2f} | {level.cpu:.0%} |",
            flush=True,
        )
        if level.p99_ms < bound_ms and level.moves > 0.9 * players * MOVES_PER_SECOND * seconds:
            good = players
        else:
            bad = players
        players = min(2 * good, most) if bad > most else (good + bad) // 2
        if players == good:
            break
    return good


def main() -> None:
    """Measure and print; exit code 1 when this process was starved."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="of each level")
    parser.add_argument("--most", type=int, default=900, help="players at most")
    parser.add_argument("--bound", type=float, default=20.0, help="ms that p99 stays under")
    options = parser.parse_args()
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < 2:
        sys.exit("two cores are needed: one for the server, one for the players")
    os.sched_setaffinity(0, {cores[1]})
    with tempfile.TemporaryDirectory() as folder:
        server = Server(cores[0], folder)
        try:
            most_players = search(server, options.most, options.seconds, options.bound)
        except StarvedError as error:
            sys.exit(str(error))
        finally:
            server.process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                server.process.wait(10)
            server.process.kill()
    print(
        f"\n{most_players} players at {MOVES_PER_SECOND} moves a second: p99 under "
        f"{options.bound:g} ms on one core of the server"
    )


if __name__ == "__main__":
    main()
