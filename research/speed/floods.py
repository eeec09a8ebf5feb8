"""How long others' moves take while one client is greedy, beside a quiet time.

Both are of the same run.

    python -m research.speed.floods --database FILE [--seconds 4] [--rounds 3] [--port bare|nginx]

`python -m research.speed.large_database --keep FOLDER` makes a database of 100,000 episodes and its
studies. A server plays on a copy of the database, alone and behind the nginx of `deploy/`. Eight
people make ten moves a second each. One client, at another address and with the processor's lowest
priority, since elsewhere it is another machine's, floods the server in one way after the other.
Quiet times and floods take turns. A last row is of another's ghosts while ghosts and costs are
asked for. The exit code is 1 where a p99 is more than twice its quiet time.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import itertools
import json
import os
import random
import shutil
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit

import httpx
import numpy as np

from humanplay.db.file import studies_beside
from tests.support.browser import free_port
from tests.support.nginx import running_nginx, shipped, trusting
from tests.support.others import measure

GREEDY = "127.0.0.2"
CONNECTIONS = 40
READS = (
    "episodes?limit=200",
    "episodes?limit=200&who=human",
    "leaderboard",
    "human-level",
    "daily",
)
GARBAGE = (
    b"nonsense\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost 127.0.0.1\r\n\r\n",
    b"\xff" * 4096,
    b"GET /\x00 HTTP/1.1\r\n\r\n",
)
GHOST = "/api/episodes/{}/ghost?policy={}"
MOST_RATIO = 2.0


class GreedyClient:
    """The requests of one client over each of its connections, in turn, until killed."""

    def __init__(self, url: str, episodes: list[str]) -> None:
        self._url, self._episodes = urlsplit(url), episodes
        self._connections: dict[int, http.client.HTTPConnection] = {}
        self.answers = Counter[str]()

    def exports(self, number: int) -> None:
        """Ask for a table, and read it."""
        self._ask(number, "GET", f"/api/export/{('steps', 'episodes')[number % 2]}.csv")

    def slow_readers(self, number: int) -> None:
        """Ask for what is long, and read a byte a second."""
        path = "/api/export/episodes.csv" if number % 2 else "/api/episodes?limit=200"
        with self._connected() as connection:
            connection.sendall(f"GET {path} HTTP/1.1\r\nHost: {self._url.netloc}\r\n\r\n".encode())
            while connection.recv(1):
                time.sleep(1)

    def ghosts_and_costs(self, number: int) -> None:
        """Ask for what takes long to work out, of another episode each time."""
        episode = random.choice(self._episodes)
        costs = f"/api/episodes/{episode}/costs"
        self._ask(number, "GET", costs if number % 2 else GHOST.format(episode, "planner"))

    def garbage(self, number: int) -> None:
        """Send what is no request."""
        with self._connected() as connection:
            connection.sendall(GARBAGE[number % len(GARBAGE)])
            connection.recv(4096)

    def new_boards(self, number: int) -> None:
        """Begin the largest boards."""
        board = {"size": 128, "seed": random.randrange(10**9)}
        self._ask(number, "POST", "/api/sessions", json.dumps(board))

    def public_reads(self, number: int) -> None:
        """Read what anybody may read."""
        self._ask(number, "GET", f"/api/{READS[number % len(READS)]}")

    def _connected(self) -> socket.socket:
        host = self._url.hostname or ""
        connection = socket.create_connection((host, self._url.port or 0), 60, (GREEDY, 0))
        if self._url.scheme == "http":
            return connection
        tls: socket.socket = trusting().wrap_socket(connection, server_hostname=host)
        return tls

    def _ask(self, number: int, method: str, path: str, body: str | None = None) -> None:
        connection = self._connections.get(number)
        if connection is None:
            connection = http.client.HTTPConnection(self._url.netloc)
            connection.sock = self._connected()
            self._connections[number] = connection
        try:
            connection.request(method, path, body, {"Content-Type": "application/json"})
            answer = connection.getresponse()
            while answer.read(2**18):
                pass
            self.answers[str(answer.status)] += 1
        finally:
            if connection.sock is None or sys.exc_info()[0]:
                connection.close()
                del self._connections[number]


FLOODS: dict[str, Callable[[GreedyClient, int], None]] = {
    "exports": GreedyClient.exports,
    "slow readers": GreedyClient.slow_readers,
    "ghosts and costs": GreedyClient.ghosts_and_costs,
    "garbage": GreedyClient.garbage,
    "new boards": GreedyClient.new_boards,
    "public reads": GreedyClient.public_reads,
}


def be_greedy(kind: str, url: str, episodes: list[str]) -> None:
    """Flood until a line comes on standard input, then print the answers' statuses."""
    os.nice(19)
    client = GreedyClient(url, episodes)

    def again(number: int) -> None:
        while True:
            with contextlib.suppress(OSError, http.client.HTTPException):
                FLOODS[kind](client, number)

    for number in range(CONNECTIONS):
        threading.Thread(target=again, args=[number], daemon=True).start()
    sys.stdin.readline()
    print(json.dumps(client.answers), flush=True)
    os._exit(0)


@contextmanager
def flooded(kind: str, url: str, episodes: list[str], answers: Counter[str]) -> Iterator[None]:
    """Let a client be greedy in a process of its own during the block."""
    command = [
        sys.executable,
        "-m",
        "research.speed.floods",
        "--greedy",
        kind,
        url,
        *episodes[:500],
    ]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        try:
            time.sleep(1.5)
            yield
            answers.update(json.loads(child.communicate("\n", 60)[0]))
        finally:
            child.kill()


@contextmanager
def served(database: Path, port_kind: str) -> Iterator[SimpleNamespace]:
    """Yield a server: `url`, where everybody asks, and `client()`."""
    port, front = free_port(), free_port()
    public = f"https://localhost:{front}"
    words = ["serve", "--database", database]
    proxy = ["--trusted-proxy", "127.0.0.1", "--public-url", public]
    command = [*words, "--port", port, *(proxy if port_kind == "nginx" else [])]
    with contextlib.ExitStack() as stack:
        process = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-m", "humanplay.cli", *map(str, command)],
                stdout=subprocess.PIPE,
                text=True,
            )
        )
        stack.callback(process.terminate)
        assert process.stdout is not None
        if not any("is open at" in line for line in process.stdout):
            sys.exit("the server did not start: see above")
        url = f"http://127.0.0.1:{port}"
        if port_kind == "nginx":
            text = shipped(front, free_port(), port)
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            stack.enter_context(running_nginx(folder / "nginx", text))
            url = public
        client = partial(httpx.Client, base_url=url, verify=False, trust_env=False, timeout=60)
        yield SimpleNamespace(url=url, client=client)


def episodes_of(database: Path) -> list[str]:
    """Return the ids of finished episodes that anybody may see, in random order."""
    sql = """SELECT id FROM episodes WHERE ended_ms IS NOT NULL AND steps > 5
        AND id NOT IN (SELECT episode_id FROM series_episodes) ORDER BY random() LIMIT 2000"""
    with closing(sqlite3.connect(database)) as conn:
        return [row[0] for row in conn.execute(sql)]


def ghosts(server: SimpleNamespace, episodes: Iterator[str], seconds: float) -> list[float]:
    """How long each ghost takes, in ms, that one person asks for after the other.

    The first one is left out: a worker may have to start.
    """
    trips, until = [], time.monotonic() + seconds
    with server.client() as client:
        while time.monotonic() < until:
            began = time.perf_counter()
            client.get(GHOST.format(next(episodes), "frontier-cost")).raise_for_status()
            trips.append(1000 * (time.perf_counter() - began))
    return trips[1:] or trips


def compare(
    database: Path, port: str, kind: str, of: Callable[[SimpleNamespace], list[float]], rounds: int
) -> tuple[float, float, Counter[str]]:
    """The p99 of the others in ms, quiet and flooded, and the greedy client's answers.

    Each round has a server of its own: what a flood leaves behind would slow the next quiet time
    down.
    """
    quiet: list[float] = []
    busy: list[float] = []
    answers = Counter[str]()
    for _ in range(rounds):
        with served(database, port) as server:
            of(server)  # the first ones take longer
            quiet += of(server)
            with flooded(kind, server.url, episodes_of(database), answers):
                busy += of(server)
    return float(np.percentile(quiet, 99)), float(np.percentile(busy, 99)), answers


def main() -> None:
    """Print the table."""
    if "--greedy" in sys.argv:
        kind, url, *episodes = sys.argv[sys.argv.index("--greedy") + 1 :]
        be_greedy(kind, url, episodes)
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--database", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each quiet time and flood")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--port", choices=("bare", "nginx"), action="append")
    parser.add_argument("--flood", choices=FLOODS, action="append")
    options = parser.parse_args()
    unseen = itertools.cycle(episodes_of(options.database))

    def moves(server: SimpleNamespace) -> list[float]:
        return measure(server, options.seconds)  # type: ignore[no-any-return]

    def asked(server: SimpleNamespace) -> list[float]:
        return ghosts(server, unseen, options.seconds)

    rows = [("moves", kind, moves) for kind in options.flood or FLOODS]
    rows += [("ghosts", kind, asked) for _, kind, _ in rows if kind == "ghosts and costs"]
    print(
        "| flood | port | what the others do | quiet p99, ms | flooded p99, ms | ratio | the "
        "client was answered |"
    )
    print("|---|---|---|---|---|---|---|", flush=True)
    worst = 0.0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(shutil.copy(options.database, folder))
        os.sync()  # else the first quiet time waits for the disk
        studies_beside(copy).symlink_to(studies_beside(options.database.absolute()))
        for port, (measured, kind, of) in itertools.product(
            options.port or ("bare", "nginx"), rows
        ):
            quiet, busy, answers = compare(copy, port, kind, of, options.rounds)
            statuses = ", ".join(
                f"{status}: {count:,}" for status, count in sorted(answers.items())
            )
            worst = max(worst, busy / quiet)
            print(
                f"| {kind} | {port} | {measured} | {quiet:.1f} | {busy:.1f} | "
                f"{busy / quiet:.2f} | {statuses} |",
                flush=True,
            )
    sys.exit(worst > MOST_RATIO)


if __name__ == "__main__":
    main()
