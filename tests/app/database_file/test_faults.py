"""Failing disks, clocks, processes and time zones lose nothing acknowledged."""

import os
import secrets
import signal
import subprocess
import sys
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

import pytest

from humanplay.board.session import NOT_STORED
from humanplay.study.verification import verify_database
from humanplay.web.simulate import KEY_CODES, Clock
from tests.support.command_server import command_server
from tests.support.faults import FakeClock, failing, needs_faketime, needs_strace
from tests.support.page_loads import LOAD
from tests.support.servers import PATIENCE_S, RunningServer

SERVE = [sys.executable, "-m", "humanplay.cli", "serve", "--port", "0", "--database"]
BOARD = {"size": [9, 13], "seed": 5}
NOT_TAKEN = "the database playground.db did not take the write, nothing changed"
ACTIONS = ("south", "north", "north")
"""The last one leaves the grid and ends the episode."""


def pressed(socket, frame, action):
    """Take a person's time, and return a press's messages: input event and move."""
    socket.clock.wait(150)
    at_ms = socket.clock.page_ms()
    key = {"kind": "keydown", "code": KEY_CODES[action], "repeat": False, "trusted": True}
    events = [{**key, "client_ms": at_ms, "step": frame["step"]}]
    events.append({**events[0], "kind": "keyup", "client_ms": at_ms + 40})
    batch = {"batch": secrets.token_hex(8), "episode": frame["episode"], **LOAD}
    move = {"kind": "act", "episode": frame["episode"], "step": frame["step"], "action": action}
    times = {"input": "key", "key_down_ms": at_ms, "client_ms": at_ms}
    return {"kind": "events", **batch, "events": events}, {**move, **times}


def make(socket, frame, action):
    """Make a person's move, and return its frame."""
    for message in pressed(socket, frame, action):
        socket.send(message)
    return socket.frame_after(frame["step"])


def at_a_persons_pace(server):
    server.clock = Clock()
    return server


def level_of(client, episode):
    stored = client.get(f"/api/episodes/{episode}").json()
    return stored["driver"], stored["attestation"], stored["attestation_reason"]


@contextmanager
def served(path, environment):
    """Yield a server that its command starts."""
    with command_server([*SERVE, path], env=os.environ | environment) as (process, address):
        server = at_a_persons_pace(RunningServer(int(address.rsplit(":", 1)[1].strip("/"))))
        server.process = process
        try:
            yield server
        finally:
            server.close()


@needs_strace
@pytest.mark.parametrize(
    ("error", "first"),
    [("ENOSPC", 1), ("ENOSPC", 4), ("EIO", 1), ("EIO", 4), ("EROFS", 1)],
)
def test_a_disk_that_fails_at_any_write_of_an_episode_loses_nothing(spawn, tmp_path, error, first):
    """At the beginning, at each press and move, and at the end.

    From the fourth write on a commit is torn.
    """
    server, log = at_a_persons_pace(spawn()), tmp_path / "playground.db-wal"
    client = server.page()
    with failing(server, log, error, first=first):
        refused = client.post("/api/sessions", json=BOARD)
        assert (refused.status_code, refused.json()["detail"][: len(NOT_TAKEN)]) == (503, NOT_TAKEN)
        assert client.get("/readyz").status_code == 503
    begun = client.post("/api/sessions", json=BOARD).json()
    board = f"/api/sessions/{begun['session']}"
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        for action in ACTIONS:
            events, move = pressed(socket, frame, action)
            with failing(server, log, error, first=first):
                socket.send(events)
                assert socket.receive("kept")["count"] == 0
            socket.send(move)
            assert socket.receive("error")["detail"] == NOT_STORED, "a move without its press"
            socket.send(events)
            assert socket.receive("kept")["count"] == 2
            with failing(server, log, error, first=first):
                socket.send(move)
                assert NOT_TAKEN in socket.receive("error")["detail"]
                assert client.get(board).json()["step"] == frame["step"]
            socket.send(move)
            frame = socket.frame_after(frame["step"])
        assert frame["outcome"] is not None
    lines = server.process.stdout.read()
    server.kill()
    assert (
        lines.count("takes no writes") == lines.count("takes writes again") == 2 * len(ACTIONS) + 1
    )
    assert "Traceback" not in lines
    again = spawn()
    client = again.page(cookies=client.cookies)
    assert client.get(board).json() == frame
    assert level_of(client, frame["episode"]) == ("human", "attested", None)
    again.kill()
    assert not verify_database(tmp_path / "playground.db").findings


@needs_strace
@pytest.mark.parametrize(
    ("suffix", "call", "end"),
    [
        ("-lock", "write", signal.SIGKILL),
        ("", "write", signal.SIGTERM),
        ("", "sync", signal.SIGTERM),
        ("-wal", "sync", signal.SIGTERM),
    ],
    ids=["note", "checkpoint", "sync of the file", "sync of the log"],
)
def test_a_disk_that_fails_beside_the_log_loses_no_move(spawn, tmp_path, suffix, call, end):
    """The commit's note, and the copy and sync when a server ends."""
    server, path = at_a_persons_pace(spawn()), tmp_path / f"playground.db{suffix}"
    client = server.page()
    begun = client.post("/api/sessions", json=BOARD).json()
    with server.socket(begun["session"], client) as socket:
        frame = make(socket, socket.receive("frame"), ACTIONS[0])
        with failing(server, path, "EIO", call):
            frame = make(socket, frame, ACTIONS[1])
            server.process.send_signal(end)
            server.process.wait(PATIENCE_S)
    again = spawn()
    client = again.page(cookies=client.cookies)
    assert client.get(f"/api/sessions/{begun['session']}").json() == frame
    again.kill()
    assert not verify_database(tmp_path / "playground.db").findings


@pytest.mark.skipif(
    subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode != 0,
    reason="NO MOUNT NAMESPACE: a full and a read-only file system are mounted by root",
)
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("size=40k", "the disk is full: make room, or give another --database"),
        ("ro", "Read-only file system; give another --database"),
    ],
)
def test_a_server_on_a_full_or_read_only_file_system_says_what_to_do(tmp_path, options, words):
    mount = f"mount -t tmpfs -o {options} tmpfs {tmp_path}"
    serve = ["unshare", "-m", "sh", "-c", f'{mount} && exec "$@"', "sh", *SERVE, tmp_path / "a.db"]
    done = subprocess.run(serve, capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.endswith(f"{words}\n")
    assert done.stderr.count("\n") == 1


@needs_faketime
def test_a_clock_that_is_set_and_another_time_zone_lose_no_move_and_spoil_no_episode(
    spawn, tmp_path
):
    """At noon in UTC Kiribati has the next day; the clock is set between two starts."""
    path, clock = tmp_path / "playground.db", FakeClock(tmp_path / "clock")
    now = datetime.now(UTC)
    noon = now.replace(hour=12, minute=0, second=0) - now
    clock.set(noon)
    with served(path, clock.environment | {"TZ": "Pacific/Kiritimati"}) as server:
        client = server.page()
        assert client.get("/api/daily").json()["day"] == (now + noon).date().isoformat()
        begun = client.post("/api/sessions", json=BOARD).json()
        with server.socket(begun["session"], client) as socket:
            frame = make(socket, socket.receive("frame"), "south")
            clock.set(noon - timedelta(hours=2))
            frame = make(socket, frame, "north")
            clock.set(noon + timedelta(days=3))
            frame = make(socket, frame, "south")
        server.process.kill()
        server.process.wait()
    server = at_a_persons_pace(spawn())
    client = server.page(cookies=client.cookies)
    assert client.get(f"/api/sessions/{begun['session']}").json() == frame
    with server.socket(begun["session"], client) as socket:
        frame = make(socket, socket.receive("frame"), "north")
        frame = make(socket, frame, "north")
    assert frame["outcome"] is not None
    assert level_of(client, frame["episode"]) == ("human", "attested", None)
    server.kill()
    assert not verify_database(path).findings


@pytest.mark.parametrize("end", [signal.SIGCONT, signal.SIGKILL])
def test_a_server_that_is_stopped_under_play_loses_no_move(spawn, tmp_path, end):
    """What a page sends meanwhile is played later; a killed server answered nothing."""
    server = at_a_persons_pace(spawn())
    client = server.page()
    begun = client.post("/api/sessions", json=BOARD).json()
    with server.socket(begun["session"], client) as socket:
        frame = make(socket, socket.receive("frame"), ACTIONS[0])
        server.process.send_signal(signal.SIGSTOP)
        for message in pressed(socket, frame, ACTIONS[1]):
            socket.send(message)
        with pytest.raises(TimeoutError):
            socket.receive("frame", seconds=1.5)
        server.process.send_signal(end)
        if end == signal.SIGCONT:
            frame = socket.frame_after(frame["step"])
            frame = make(socket, frame, ACTIONS[2])
            assert level_of(client, frame["episode"]) == ("human", "attested", None)
            server.kill()
    again = spawn()
    client = again.page(cookies=client.cookies)
    assert client.get(f"/api/sessions/{begun['session']}").json() == frame
    again.kill()
    assert not verify_database(tmp_path / "playground.db").findings
