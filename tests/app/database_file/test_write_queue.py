"""Another program holds the lock for writing: moves wait and say so, and nobody else notices."""

import asyncio
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest

from app.database_file.write_queue import MAX_WAITING, REFUSED, WAITS, DatabaseLockedError, WriteQueue
from tests.support.servers import eventually

HOLD = """import sqlite3, sys
db = sqlite3.connect(sys.argv[1], isolation_level=None)
db.execute("BEGIN IMMEDIATE")
print("locked", flush=True)
sys.stdin.read()
db.execute("ROLLBACK")
db.close()
print("free", flush=True)
"""


@contextmanager
def locked_elsewhere(path):
    """Let another process hold the lock for writing during the block."""
    command = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "locked\n"
        try:
            yield
        finally:
            process.stdin.close()
            assert process.stdout.readline() == "free\n"


def waits_ms(client, paths, seconds):
    """Return how long each of the requests took that were made one after the other for some seconds."""
    waits, began = [], time.monotonic()
    while time.monotonic() - began < seconds:
        for path in paths:
            asked = time.perf_counter()
            assert client.get(path).status_code == 200
            waits.append(1000 * (time.perf_counter() - asked))
        time.sleep(0.01)
    return waits


@pytest.mark.parametrize("held_s", [1.3, pytest.param(10, marks=pytest.mark.long)])
def test_a_locked_database_delays_moves_alone_and_its_player_knows_why(serve, tmp_path, held_s):
    server = serve()
    path, client, other = tmp_path / "playground.db", server.client(), server.client()
    begun = client.post("/api/sessions", json={"size": [9, 13], "seed": 5}).json()
    drives = client.post("/api/sessions", json={"size": [9, 13], "player": "frontier-cost", "seed": 6}).json()["session"]
    client.post(f"/api/sessions/{drives}/pace", json={"moves_per_second": 1}).raise_for_status()
    paths = ["/", "/api/levels", f"/api/sessions/{begun['session']}", "/api/episodes"]
    with server.socket(begun["session"], client) as socket, ThreadPoolExecutor(1) as pool:
        frame = socket.receive("frame")
        socket.receive("history")
        before = waits_ms(other, paths, min(held_s, 3))
        with locked_elsewhere(path):
            for step, action in enumerate(["south", "north", "south"]):
                socket.act({**frame, "step": step}, action)
            begins = pool.submit(client.post, "/api/sessions", json={"size": [9, 13], "seed": 7})
            during = waits_ms(other, paths, held_s)
            assert socket.receive() == {"kind": "error", "detail": WAITS}
            assert not begins.done()
            assert client.get(f"/api/sessions/{begun['session']}").json() == frame, "no frame before its step is committed"
        assert socket.frame_after(2)["step"] == 3
        assert begins.result().status_code == 201
    made = [step["action"] for step in server.services.store.steps(frame["episode"])]
    assert made == [2, 0, 2]
    driven = client.get(f"/api/sessions/{drives}").json()
    eventually(lambda: client.get(f"/api/sessions/{drives}").json()["step"] > driven["step"])
    p99, p99_before = np.percentile(during, 99), np.percentile(before, 99)
    print(f"\n{held_s} s locked: answers to others p99 {p99:.1f} ms, slowest {max(during):.1f}; before p99 {p99_before:.1f}")
    assert max(during) < 1000, "today's wait of SQLite would be 5 seconds"
    assert np.median(during) < 3 * np.median(before) + 5


def test_writes_run_in_turn_when_the_lock_is_gone_and_too_many_are_refused_at_once(monkeypatch):
    monkeypatch.setattr("app.database_file.write_queue.MAX_WAITING", 3)
    assert MAX_WAITING == 1000
    locked, made = [True], []

    def write(number):
        if locked[0]:
            raise DatabaseLockedError
        made.append(number)
        return number

    async def scenario():
        queue = WriteQueue(lambda: locked[0])
        waiting = [asyncio.create_task(queue.run(lambda number=number: write(number))) for number in range(3)]
        await asyncio.sleep(0.01)
        assert len(queue) == 3
        with pytest.raises(DatabaseLockedError, match=REFUSED):
            await queue.run(lambda: write(99))
        locked[0] = False
        assert await asyncio.gather(*waiting) == [0, 1, 2]
        assert len(queue) == 0

    asyncio.run(scenario())
    assert made == [0, 1, 2]


def test_a_write_is_refused_when_the_lock_stays(monkeypatch):
    monkeypatch.setattr("app.database_file.write_queue.PATIENCE_S", 0.05)

    def write():
        raise DatabaseLockedError

    with pytest.raises(DatabaseLockedError, match="nothing has changed; try again"):
        asyncio.run(WriteQueue(lambda: True).run(write))
