"""SIGKILL in the middle of play loses nothing that a page was told.

Under `play`, and under `serve --env`.
"""

import json
import os
import random
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
from urllib.parse import urlsplit

import httpx
import pytest

from humanplay.study.verification import verify_database
from tests.support.command_server import command_server
from tests.support.recorded import ask
from tests.support.servers import PATIENCE_S

KILLS = 40
MOST_MOVES, LATEST_S = 6, 0.1
"""After so many moves, and within this time from then on, a server dies."""
PLAY = """
import json, time
from humanplay import play
plays = play("FrozenLake-v1", wait=False, browser=False, database="plays.db")
print(json.dumps([plays.link, plays._server._process.pid]), flush=True)
time.sleep(1e9)
"""
SERVE = (
    *(sys.executable, "-m", "humanplay.cli", "serve", "--env", "FrozenLake-v1"),
    *("--database", "plays.db", "--port", "0"),
)


@contextmanager
def played(folder):
    """The address of a page that a program opened, and the processes to kill."""
    pipes = {"stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", PLAY], cwd=folder, **pipes) as program:
        try:
            line = next(line for line in program.stdout if line.startswith("["))
            link, server = json.loads(line)
            yield link, (server, program.pid)
        finally:
            program.kill()


@contextmanager
def served(folder):
    """The same of a server that its command starts."""
    with command_server(SERVE, cwd=folder) as (process, address):
        yield address, (process.pid,)


class Visitor:
    """A browser that plays one episode after another, over any number of servers.

    acknowledged  episode -> its moves, as far as an answer said so
    """

    def __init__(self, dice):
        self.dice, self.cookies, self.session, self.acknowledged = dice, {}, None, {}

    def play(self, link, moves, end):
        """Play until nobody answers any more; `end` is called after so many moves."""
        parts = urlsplit(link)
        origin = f"{parts.scheme}://{parts.netloc}"
        headers = {"Origin": origin}
        options = {"cookies": self.cookies, "timeout": PATIENCE_S, "trust_env": False}
        with httpx.Client(base_url=origin, headers=headers, **options) as client:
            if "What are you called?" in client.get("/").text:
                client.put("/api/me/name", json={"name": "Ada"}).raise_for_status()
            if self.session is None:
                self.begin(client)
            self.cookies = dict(client.cookies)
            frame = client.get(f"/api/sessions/{self.session}").raise_for_status().json()
            episode = frame["episode"]
            assert frame["step"] >= self.acknowledged.get(episode, 0)
            while True:
                if frame["outcome"]:
                    frame = self.begin(client)
                action = self.dice.choice(("left", "down", "right", "up"))
                move = {"episode": frame["episode"], "step": frame["step"], "action": action}
                client.post(f"/api/sessions/{self.session}/act", json=move).raise_for_status()
                frame = client.get(f"/api/sessions/{self.session}").raise_for_status().json()
                self.acknowledged[frame["episode"]] = frame["step"]
                moves -= 1
                if moves == 0:
                    end()

    def begin(self, client):
        """Begin an episode on a board, and return its first frame."""
        begun = client.post("/api/sessions", json={"player": "human"}).raise_for_status().json()
        self.session = begun["session"]
        return begun["frame"]


def kill(processes):
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("start", [played, served])
def test_kills_lose_nothing_that_a_page_was_told(tmp_path, start):
    dice = random.Random(start.__name__)
    visitor = Visitor(dice)
    for _ in range(KILLS):
        with start(tmp_path) as (link, processes):
            death = threading.Timer(dice.uniform(0, LATEST_S), kill, [processes])
            with suppress(httpx.TransportError):
                visitor.play(link, dice.randint(1, MOST_MOVES), death.start)
            death.join()
    path, acknowledged = tmp_path / "plays.db", visitor.acknowledged
    stored = dict(ask(path, "SELECT episode_id, count(*) FROM steps GROUP BY episode_id"))
    lost = {episode: steps for episode, steps in acknowledged.items() if stored[episode] < steps}
    assert lost == {}
    assert sum(acknowledged.values()) > KILLS, "it has played at all"
    assert verify_database(path).findings == ()
