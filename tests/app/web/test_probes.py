"""/healthz: the server is alive. /readyz: it can record a move."""

import sqlite3
import time
from contextlib import closing

from tests.support.recorded import ask


def written_ms(server):
    rows = ask(server.services.store.path, "SELECT value FROM meta WHERE name = 'written_ms'")
    return int(rows[0][0]) if rows else 0


def test_a_server_is_alive_and_ready_and_has_written(server):
    client = server.client()
    assert client.get("/healthz").raise_for_status().json() == {"status": "ok"}
    assert written_ms(server) == 0, "being alive writes nothing"
    before = time.time_ns() // 1_000_000
    assert client.get("/readyz").raise_for_status().json() == {"status": "ok"}
    assert before <= written_ms(server) <= time.time_ns() // 1_000_000


def test_a_server_whose_database_takes_no_write_is_alive_but_not_ready(server):
    client = server.client()
    with closing(sqlite3.connect(server.services.store.path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        began = time.monotonic()
        answer = client.get("/readyz")
        assert (answer.status_code, "locked" in answer.json()["detail"]) == (503, True)
        assert 0.9 < time.monotonic() - began < 4, "it waits a second for a busy disk"
        assert client.get("/healthz").status_code == client.get("/api/health").status_code == 200
        other.execute("ROLLBACK")
    assert client.get("/readyz").status_code == 200
