"""Other people at a server while one client misbehaves: their moves' times.

Beside a quiet time of the same run.
"""

import asyncio
import json
import subprocess
import sys
import time
from contextlib import contextmanager

from websockets.asyncio.client import connect

from humanplay.tasks.mars.run import occupancy_codes
from marsexplorer.policies import load
from tests.support.nginx import trusting

PLAYERS, MOVES_PER_SECOND = 8, 10


async def _play(server, begun, until, trips):
    """Play at a steady pace and keep the round trip of each move in ms."""
    policy = load("frontier-cost")
    policy.reset(0)
    url = f"{server.url.replace('http', 'ws', 1)}/ws/sessions/{begun['session']}"
    tls = {"ssl": trusting()} if url.startswith("wss") else {}
    async with connect(url, proxy=None, compression=None, **tls) as socket:
        frame = json.loads(await socket.recv())
        while time.monotonic() < until and not frame["outcome"]:
            due = time.monotonic() + 1 / MOVES_PER_SECOND
            action = ("north", "east", "south", "west")[policy.act(occupancy_codes(frame))]
            step, began = frame["step"], time.perf_counter()
            await socket.send(
                json.dumps(
                    {"kind": "act", "episode": frame["episode"], "step": step, "action": action}
                )
            )
            while frame["step"] == step:
                message = json.loads(await socket.recv())
                frame = message if message["kind"] == "frame" else frame
            trips.append((time.perf_counter() - began) * 1000)
            await asyncio.sleep(max(0.0, due - time.monotonic()))


def measure(server, seconds):
    """Return how long each move of PLAYERS people takes, in ms."""
    client = server.client()
    boards = [client.post("/api/sessions", json={"size": 42}).json() for _ in range(PLAYERS)]
    client.close()
    trips, until = [], time.monotonic() + seconds

    async def all_of_them():
        await asyncio.gather(*(_play(server, begun, until, trips) for begun in boards))

    asyncio.run(all_of_them())
    return trips


@contextmanager
def misbehaving(code, *arguments):
    """Run Python code in a process that misbehaves, and end it."""
    with subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], stderr=subprocess.DEVNULL
    ) as process:
        try:
            yield process
        finally:
            process.kill()
