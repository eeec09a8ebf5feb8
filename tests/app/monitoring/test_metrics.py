"""The metrics count what happened, on a port of their own."""

import socket
import timeit

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from humanplay.db.metrics import Metrics
from humanplay.tasks.mars.run import occupancy_codes
from humanplay.web.server import ServerError, run
from humanplay.web.settings import Settings
from marsexplorer.config import ACTIONS
from marsexplorer.policies import load
from tests.support.servers import eventually


def read(text):
    """Return {(name, labels without `le`): value} of all samples but buckets."""
    return {
        (sample.name.removeprefix("humanplay_"), *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if "le" not in sample.labels
    }


@pytest.fixture
def watched(spawn):
    """A server in a process of its own with metrics; `watched.metrics()` reads them."""
    server = spawn(metrics_port=0)
    (line,) = [line for line in server.printed if line.startswith("metrics")]
    server.metrics_url = line.split()[-1]
    server.metrics = lambda: read(httpx.get(server.metrics_url, trust_env=False, verify=False).text)
    yield server
    server.kill()


def test_moves_refusals_and_sockets_are_counted(watched):
    before = watched.metrics()
    assert before["sessions",] == before["sockets",] == 0
    client = watched.page()
    begun = client.post("/api/sessions", json={"size": [7, 9], "seed": 1}).json()
    with watched.socket(begun["session"], client) as board:
        frame = board.receive("frame")
        board.act(frame, "east", input="key")
        board.frame_after(0)
        board.act(frame, "east", input="key")
        assert board.receive("refused")
        board.send("nonsense")
        board.receive("error")
        counted = watched.metrics()
        assert (counted["sockets",], counted["sessions",]) == (1, 1)
    assert counted["moves_total", "human"] == counted["step_seconds_count",] == 1
    assert 0 < counted["commit_seconds_sum",] < counted["commit_seconds_count",]
    assert counted["commit_seconds_count",] > before["commit_seconds_count",]
    assert counted["refusals_total", "not_current"] == counted["refusals_total", "bad_message"] == 1
    assert client.get("/api/sessions/nobody").status_code == 404
    # the answer is counted after it was sent
    counts = "refusals_total", "http_404"
    after = eventually(
        lambda: (now := watched.metrics())["sockets",] == 0 and counts in now and now
    )
    assert after[counts] == after["http_requests_total", "404"] == 1
    assert after["disk_free_bytes",] > 0
    assert after["database_bytes",] > 0
    assert after["process_resident_memory_bytes",] > 1_000_000
    assert eventually(lambda: watched.metrics()["event_loop_lag_seconds_count",] > 0)


def test_the_metrics_are_on_their_own_port_and_on_this_machine_alone(watched):
    assert httpx.URL(watched.metrics_url).host == "127.0.0.1"
    port = httpx.URL(watched.metrics_url).port
    assert port != watched.port
    # it does not listen on every address of the machine
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", port))
    assert watched.client().get("/metrics").status_code == 404


def test_without_the_flag_there_is_no_listener(spawn):
    server = spawn()
    assert not [line for line in server.printed if "metrics" in line]
    server.kill()


def test_a_port_in_use_is_said_before_anything_starts(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        reason = f"cannot serve metrics on 127.0.0.1 port {port}: .* choose another with --metrics"
        with pytest.raises(ServerError, match=reason):
            run(Settings(port=0, metrics_port=port, database=tmp_path / "new.db"))
    assert not (tmp_path / "new.db").exists()


def test_a_frame_that_a_slow_subscriber_never_got_is_counted(server):
    client = server.page()
    begun = client.post("/api/sessions", json={"size": [7, 9], "seed": 1}).json()
    session = server.services.lobby.in_memory(begun["session"])
    dropped = server.services.store.metrics.dropped_frames

    def count():
        return next(iter(dropped.collect())).samples[0].value

    with session.channel.subscribe():  # it never asks
        for _ in range(3):
            session.channel.publish(session.frame)
    assert count() == 3, "the one it found, and the two that came before the newest"


def test_the_slowest_of_the_newest_moves_are_told():
    metrics = Metrics()
    assert metrics.values("move_p99_seconds") == {"move_p99_seconds": 0}
    for number in range(5000):
        metrics.newest_s.append(number % 1000 / 1000)
    assert metrics.values("move_p99_seconds") == {"move_p99_seconds": 0.99}


def test_counting_costs_less_than_a_twentieth_of_a_move(server):
    """The server's histogram measures the moves, timeit the counting alone."""
    client, policy = server.client(), load("frontier-cost")
    begun = client.post("/api/sessions", json={"seed": 1}).json()
    policy.reset(1)
    frame = begun["frame"]
    while frame["outcome"] is None and frame["step"] < 100:
        action = ACTIONS[policy.act(occupancy_codes(frame))]
        answer = {"episode": frame["episode"], "step": frame["step"], "action": action}
        frame = client.post(f"/api/sessions/{begun['session']}/act", json=answer).json()
    value = server.services.store.metrics.registry.get_sample_value
    move_s = value("humanplay_step_seconds_sum") / value("humanplay_step_seconds_count")
    other = Metrics()

    def count():
        other.moves["script"].inc()
        other.step.observe(move_s)
        other.newest_s.append(move_s)
        other.commit.observe(move_s)

    counting_s = min(timeit.repeat(count, number=1000, repeat=5)) / 1000
    print(f"a move {move_s * 1e6:.0f} us, counting it {counting_s * 1e6:.1f} us")
    assert counting_s < move_s / 20
