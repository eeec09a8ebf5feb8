"""Tables over HTTP for a slow reader: written first and then sent, so nothing reads the database meanwhile."""

import contextlib
import shutil
import socket
import sqlite3
import tempfile
from pathlib import Path

import pytest

from app.db.store import Store
from app.web import listening
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies import load
from tests.support.recorded import add_session, add_steps, open_episode
from tests.support.servers import eventually

EPISODES = 25
CONFIG = EnvConfig.of("random", 42)


@pytest.fixture(autouse=True)
def small_buffers(monkeypatch):
    """Let the server's sockets hold little: what is not read waits in the server."""

    def listen_small(*address):
        sock = listening_on(*address)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        return sock

    listening_on = listening.listen
    monkeypatch.setattr(listening, "listen", listen_small)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A database of episodes whose steps are more bytes than sockets hold, and how many steps they are."""
    path = tmp_path_factory.mktemp("long") / "playground.db"
    policy = load("frontier-cost", CONFIG.sensor_radius)
    actions = play_episode(policy, CONFIG, 4).actions
    store = Store(path)
    for _ in range(EPISODES):
        row, episode = open_episode(store, add_session(store), 4, CONFIG)
        add_steps(store, row, episode, actions, "human")
    store.close()
    return path, EPISODES * len(actions)


@pytest.fixture
def long_episodes(recorded, tmp_path):
    """The number of steps that the fixture `serve` finds in its database."""
    shutil.copy(recorded[0], tmp_path / "playground.db")
    return recorded[1]


def checkpoint(path):
    """Empty the write-ahead log; return whether somebody who reads stood in the way."""
    with contextlib.closing(sqlite3.connect(path, timeout=5)) as connection:
        return bool(connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0])


@contextlib.contextmanager
def slow_download(server):
    """Yield a socket that has asked for the table of steps and does not read it, with the head and what came along."""
    with socket.socket() as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", server.port))
        slow.settimeout(60)
        head = b"GET /api/export/steps.csv HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
        slow.sendall(head)
        answer, _, content = slow.recv(2000).partition(b"\r\n\r\n")
        assert answer.startswith(b"HTTP/1.1 200"), answer
        yield slow, answer, content


def test_a_slow_reader_gets_the_whole_table_and_keeps_no_transaction_open(
    serve, long_episodes, tmp_path
):
    server = serve()
    player = server.page()
    with slow_download(server) as (slow, head, content):
        about = player.post("/api/sessions", json={"size": 9}).json()
        frame, session = about["frame"], about["session"]
        east = frame["grid"][0][1] != "#"
        act = {"episode": frame["episode"], "step": 0, "action": "east" if east else "south"}
        moved = player.post(f"/api/sessions/{session}/act", json=act)
        assert moved.json()["step"] == 1, "others' moves go on"
        assert not checkpoint(tmp_path / "playground.db"), (
            "nothing reads the database while the table is being sent"
        )
        while piece := slow.recv(1 << 16):
            content += piece
    length = int(head.lower().partition(b"content-length: ")[2].split(b"\r\n")[0])
    assert len(content) == length > 500_000, "more than the sockets hold"
    assert content.count(b"\n") == long_episodes + 1, "as it was when the export began"


@pytest.mark.usefixtures("long_episodes")
def test_a_download_leaves_no_file_behind_also_when_its_reader_goes(serve, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with slow_download(serve()):
        assert not list(tmp_path.glob("mars-download-*"))
        assert open_downloads()
    eventually(lambda: not open_downloads())


def open_downloads():
    """The downloads that this process holds open; their files have no name any more."""
    found = []
    for each in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            target = str(each.readlink())
            found += [target] if "mars-download-" in target else []
    return found
