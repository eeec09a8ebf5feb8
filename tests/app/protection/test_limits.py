"""How much one client may open, send and ask, by address, cookie and socket."""

import re
import socket as sockets
import struct
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from humanplay.web.protection.limits import MAX_BUCKETS, PATIENCE, PENALTY, Buckets, TokenBucket
from humanplay.web.settings import Limits, Settings
from tests.support.servers import eventually
from tests.support.study import Person, freeze
from tests.support.viewer3d import CAMERA, View

TOKEN = "a-token-of-the-operator"


def masked(opcode, payload):
    """A final frame of a client, masked with zeros."""
    size = len(payload)
    length = bytes([128 | size]) if size < 126 else b"\xfe" + struct.pack("!H", size)
    return bytes([128 | opcode]) + length + bytes(4) + payload


def begin(server):
    client = server.client()
    return client, client.post("/api/sessions", json={"size": [9, 13], "seed": 5}).json()


def why_closed(connection):
    """Read until a socket is closed, and return the code and the words."""
    try:
        while True:
            connection.recv(timeout=20)
    except ConnectionClosed as closed:
        return closed.rcvd.code, closed.rcvd.reason


def test_a_bucket_gives_its_burst_at_once_and_its_rate_after_that_and_owes_one_penalty_at_most():
    now = [0.0]
    bucket = TokenBucket(3, 2.0, lambda: now[0])
    assert [bucket.take() for _ in range(5)] == [0, 0, 0, 0.5, 0.5]
    now[0] = 0.5
    assert [bucket.take(), bucket.take()] == [0, 0.5]
    now[0] = 60.0
    assert bucket.is_full
    for _ in range(20):
        bucket.owe(10)
    assert bucket.take() == pytest.approx(5.5)


def test_buckets_that_are_full_again_are_forgotten():
    buckets = Buckets("2+1000000/s")
    for number in range(3 * MAX_BUCKETS):
        buckets.of(str(number)).take()
    assert len(buckets) <= MAX_BUCKETS + 1


@pytest.mark.parametrize(
    "written", ["", "20", "20+/s", "0+1/s", "20+0.0/s", "-1+2/s", "20+2/minute", "1e3+1/s"]
)
def test_a_size_that_is_none_is_refused_in_words(written):
    with pytest.raises(ValueError, match="expected BURST"):
        Limits(messages=written)


def test_a_variable_changes_one_limit(monkeypatch):
    monkeypatch.setenv("HUMANPLAY_LIMITS__MESSAGES", "50+10/s")
    assert Settings().limits.messages == "50+10/s"


def test_sockets_beyond_the_cap_are_refused_and_their_places_are_given_back(serve):
    server = serve(limits=Limits(sockets_per_address=3))
    client, begun = begin(server)
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(server.socket(begun["session"], client)).receive("frame")
        with pytest.raises(InvalidStatus) as refused, server.socket(begun["session"], client):
            pass
        answer = refused.value.response
        assert (answer.status_code, answer.headers["Retry-After"]) == (503, "30")
        assert b"too many sockets are open" in answer.body
    eventually(lambda: server.protection.sockets == 0)
    with server.socket(begun["session"], client) as socket:
        socket.receive("frame")


def test_sockets_in_all_have_a_cap_whatever_their_addresses(serve):
    server = serve(limits=Limits(sockets=2), trusted_proxies=("127.0.0.1",))
    _, begun = begin(server)
    with ExitStack() as stack:
        for number in range(2):
            visitor = {"X-Forwarded-For": f"203.0.113.{number}"}
            stack.enter_context(server.socket(begun["session"], **visitor)).receive("frame")
        opened = server.socket(begun["session"], **{"X-Forwarded-For": "203.0.113.9"})
        with pytest.raises(InvalidStatus) as refused, opened:
            pass
    assert refused.value.response.status_code == 503


@pytest.mark.parametrize("kind", ["play", "watch", "viewer"])
def test_a_flood_closes_any_socket_with_1008_and_costs_its_address_handshakes(serve, kind):
    # so slow that a busy machine does not answer faster than the messages are earned
    limits = Limits(messages="20+60/s", handshakes_per_address=f"{PENALTY}+0.1/s")
    server = serve(limits=limits)
    client, begun = begin(server)
    with ExitStack() as stack:
        if kind == "viewer":
            flooded = View(server, begun["session"], stack, client).socket
            message = masked(2, CAMERA)
        else:
            path = "/ws/watch/" if kind == "watch" else "/ws/sessions/"
            name = begun["watch" if kind == "watch" else "session"]
            flooded = stack.enter_context(server.socket(name, client, path=path)).connection
            message = masked(1, b"nonsense")
        flooded.socket.sendall(message * (PATIENCE + 200))
        reason = "too many messages: 20 at once and 60 a second are answered"
        assert why_closed(flooded) == (1008, reason)
    assert server.protection.refusals["messages"] == 1
    with pytest.raises(InvalidStatus) as refused, server.socket(begun["session"]):
        pass
    assert refused.value.response.status_code == 429
    assert b"too many new sockets from this network" in refused.value.response.body
    eventually(lambda: server.protection.sockets == 0)


@pytest.mark.parametrize("opcode", [9, 10, 0], ids=["pings", "pongs", "parts of a message"])
def test_a_flood_of_frames_that_are_no_message_closes_its_socket(serve, opcode):
    server = serve(limits=Limits(handshakes_per_address=f"{PENALTY}+0.1/s"))
    client, begun = begin(server)
    with server.socket(begun["session"], client) as board:
        connection = board.connection
        first = b"" if opcode else bytes([1, 128]) + bytes(4)
        part = bytes([128 * (opcode > 0) | opcode]) + masked(opcode, b"")[1:]
        connection.socket.sendall(first + part * 300)
        reason = "too many pings, pongs or parts of messages: 100 at once and 10 a second are read"
        assert why_closed(connection) == (1008, reason)
    with pytest.raises(InvalidStatus) as refused, server.socket(begun["session"]):
        pass
    assert refused.value.response.status_code == 429
    assert server.protection.refusals["messages"] == 1
    eventually(lambda: server.protection.sockets == 0)


def test_a_script_that_waits_for_each_frame_is_slowed_down_and_never_closed(serve):
    server = serve(limits=Limits(messages="1+400/s"))
    client, begun = begin(server)
    with server.socket(begun["session"], client) as socket:
        socket.receive("history")  # on joining
        began = time.monotonic()
        for _ in range(2 * PATIENCE):
            socket.send({"kind": "history"})
            socket.receive("history")
        assert time.monotonic() - began >= (2 * PATIENCE - 1) / 400


def test_a_flood_leaves_the_board_as_it_was_and_the_player_comes_back(serve):
    server = serve(limits=Limits(messages="20+200/s"))
    client, begun = begin(server)
    with server.socket(begun["session"]) as stranger:
        stranger.connection.socket.sendall(masked(1, b"nonsense") * 400)
        assert why_closed(stranger.connection)[0] == 1008
    with server.socket(begun["session"], client) as socket:
        assert socket.receive("frame") == begun["frame"]
        socket.act(begun["frame"], "south")
        assert socket.frame_after(0)["step"] == 1


def test_boards_and_episodes_have_a_rate_for_each_player_and_for_each_address(serve):
    rates = {"sessions_per_player": "2+0.03/s", "sessions_per_address": "5+0.1/s"}
    server = serve(limits=Limits(episodes_per_player="1+0.001/s", **rates))
    first, second = server.client(), server.client()

    def begin_board(client):
        return client.post("/api/sessions", json={"size": 9})

    session = begin_board(first).json()["session"]  # without a cookie yet
    assert [begin_board(first).status_code for _ in range(2)] == [201, 201]
    refused = begin_board(first)
    assert refused.status_code == 429
    assert 1 <= int(refused.headers["retry-after"]) <= 34
    reason = (
        "too many new boards from this browser (2 at once and 0.03 a second at most): try again in"
    )
    assert reason in refused.json()["detail"]
    assert begin_board(second).status_code == 201
    refused = begin_board(second)
    assert (refused.status_code, "from this network" in refused.json()["detail"]) == (429, True)
    codes = [first.post(f"/api/sessions/{session}/episodes").status_code for _ in range(2)]
    assert codes == [201, 429]
    assert server.protection.refusals == {"rate_sessions": 2, "rate_episodes": 1}


def test_joins_have_a_rate_and_whoever_has_the_token_has_none(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve(limits=Limits(joins_per_address="3+0.001/s", token=TOKEN))

    def join(**headers):
        return server.client(headers=headers).post("/api/studies/small/join").status_code

    assert [join() for _ in range(4)] == [201, 201, 201, 429]
    assert join(**{"X-Humanplay-Token": TOKEN + "x"}) == 429
    for call in ("answers", "settings"):
        assert server.client().post(f"/api/studies/small/{call}", json={}).status_code == 429
    assert [join(**{"X-Humanplay-Token": TOKEN}) for _ in range(3)] == [201] * 3
    server.stop()
    one = serve(limits=Limits(joins_per_player="2+0.001/s")).client()
    codes = [one.post("/api/studies/small/join").status_code for _ in range(4)]
    assert codes[-1] == 429  # the first has no cookie yet
    assert 429 not in codes[:2]


def test_requests_of_an_address_have_a_rate_and_probes_their_own(serve):
    server = serve(limits=Limits(requests_per_address="2+0.1/s", token=TOKEN))
    client = server.client()
    answers = [client.get("/nowhere") for _ in range(3)]
    assert [answer.status_code for answer in answers] == [404, 404, 429]
    assert answers[2].headers["retry-after"] == "10"
    assert [client.get("/healthz").status_code for _ in range(3)] == [200, 200, 429]
    assert client.get("/nowhere", headers={"X-Humanplay-Token": TOKEN}).status_code == 404


@pytest.mark.skipif(sys.platform != "linux", reason="one machine has many addresses there alone")
def test_requests_of_an_address_wait_beyond_a_pace_and_nobody_elses_do(serve):
    server = serve(limits=Limits(paced_per_address="5+10/s"))
    greedy, other = (
        server.client(transport=httpx.HTTPTransport(local_address=f"127.0.0.{number}"))
        for number in (2, 3)
    )
    began = time.monotonic()
    with ThreadPoolExecutor(25) as connections:
        asked = connections.map(greedy.get, ["/api/health"] * 25)
        assert other.get("/api/health").status_code == 200
        assert time.monotonic() - began < 1.5
        assert {answer.status_code for answer in asked} == {200}
    assert time.monotonic() - began > 1.9


def test_a_request_that_is_refused_closes_its_connection(serve):
    client = serve(limits=Limits(requests_per_address="2+0.1/s")).client()
    refused = [({"Host": "evil.example"}, 400), ({"Origin": "http://["}, 403)]
    for headers, status in (*refused, ({}, 200), ({}, 200), ({}, 429)):
        answer = client.get("/", headers=headers)
        closes = "close" if status >= 400 else None
        assert (answer.status_code, answer.headers.get("connection")) == (status, closes)


def test_the_addresses_of_one_network_are_one_and_visitors_are_told_apart_behind_a_proxy(serve):
    """A home has a network's 2**64 addresses; IPv4 written as IPv6 is the same."""
    limits = Limits(sessions_per_address="2+0.001/s")

    def codes(server, *addresses):
        clients = [server.client(headers={"X-Forwarded-For": address}) for address in addresses]
        return [client.post("/api/sessions", json={"size": 9}).status_code for client in clients]

    behind = serve(limits=limits, trusted_proxies=("127.0.0.1",))
    assert codes(behind, *(f"203.0.113.{number}" for number in range(4))) == [201] * 4
    assert codes(behind, *(f"2001:db8:1:2:{part}::7" for part in ("1", "2", "ffff"))) == [
        201, 201, 429,
    ]  # fmt: skip
    assert codes(behind, "2001:db8:1:3::7", "198.51.100.9", "::ffff:198.51.100.9", "198.51.100.9") == [
        201, 201, 201, 429,
    ]  # fmt: skip
    behind.stop()
    assert codes(serve(limits=limits), "9.9.9.1", "9.9.9.2", "9.9.9.3") == [201, 201, 429]


def test_a_class_of_a_hundred_people_behind_one_address_plays_unhindered(serve, tmp_path):
    """Each joins, begins a board, opens a socket and moves under default settings."""
    freeze(tmp_path / "playground.db-studies")
    server = serve(limits=Limits())
    with ExitStack() as stack:
        for _ in range(100):
            person = Person(server, client=server.client())
            board = person.client.post("/api/sessions", json={"size": 9}).json()
            socket = stack.enter_context(server.socket(board["session"], person.client))
            frame = socket.receive("frame")
            for step, action in enumerate(("south", "north")):
                socket.act({**frame, "step": step}, action)
        assert not server.protection.refusals


BODY = (
    b"POST /api/sessions HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
    b"Content-Length: 1000\r\n\r\n"
)


def opened(server, receives=None):
    """Open a connection of which the system keeps `receives` bytes for its reader."""
    connection = sockets.socket()
    if receives is not None:
        connection.setsockopt(sockets.SOL_SOCKET, sockets.SO_RCVBUF, receives)
    connection.settimeout(20)
    connection.connect(("127.0.0.1", server.port))
    return connection


def read_all(connection):
    return b"".join(iter(lambda: connection.recv(65536), b"")).decode()


def test_a_body_that_does_not_come_in_time_is_answered_408_and_one_that_is_slow_passes(serve):
    server = serve(limits=Limits(body_s=0.6))
    with opened(server) as connection:
        connection.sendall(BODY + b" ")
        answer = read_all(connection)
    assert answer.startswith("HTTP/1.1 408 ")
    assert "the body of a request must come within 0.6 s" in answer
    assert server.protection.refusals == {"slow_body": 1}
    with opened(server) as connection:
        for part in (BODY, b'{"size": 9}', b" " * 989):
            connection.sendall(part)
            time.sleep(0.1)
        assert connection.recv(65536).startswith(b"HTTP/1.1 201 ")


def test_an_answer_that_nobody_takes_ends_and_one_that_is_taken_slowly_is_whole(serve):
    server = serve(limits=Limits(answer_s=0.5))
    ask = b"GET /viewer/client/ HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    with opened(server) as connection:
        connection.sendall(ask)
        version = re.search(r"location: (\S+)", connection.recv(65536).decode())[1]
    ask = ask.replace(b"client/", b"client/" + version.encode())
    with opened(server, receives=4096) as connection:
        connection.sendall(ask)
        time.sleep(3)
        with pytest.raises(OSError, match="reset"):
            read_all(connection)
    with opened(server, receives=65536) as connection:
        connection.sendall(ask.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
        read = b""
        while part := connection.recv(262144):
            read += part
            time.sleep(0.01)
    head, _, body = read.partition(b"\r\n\r\n")
    assert len(body) == int(re.search(rb"content-length: (\d+)", head)[1]) > 500_000
