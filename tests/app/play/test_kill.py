"""SIGKILL or SIGTERM right after acknowledged steps loses and doubles nothing."""

import os
import random
import re
import sqlite3
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import httpx
import pytest

from humanplay.study.verification import verify_database
from marsexplorer.config import ACTIONS
from tests.support.browser import free_port
from tests.support.servers import PATIENCE_S, RunningServer, eventually

KINDS = ("human", "rival", "policy")
STOP_S = 5.0
"""How long a server may take to end after SIGTERM."""


def begin(client, kind, dice):
    body = {
        "human": {},
        "rival": {"rival": "frontier-cost"},
        "policy": {"player": "frontier-utility"},
    }[kind]
    begun = client.post(
        "/api/sessions", json={**body, "size": [9, 13], "seed": dice.randrange(10**6)}
    ).json()
    if kind == "policy":
        client.post(
            f"/api/sessions/{begun['session']}/pace",
            json={"moves_per_second": dice.uniform(20, 60)},
        )
    return begun


class Board:
    """A session that is watched or played until the kill; `seen` is its last frame."""

    def __init__(self, kind, begun, socket):
        self.kind, self.begun, self.socket, self.seen = kind, begun, socket, socket.receive("frame")

    def move(self):
        """One step more, by our hand or the policy's, and its frame."""
        if self.seen["outcome"]:
            return
        if self.kind != "policy":
            action = ("south", "north")[self.seen["step"] % 2]
            self.socket.act(self.seen, action, input="key", key_down_ms=float(self.seen["step"]))
        self.seen = self.socket.frame_after(self.seen["step"])


def rows_of(path, episode):
    """Return the (step, action) pairs of an episode, straight from the file."""
    with closing(sqlite3.connect(path)) as db:
        return db.execute(
            "SELECT step, action FROM steps WHERE episode_id = ? ORDER BY step", [episode]
        ).fetchall()


def check(client, path, session, seen, is_exact):
    """The board is at its last seen frame, or later if a policy plays alone.

    Its steps are 0, 1, 2, ...
    """
    frame = client.get(f"/api/sessions/{session}").json()
    assert frame["episode"] == seen["episode"]
    assert frame["step"] >= seen["step"]
    if is_exact:
        assert frame == seen
    rows = rows_of(path, frame["episode"])
    assert [step for step, _ in rows] == list(range(len(rows)))
    assert len(rows) >= frame["step"]


def play_kill_and_check(spawn, path, dice, sessions):
    """Play, kill, start again, compare, and play on."""
    server = spawn()
    client = server.client()
    with ExitStack() as stack:
        boards = []
        for number in range(sessions):
            kind = KINDS[(number + dice.randrange(3)) % 3]
            begun = begin(client, kind, dice)
            boards.append(
                Board(kind, begun, stack.enter_context(server.socket(begun["session"], client)))
            )
        for board in dice.choices(boards, k=dice.randrange(1, 12 * sessions)):
            board.move()
        for board in boards:
            board.move()
        server.process.kill()
        server.kill()
    server = spawn()
    again = server.client(cookies=dict(client.cookies))
    for board in boards:
        session, rival = board.begun["session"], board.begun["rival"]
        check(again, path, session, board.seen, board.kind != "policy")
        if rival:
            check(again, path, rival["session"], rival["frame"], False)
        with server.socket(session, again) as socket:
            on = Board(board.kind, board.begun, socket)
            before = on.seen["step"]
            on.move()
            assert on.seen["step"] > before or on.seen["outcome"]
            if rival:
                url = f"/api/sessions/{rival['session']}"
                steps = on.seen["step"]

                def followed(url: str = url, steps: int = steps):
                    now = again.get(url).json()
                    return now["step"] >= steps or now["outcome"]

                eventually(followed)
                check(again, path, rival["session"], rival["frame"], False)
    server.process.terminate()
    assert server.process.wait(STOP_S) == 0
    assert "Traceback" not in server.process.stdout.read()
    server.close()


@pytest.mark.parametrize(
    "batch", [0, *(pytest.param(number, marks=pytest.mark.long) for number in range(1, 10))]
)
def test_a_kill_right_after_the_last_step_of_five_sessions_loses_and_doubles_nothing(
    spawn, tmp_path, batch
):
    play_kill_and_check(spawn, tmp_path / "playground.db", random.Random(batch), 5)


@pytest.mark.long
@pytest.mark.parametrize("point", range(50))
def test_a_kill_right_after_a_step_of_one_session_loses_and_doubles_nothing(spawn, tmp_path, point):
    play_kill_and_check(spawn, tmp_path / "playground.db", random.Random(1000 + point), 1)


def play_until(stop, answered, client, boards, acknowledged):
    """Move boards in turn over HTTP, as fast as answers come, and note each answer."""
    frames = {}
    with suppress(httpx.TransportError):
        while not stop.is_set():
            for session in boards:
                frame = frames.get(session) or client.get(f"/api/sessions/{session}").json()
                if frame["outcome"]:
                    begun = client.post(f"/api/sessions/{session}/episodes", json={"size": [9, 13]})
                    frame = begun.json()["frame"]
                step, action = frame["step"], ("south", "north")[frame["step"] % 2]
                body = {"kind": "act", "episode": frame["episode"], "step": step, "action": action}
                answer = client.post(f"/api/sessions/{session}/act", json=body)
                assert answer.status_code == 200, answer.text
                acknowledged[frame["episode"], step] = ACTIONS.index(action)
                frames[session] = answer.json()
                answered.set()


def play_rounds(start, end, path, dice, rounds):
    """Restart a server 0 to 150 ms after its first answer, again and again.

    `start()` starts it and `end(server)` ends it; nothing may be lost.
    """
    acknowledged, boards = {}, []
    for number in range(rounds):
        server = start()
        client = server.client()
        if number % 10 == 0:
            body = [{}, {"rival": "frontier-cost"}, {}][number // 10 % 3]
            boards = [
                client.post("/api/sessions", json={**body, "size": [9, 13]}).json()["session"]
                for _ in range(3)
            ]
        stop, answered = threading.Event(), threading.Event()
        player = threading.Thread(
            target=play_until, args=(stop, answered, client, boards, acknowledged)
        )
        with server.socket(boards[0], client):
            player.start()
            assert answered.wait(PATIENCE_S)
            time.sleep(dice.uniform(0, 0.15))
            end(server)
        stop.set()
        player.join()
        server.process.stdout.close()
        server.close()
    with closing(sqlite3.connect(path)) as db:
        rows = db.execute(
            "SELECT episode_id, step, action FROM steps ORDER BY episode_id, step"
        ).fetchall()
    there = {(episode, step): action for episode, step, action in rows}
    lost = [place for place, action in acknowledged.items() if there.get(place) != action]
    counts = Counter(episode for episode, _ in there)
    gaps = [episode for episode, count in counts.items() if (episode, count - 1) not in there]
    doubled = len(rows) - len(there)
    print(
        f"\n{rounds} ends: {len(acknowledged)} moves acknowledged, {len(lost)} lost, {doubled} doubled, {len(gaps)} gaps"
    )
    assert (lost, gaps, doubled) == ([], [], 0)
    assert len(acknowledged) >= rounds
    assert not verify_database(path).findings


def kill(server):
    server.process.kill()
    server.process.wait()


def stopping(path, took_s):
    """Return a function that ends a server by SIGTERM: 0, soon, closed, no traceback."""

    def stop(server):
        began = time.monotonic()
        server.process.terminate()
        assert server.process.wait(STOP_S) == 0
        took_s.append(time.monotonic() - began)
        assert not path.with_name(path.name + "-wal").exists(), (
            "SQLite deletes it when all is closed"
        )
        assert "Traceback" not in server.process.stdout.read()

    return stop


@pytest.mark.long
@pytest.mark.parametrize("campaign", range(10))
def test_a_hundred_kills_at_random_moments_lose_and_double_nothing(spawn, tmp_path, campaign):
    """Ten campaigns are 1,000 kills."""
    play_rounds(spawn, kill, tmp_path / "playground.db", random.Random(2000 + campaign), 100)


def test_a_server_that_is_stopped_under_play_ends_with_0_and_its_database_is_closed(
    spawn, tmp_path
):
    path = tmp_path / "playground.db"
    play_rounds(spawn, stopping(path, []), path, random.Random(3000), 4)


@pytest.fixture
def start_unit(tmp_path):
    """`start_unit()` runs the command of deploy's unit in the test's own folders."""
    systemd = Path(__file__).parents[3] / "deploy" / "systemd"
    (command,) = re.findall(r"^ExecStart=(.*)$", (systemd / "humanplay.service").read_text(), re.M)
    command = command.replace("/opt/humanplay/venv", sys.prefix).split()
    text = (systemd / "humanplay.env").read_text().replace("/var/lib/humanplay", str(tmp_path))
    ports = {"HUMANPLAY_PORT": "0", "HUMANPLAY_METRICS_PORT": str(free_port())}
    environment = {**os.environ, **dict(re.findall(r"^(HUMANPLAY_\w+)=(.*)$", text, re.M)), **ports}
    processes = []

    def start():
        process = subprocess.Popen(
            command,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        processes.append(process)
        address_line = next(line for line in process.stdout if "is open at" in line)
        server = RunningServer(int(address_line.split("http://127.0.0.1:")[1].split()[0]))
        server.process = process
        return server

    yield start
    for process in processes:
        process.kill()
        process.wait()
        process.stdout.close()


@pytest.mark.long
def test_a_hundred_stops_of_the_unit_under_play_lose_and_double_nothing(start_unit, tmp_path):
    path, took_s = tmp_path / "playground.db", []
    play_rounds(start_unit, stopping(path, took_s), path, random.Random(4000), 100)
    print(f"the slowest ended within {max(took_s):.2f} s")
