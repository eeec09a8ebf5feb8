"""Sessions that come and go leave memory and file descriptors as they were."""

import random
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.support.servers import eventually

pytestmark = pytest.mark.long

GROWTH = 1.05
"""Resident memory at the end, as a share of that at the beginning, at most."""

BUCKETS = ("sessions_per_address", "sessions_per_player", "handshakes_per_address")
UNLIMITED = dict.fromkeys(BUCKETS, "1000000+1000000/s") | {"stored_address_percent": 100.0}


def state_of(server):
    """Resident memory (MB) and open descriptors, once no session is in memory."""
    with server.client() as client:
        eventually(lambda: client.get("/api/health").json()["sessions"] == 0)
    time.sleep(6)  # connections that were kept open for another request end
    status = Path(f"/proc/{server.process.pid}/status").read_text()
    memory = int(status.split("VmRSS:")[1].split()[0]) / 1024
    return memory, len(list(Path(f"/proc/{server.process.pid}/fd").iterdir()))


def come_and_go(server, number):
    """Begin a board, some with a rival, look at it, move, and leave, politely or not."""
    chance = random.Random(number)
    client = server.page()
    rival = "frontier-cost" if number % 5 == 0 else None
    body = {"size": chance.choice((9, 21)), "rival": rival}
    response = client.post("/api/sessions", json=body)
    assert response.status_code == 201, response.text
    begun = response.json()
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        for _ in range(3):
            if frame["outcome"] is None:
                socket.act(frame, chance.choice(("north", "east", "south", "west")), input="key")
                frame = socket.frame_after(frame["step"])
        if number % 3 == 0:
            socket.connection.socket.shutdown(2)
    if number % 7 == 0:
        with server.socket(begun["watch"], path="/ws/watch/") as watcher:
            watcher.receive("frame")
    client.close()


def test_memory_and_descriptors_come_back_after_a_thousand_sessions(spawn):
    """On a warm server: code compiled, caches filled, threads started.

    Each thread that reads has a connection to the database, so as many people come at once before as later.
    """
    server = spawn(idle_s=1.0, limits=UNLIMITED)
    with ThreadPoolExecutor(8) as people:
        list(people.map(lambda number: come_and_go(server, number), range(200)))
    before = state_of(server)
    with ThreadPoolExecutor(8) as people:
        list(people.map(lambda number: come_and_go(server, number), range(1000)))
    after = state_of(server)
    print(f"\n1,000 sessions: MB and descriptors {before} -> {after}")
    assert after[0] <= GROWTH * before[0]
    assert after[1] <= before[1]
