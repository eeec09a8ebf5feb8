"""Tables over HTTP: a slow reader keeps no transaction and no place."""

import contextlib
import os
import shutil
import signal
import socket
import sqlite3
import sys
import threading
import time
from pathlib import Path

import httpx
import pytest

from humanplay.db.store import Store
from humanplay.web import downloads, listening
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies import load
from tests.support import job_functions
from tests.support.recorded import add_session, add_steps, open_episode
from tests.support.servers import eventually

EPISODES = 25
CONFIG = EnvConfig.of("random", 42)
STEPS = "/api/export/steps.csv"
linux = pytest.mark.skipif(
    sys.platform != "linux", reason="one machine has many addresses on Linux alone"
)


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
    """A database of episodes with more bytes than sockets hold, and its step count."""
    path = tmp_path_factory.mktemp("long") / "playground.db"
    policy = load("frontier-cost", CONFIG.sensor_radius)
    actions = play_episode(policy, CONFIG, 4).actions
    store = Store(path)
    for _ in range(EPISODES):
        row, episode = open_episode(store, add_session(store), 4, CONFIG)
        add_steps(store, row, episode, actions, "human")
    store.close()
    return path, EPISODES * len(actions)


@pytest.fixture(autouse=True)
def long_episodes(recorded, tmp_path):
    """The number of steps that the fixture `serve` finds in its database."""
    shutil.copy(recorded[0], tmp_path / "playground.db")
    return recorded[1]


def checkpoint(path):
    """Empty the write-ahead log; return whether somebody who reads stood in the way."""
    with contextlib.closing(sqlite3.connect(path, timeout=5)) as connection:
        return bool(connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0])


def get(server, address, path=STEPS):
    """Ask from one of this machine's addresses."""
    transport = httpx.HTTPTransport(local_address=address)
    with server.client(transport=transport) as client:
        return client.get(path)


@contextlib.contextmanager
def asking(server, address="127.0.0.1"):
    """Yield a socket that has asked for the table of steps, which it does not read."""
    with socket.socket() as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.bind((address, 0))
        slow.connect(("127.0.0.1", server.port))
        slow.settimeout(60)
        head = f"GET {STEPS} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
        slow.sendall(head.encode())
        yield slow


def begun(slow):
    """Return the head of an answer, and what came along."""
    answer, _, content = slow.recv(2000).partition(b"\r\n\r\n")
    assert answer.startswith(b"HTTP/1.1 200"), answer
    return answer, content


def trickle(slow, until, got):
    """Read a byte a second."""
    while not until.wait(1):
        got.append(slow.recv(1))


@linux
def test_two_who_read_a_byte_a_second_keep_no_place_and_no_transaction_and_get_the_whole_table(
    serve, long_episodes, tmp_path
):
    server = serve()
    player = server.page()
    done = threading.Event()
    with asking(server, "127.0.0.2") as one, asking(server, "127.0.0.3") as two:
        head, content = begun(one)
        begun(two)
        got = [], []
        reading = [
            threading.Thread(target=trickle, args=(client, done, bytes_of))
            for client, bytes_of in zip((one, two), got, strict=True)
        ]
        for thread in reading:
            thread.start()
        about = player.post("/api/sessions", json={"size": 9}).json()
        frame, session = about["frame"], about["session"]
        east = frame["grid"][0][1] != "#"
        act = {"episode": frame["episode"], "step": 0, "action": "east" if east else "south"}
        moved = player.post(f"/api/sessions/{session}/act", json=act)
        assert moved.json()["step"] == 1, "others' moves go on"
        assert not checkpoint(tmp_path / "playground.db"), (
            "nothing reads the database while the table is being sent"
        )
        third = get(server, "127.0.0.4")
        assert third.text.count("\n") == long_episodes + 1, "both places are free"
        eventually(lambda: all(got))
        done.set()
        for thread in reading:
            thread.join()
        content += b"".join(got[0])
        while piece := one.recv(1 << 16):
            content += piece
    length = int(head.lower().partition(b"content-length: ")[2].split(b"\r\n")[0])
    assert len(content) == length > 500_000, "more than the sockets hold"
    assert content.count(b"\n") == long_episodes + 1, "as it was when the export began"
    eventually(lambda: not open_downloads(os.getpid()))


@linux
def test_a_second_table_of_one_owner_is_refused_and_anothers_waits_for_its_turn(
    serve, long_episodes
):
    server = serve()
    for address in ("127.0.0.2", "127.0.0.3"):
        server.services.jobs.submit(job_functions.sleep, 3, owner=address)
    with asking(server, "127.0.0.2"), asking(server, "127.0.0.3"):
        eventually(lambda: len(server.services.downloads._writing) == 2)
        refused = get(server, "127.0.0.2")
        assert (refused.status_code, refused.headers["Retry-After"]) == (503, "5")
        assert refused.json()["detail"].startswith("another table of yours is")
        began = time.monotonic()
        table = get(server, "127.0.0.4")
        assert (table.status_code, table.text.count("\n")) == (200, long_episodes + 1)
        assert time.monotonic() - began > 1, "the others' two come first"
    eventually(lambda: not server.services.downloads._writing)


@linux
def test_a_table_whose_reader_goes_before_its_turn_keeps_no_place(serve):
    server = serve()
    for address in ("127.0.0.2", "127.0.0.3"):
        server.services.jobs.submit(job_functions.sleep, 3, owner=address)
    with asking(server, "127.0.0.2"), asking(server, "127.0.0.3"):
        eventually(lambda: len(server.services.downloads._writing) == 2)
        with asking(server, "127.0.0.4"):
            eventually(lambda: len(server.services.downloads._writing) == 3)
        assert get(server, "127.0.0.5").status_code == 200
    eventually(lambda: not server.services.downloads._writing)


def test_a_table_that_is_sent_has_no_name_and_is_closed_when_its_reader_goes(serve, tmp_path):
    server = serve()
    folder = tmp_path / "playground.db-downloads"
    with asking(server) as slow:
        begun(slow)
        assert not list(folder.iterdir())
        assert open_downloads(os.getpid())
        assert server.services.downloads._sent["127.0.0.1"] > 500_000
    eventually(lambda: not open_downloads(os.getpid()))
    eventually(lambda: not server.services.downloads._sent)


def test_a_table_that_is_sent_for_too_long_is_closed_with_its_connection(serve, monkeypatch):
    monkeypatch.setattr(downloads, "SEND_S", 0.5)
    with asking(serve()) as slow:
        begun(slow)
        eventually(lambda: not open_downloads(os.getpid()), 10)


@pytest.mark.parametrize("lacks", ["room for the owner's", "room on the disk"])
def test_a_table_that_does_not_fit_is_refused_with_a_sentence_and_leaves_nothing(
    serve, tmp_path, monkeypatch, lacks
):
    if lacks == "room on the disk":
        usage = shutil.disk_usage(tmp_path)._replace(free=200_000)
        monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    else:
        monkeypatch.setattr(downloads, "MOST_BYTES", 100_000)
    server = serve()
    refused = server.client().get(STEPS)
    assert refused.status_code == 503
    sentence = "the table was not written: file too large, and there is room for 100,000 bytes"
    assert refused.json()["detail"].startswith(sentence)
    assert not list((tmp_path / "playground.db-downloads").iterdir())


@linux
def test_a_server_that_stops_while_a_table_is_written_and_sent_ends_soon_and_leaves_nothing(
    spawn, tmp_path
):
    folder = tmp_path / "playground.db-downloads"
    folder.mkdir()
    (folder / "of a server that was killed").write_bytes(b"half")
    server = spawn()
    assert not folder.exists()
    with asking(server, "127.0.0.2") as slow:
        begun(slow)
        with asking(server):
            eventually(lambda: list(folder.glob("*/steps.csv")))
            (writer,) = eventually(lambda: writers(folder))
            os.kill(writer, signal.SIGSTOP)  # so that it is being written when the server stops
            assert list(folder.glob("*/steps.csv"))
        began = time.monotonic()
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(15) == 0
        assert time.monotonic() - began < 5
    assert not folder.exists()
    lines = server.process.stdout.read().splitlines()
    assert not [line for line in lines if "Cancel 1 running task(s)" not in line], lines


def writers(folder):
    """The processes that write files of a folder, also files without a name.

    A file that is being sent has no name any more.
    """
    return [
        int(process.name)
        for process in Path("/proc").glob("[0-9]*")
        if any(not path.endswith(" (deleted)") for path in open_downloads(process.name, folder))
    ]


def open_downloads(process, folder="-downloads/"):
    """The tables that a process holds open; while they are sent, they have no name."""
    downloads = []
    with contextlib.suppress(OSError):
        for link in Path(f"/proc/{process}/fd").iterdir():
            with contextlib.suppress(FileNotFoundError):
                downloads += [target] if str(folder) in (target := str(link.readlink())) else []
    return downloads
