"""How long every public read takes on a database of many episodes.

`python -m research.speed.large_database`

    python -m research.speed.large_database [--episodes 100000] [--requests 40] [--keep FOLDER]

The episodes are copies of recorded ones (`tests.support.many_episodes`). One client asks a server
of its own process for one route after the other: the first answer, then the median and the 95th
percentile of the next ones. A request is not repeated for longer than a minute. Exports and what a
job works out (costs, ghosts, pictures of a replay) are left out.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import secrets
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import httpx
import numpy as np

from humanplay.board.sources import PlayerTokens
from humanplay.web.access import PLAYER_COOKIE
from marsexplorer.config import EnvConfig
from tests.support.many_episodes import make_episodes, public_reads

CONFIGS = (*[EnvConfig.of("random", 21)] * 6, EnvConfig.of("random", 9), EnvConfig.of("random", 42))
SERVER = """
import sys
from humanplay.web import server
from humanplay.web.settings import Settings
server.run(Settings(database=sys.argv[1], port=0))
"""
LONGEST_S = 60.0


def cookie_of(database: Path) -> str:
    """Return the cookie of a player who has episodes."""
    with closing(sqlite3.connect(database)) as conn:
        (secret,) = conn.execute("SELECT value FROM meta WHERE name = 'secret'").fetchone()
        sql = "SELECT owner_id FROM sessions WHERE owner_id LIKE 'player-%' LIMIT 1"
        (player,) = conn.execute(sql).fetchone()
    return f"{PLAYER_COOKIE}={PlayerTokens(secret).sign(player)}"


def measure(client: httpx.Client, path: str, requests: int) -> str:
    """Return a row of the table."""
    times: list[float] = []
    while len(times) <= requests and sum(times) < LONGEST_S * 1000:
        began = time.perf_counter()
        answer = client.get(path)
        times.append(1000 * (time.perf_counter() - began))
    warm = times[1:] or times
    median, p95 = (float(np.percentile(warm, percentile)) for percentile in (50, 95))
    status = "" if answer.status_code in (200, 303) else f" ({answer.status_code})"
    shown = re.sub(r"\w{60,}", "ID", path)
    return (
        f"| `{shown}`{status} | {times[0]:,.0f} | {median:,.1f} | {p95:,.1f} | "
        f"{len(answer.content) / 1000:,.0f} |"
    )


def campaign(folder: Path, requests: int) -> None:
    """Serve a database and print the table of its reads."""
    database, token = folder / "playground.db", secrets.token_hex(16)
    command = [sys.executable, "-c", SERVER, str(database)]
    environment = os.environ | {"HUMANPLAY_LIMITS__TOKEN": token}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        line = next(line for line in process.stdout if "is open at" in line)
        url = "http://" + line.split("http://")[1].split()[0]
        print(
            "times in ms, size in kB\n| read | first | median | p95 | size |\n|---|---|---|---|---|"
        )
        headers = {"X-Humanplay-Token": token, "Cookie": cookie_of(database)}
        with httpx.Client(base_url=url, trust_env=False, headers=headers, timeout=300) as client:
            for path in public_reads(database):
                print(measure(client, path, requests), flush=True)
    finally:
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(20)
        process.kill()


def main() -> None:
    """Make the database unless it is there, and measure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--episodes", type=int, default=100_000)
    parser.add_argument("--requests", type=int, default=40, help="of each route, after the first")
    parser.add_argument(
        "--keep", type=Path, help="folder of the database, used again when it is there"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        database = folder / "playground.db"
        if not database.exists():
            folder.mkdir(parents=True, exist_ok=True)
            began = time.monotonic()
            make_episodes(database, folder / "playground.db-studies", options.episodes, CONFIGS)
            size, seconds = database.stat().st_size / 1e6, time.monotonic() - began
            print(f"{options.episodes:,} episodes, {size:,.0f} MB, made in {seconds:.0f} s")
        campaign(folder, options.requests)


if __name__ == "__main__":
    main()
