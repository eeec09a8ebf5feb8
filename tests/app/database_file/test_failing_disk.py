"""A disk that takes no writes and a clock that is set back: moves are refused in words, and play goes on where it stood."""

import sys

import pytest

from app.series.verification import verify_database

resource = pytest.importorskip("resource")
HOUR_MS = 3_600_000


def begin(client):
    return client.post("/api/sessions", json={"size": [9, 13], "seed": 5}).json()


def act(client, begun, step, action=None):
    """Move south and north in turn."""
    body = {
        "kind": "act",
        "episode": begun["frame"]["episode"],
        "step": step,
        "action": action or ("south", "north")[step % 2],
    }
    return client.post(f"/api/sessions/{begun['session']}/act", json=body)


@pytest.mark.skipif(
    sys.platform != "linux", reason="the limit of another process is set by a call of Linux"
)
def test_a_full_disk_refuses_moves_and_loses_none(spawn, tmp_path):
    server = spawn()
    client, limit = server.client(), resource.RLIMIT_FSIZE
    begun = begin(client)
    made = [act(client, begun, step).status_code for step in range(4)]
    assert made == [200] * 4
    before = resource.prlimit(server.process.pid, limit)
    resource.prlimit(server.process.pid, limit, (4096, before[1]))
    for _ in range(3):
        refused = act(client, begun, 4)
        assert refused.status_code == 503
        assert "did not take the write, nothing changed" in refused.json()["detail"]
    assert client.get("/readyz").status_code == 503
    assert client.get(f"/api/sessions/{begun['session']}").json()["step"] == 4
    resource.prlimit(server.process.pid, limit, before)
    assert act(client, begun, 4).json()["step"] == 5
    server.kill()
    again = spawn()
    assert again.client().get(f"/api/sessions/{begun['session']}").json()["step"] == 5
    again.close()
    assert not verify_database(tmp_path / "playground.db").findings


def test_a_database_that_becomes_read_only_refuses_moves_until_it_can_be_written(server):
    client = server.client()
    begun = begin(client)
    assert act(client, begun, 0).json()["step"] == 1
    server.execute("PRAGMA query_only = ON")
    refused = act(client, begun, 1)
    assert (refused.status_code, "nothing changed" in refused.json()["detail"]) == (503, True)
    assert client.get(f"/api/sessions/{begun['session']}").json()["step"] == 1
    server.execute("PRAGMA query_only = OFF")
    assert act(client, begun, 1).json()["step"] == 2


def test_a_clock_that_is_set_back_loses_no_move(server, tmp_path):
    client = server.client()
    begun = begin(client)
    steps = [act(client, begun, step).json()["step"] for step in range(3)]
    server.clock.skipped_ms -= 2 * HOUR_MS
    steps += [act(client, begun, step).json()["step"] for step in range(3, 6)]
    assert steps == [1, 2, 3, 4, 5, 6]
    outcome = None
    while outcome is None:
        frame = client.get(f"/api/sessions/{begun['session']}").json()
        outcome = frame["outcome"] or act(client, begun, frame["step"], "west").json()["outcome"]
    assert client.post(f"/api/sessions/{begun['session']}/episodes", json={}).status_code == 201
    assert begun["frame"]["episode"] in {
        each["episode"] for each in client.get("/api/episodes").json()
    }
    result = verify_database(tmp_path / "playground.db")
    assert (result.episodes, result.findings) == (1, ())
