"""How long people's moves take among fast agents, and what a killed server loses.

    python -m research.speed.agents [--seconds 60] [--mars 40] [--rooms 10]

Two servers, since each plays one task: 8 people at one with the MarsExplorer agents, the FourRooms
agents at the other. Each agent has a card. All agents are one process of the processor's lowest
priority, at another address, since elsewhere they are another machine's. People play for a quiet
time, then for as long among the agents; then both servers are killed (SIGKILL) while agents act,
and every move that was answered must be in the database. The exit code is 1 where the p99 is more
than twice its quiet time, or a move was lost.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from tests.support.agents import own, token_of
from tests.support.browser import free_port
from tests.support.others import measure

GREEDY, MOST_RATIO, INSTANCES = "127.0.0.2", 2.0, 200
ROOMS = "gymnasium:minigrid:MiniGrid-FourRooms-v0"
WAYS = {"north": (-1, 0), "east": (0, 1), "south": (1, 0), "west": (0, -1)}


def choose(seen: dict[str, Any], draw: random.Random) -> str:
    """Return a move that ends no episode: to a free cell, or a turn."""
    observation = seen["observation"]
    if "grid" not in observation:
        return draw.choice(("left", "right"))
    row, col = observation["position"]
    grid = observation["grid"]
    inside = [
        way
        for way, (down, right) in WAYS.items()
        if 0 <= row + down < len(grid)
        and 0 <= col + right < len(grid[0])
        and grid[row + down][col + right] == "."
    ]
    return draw.choice(inside or list(WAYS))


async def play(address: str, answered: dict[str, int]) -> None:
    """Act until the server is gone; `answered` counts the answered moves, by instance."""
    draw = random.Random(address)
    with suppress(ConnectionClosed, OSError):
        url = f"ws{address.removeprefix('http')}/ws"
        async with connect(url, proxy=None, compression=None, local_addr=(GREEDY, 0)) as socket:

            async def ask(kind: str, **data: Any) -> dict[str, Any]:
                await socket.send(json.dumps({"type": kind, "data": data}))
                answer: dict[str, Any] = json.loads(await socket.recv())
                assert answer["type"] == "observation", answer
                return dict(answer["data"])

            for index in range(INSTANCES):
                now = await ask("reset", index=index)
                while not now["done"]:
                    now = await ask("step", action=choose(now["observation"], draw))
                    answered[str(index)] = now["observation"]["step"]


def be_agents(addresses: list[str]) -> None:
    """Let an agent act with each card until its server is gone.

    Print a line when all do, and then the moves that each was answered.
    """
    os.nice(19)
    answered: dict[str, dict[str, int]] = {address: {} for address in addresses}

    async def all_act() -> None:
        while not all(answered.values()):
            await asyncio.sleep(0.1)
        print("acting", flush=True)

    async def all_of_them() -> None:
        await asyncio.gather(
            all_act(), *(play(address, answered[address]) for address in addresses)
        )

    asyncio.run(all_of_them())
    print(json.dumps(answered), flush=True)


@contextmanager
def served(folder: Path, task: str) -> Iterator[SimpleNamespace]:
    """Yield a server of a task: `url`, `client()`, `kill()`."""
    port = free_port()
    words = [
        "serve",
        "--database",
        folder / "play.db",
        "--port",
        port,
    ]
    words += [] if task == "mars" else ["--env", task.partition(":")[2]]
    command = [sys.executable, "-m", "humanplay.cli", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            if not any("is open at" in line for line in process.stdout):
                sys.exit("the server did not start: see above")
            url = f"http://127.0.0.1:{port}"
            client = partial(httpx.Client, base_url=url, trust_env=False, timeout=60)
            yield SimpleNamespace(url=url, client=client, kill=process.kill)
        finally:
            process.kill()


def prepared(folder: Path, task: str, agents: int) -> list[str]:
    """Begin an evaluation of a task and return the tokens of so many cards."""
    own(folder / "play.db", task=task, instances=INSTANCES, sees="observation")
    return [token_of(folder / "play.db", f"author {number}") for number in range(agents)]


def lost(folder: Path, by_address: dict[str, dict[str, int]]) -> tuple[int, int]:
    """How many moves were answered, and how many of them the database lacks."""
    sql = """SELECT a.card, a.instance, count(m.step) FROM agents_attempts a
        LEFT JOIN agents_moves m ON m.attempt = a.id GROUP BY 1, 2"""
    with closing(sqlite3.connect(folder / "play.db")) as conn:
        stored = {(card, str(index)): moves for card, index, moves in conn.execute(sql)}
    answered = missing = 0
    for address, by_index in by_address.items():
        card = address.rpartition("/")[2][:4]
        for index, moves in by_index.items():
            answered += moves
            missing += max(0, moves - stored.get((card, index), 0))
    return answered, missing


def people(server: SimpleNamespace, seconds: float) -> list[float]:
    """How long each move of people takes, in ms.

    A person who has explored a board begins another.
    """
    until, trips = time.monotonic() + seconds, list[float]()
    while (left := until - time.monotonic()) > 0:
        trips += measure(server, left)
    return trips


def main() -> None:
    """Print what was measured."""
    if "--act" in sys.argv:
        be_agents(sys.argv[sys.argv.index("--act") + 1 :])
        return
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of quiet, and among agents")
    parser.add_argument("--mars", type=int, default=40, help="agents, 1 at least")
    parser.add_argument("--rooms", type=int, default=10, help="agents")
    options = parser.parse_args()
    counts = {
        task: count for task, count in (("mars", options.mars), (ROOMS, options.rooms)) if count
    }
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        places = {task: Path(name) / str(number) for number, task in enumerate(counts)}
        tokens = {task: prepared(places[task], task, count) for task, count in counts.items()}
        servers = {task: stack.enter_context(served(places[task], task)) for task in counts}
        addresses = [
            f"{servers[task].url}/agents/{token}" for task in tokens for token in tokens[task]
        ]
        people(servers["mars"], 3)  # the first moves take longer
        quiet = people(servers["mars"], options.seconds)
        command = [sys.executable, "-m", "research.speed.agents", "--act", *addresses]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as agents:
            assert agents.stdout is not None
            agents.stdout.readline()  # they act
            began = time.monotonic()
            busy = people(servers["mars"], options.seconds)
            for server in servers.values():
                server.kill()
            seconds = time.monotonic() - began
            answered = json.loads(agents.communicate(timeout=120)[0])
        rows = []
        for task, server in servers.items():
            of_server = {
                address: answered[address] for address in answered if address.startswith(server.url)
            }
            rows.append((task, *lost(places[task], of_server)))
    before, among = (float(np.percentile(times, 99)) for times in (quiet, busy))
    print(
        f"people's p99: {before:.1f} ms quiet, {among:.1f} ms among agents, ratio "
        f"{among / before:.2f}"
    )
    for task, moves, missing in rows:
        print(
            f"{task}: {moves:,} moves of {counts[task]} agents answered ({moves / seconds:.0f} "
            f"a second), {missing} lost"
        )
    sys.exit(among > MOST_RATIO * before or any(missing for _, _, missing in rows))


if __name__ == "__main__":
    main()
