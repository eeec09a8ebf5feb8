"""A full disk or a clock that is set back refuses moves, and loses none."""

import sys
import time

import pytest

from humanplay.study.verification import verify_database

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


def limit_files(server, limit):
    """Let no file of a server grow, as on a full disk; return its former limit."""
    if sys.platform != "linux":
        pytest.skip("the limit of another process is set by a call of Linux")
    before = resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, (limit, before[1]))
    return before[0]


def test_a_full_disk_refuses_moves_and_loses_none(spawn, tmp_path):
    server = spawn()
    client = server.client()
    begun = begin(client)
    codes = [act(client, begun, step).status_code for step in range(4)]
    assert codes == [200] * 4
    before = limit_files(server, 4096)
    for _ in range(3):
        refused = act(client, begun, 4)
        assert refused.status_code == 503
        assert "did not take the write, nothing changed" in refused.json()["detail"]
        assert str(tmp_path) not in refused.json()["detail"]
    assert client.get("/readyz").status_code == 503
    assert client.get(f"/api/sessions/{begun['session']}").json()["step"] == 4
    limit_files(server, before)
    assert act(client, begun, 4).json()["step"] == 5
    server.kill()
    again = spawn()
    assert again.client().get(f"/api/sessions/{begun['session']}").json()["step"] == 5
    again.close()
    assert not verify_database(tmp_path / "playground.db").findings


def test_a_policy_waits_while_the_disk_is_full_says_so_once_and_goes_on_by_itself(spawn):
    server = spawn()
    client = server.client()
    wanted = {"size": 42, "seed": 5, "player": "frontier-cost"}
    session = client.post("/api/sessions", json=wanted).json()["session"]
    pace = {"moves_per_second": 20}
    client.post(f"/api/sessions/{session}/pace", json=pace).raise_for_status()
    with server.socket(session, client) as socket:
        socket.receive("frame")
        before = limit_files(server, 4096)
        assert "did not take the write, nothing changed" in socket.receive("error")["detail"]
        time.sleep(2.5)
        step = client.get(f"/api/sessions/{session}").json()["step"]
        limit_files(server, before)
        while (message := socket.receive())["kind"] != "frame" or message["step"] <= step:
            assert message["kind"] != "error"
    server.close()


def test_a_clock_that_is_set_back_spoils_no_persons_episode(server, tmp_path):
    client = server.page()
    begun = client.post("/api/sessions", json={"size": [9, 12]}).json()

    def set_back(socket, frame, action):
        server.clock.set_back_ms += 2 * HOUR_MS * (frame["step"] == 4)

    frame = server.explore(client, begun["session"], set_back)
    episode = client.get(f"/api/episodes/{frame['episode']}").json()
    assert (episode["driver"], episode["attestation"]) == ("human", "attested")
    assert episode["attestation_reason"] is None
    assert verify_database(tmp_path / "playground.db").findings == ()
