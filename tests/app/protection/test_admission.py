"""Caps on connections and sockets, and rates of joins, boards and episodes: by address and by cookie."""

import json
import socket as sockets
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus

from app.settings import Limits
from tests.support.servers import eventually
from tests.support.study import Person, freeze

TOKEN = "a-token-of-the-operator"


def descriptors():
    """How many file descriptors this process has open, which is the server's too."""
    return len(list(Path("/proc/self/fd").iterdir()))


def opened(server):
    return sockets.create_connection(("127.0.0.1", server.port), timeout=20)


def ask(connection, accept="*/*"):
    """Ask for the page over an open connection and return the whole answer."""
    connection.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept: {accept}\r\nConnection: close\r\n\r\n".encode())
    return b"".join(iter(lambda: connection.recv(65536), b"")).decode()


def test_connections_beyond_the_cap_get_503_and_a_time_to_return_and_everything_is_given_back(serve):
    server = serve(limits=Limits(connections_per_address=20))
    slots, before = server.services.protection.connections.slots, descriptors()
    with ExitStack() as stack:
        held = [stack.enter_context(opened(server)) for _ in range(20)]
        eventually(lambda: slots.open == 20)
        with opened(server) as one_too_many:
            answer = ask(one_too_many, "text/html")
        assert answer.startswith("HTTP/1.1 503 ")
        assert "retry-after: 30" in answer
        assert "The playground is full" in answer
        with opened(server) as script:
            assert json.loads(ask(script).split("\r\n\r\n")[1])["detail"].startswith("The playground is full")
        assert ask(held[0]).startswith("HTTP/1.1 200 ")
    eventually(lambda: slots.open == 0)
    eventually(lambda: descriptors() <= before)
    assert server.client().get("/").status_code == 200
    assert server.services.protection.refusals["connections"] == 2


def test_the_cap_on_connections_fits_the_files_that_the_server_may_open():
    """In a process of its own: a limit that was lowered cannot be raised again."""
    code = "import resource as r; r.setrlimit(r.RLIMIT_NOFILE, (300, 400)); from app.protection.connections import make_room"
    code += "; print(make_room(100), r.getrlimit(r.RLIMIT_NOFILE)[0], make_room(1000), r.getrlimit(r.RLIMIT_NOFILE)[0])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split() == [
        "100", "356", "144", "400",
    ]  # fmt: skip


def test_the_caps_of_a_server_follow_the_files_that_it_may_open():
    """As many connections as fit, and websockets in proportion, so that pages can be loaded when all of these are taken."""
    code = "import resource as r; r.setrlimit(r.RLIMIT_NOFILE, (300, 400)); from app.settings import Limits"
    code += "; from app.protection.service import Protection; protection = Protection(Limits())"
    code += (
        "; print(*(sum(slots.take(None) for _ in range(5000)) for slots in (protection.connections.slots, protection.sockets)))"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.split() == ["144", "72"]


def test_connections_in_total_have_a_cap_and_one_address_cannot_open_them_too_fast(serve):
    total = serve(limits=Limits(connections=3))
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(opened(total))
        eventually(lambda: total.services.protection.connections.slots.open == 3)
        with opened(total) as one_too_many:
            assert " 503 " in ask(one_too_many)


def test_connections_of_one_address_come_no_faster_than_their_rate(serve):
    server = serve(limits=Limits(opened="5+0.01/s"))
    codes = []
    for _ in range(7):
        with opened(server) as connection:
            codes.append(ask(connection)[9:12])
    assert codes == ["200"] * 5 + ["503"] * 2


def test_a_connection_without_a_request_is_closed(serve, monkeypatch):
    monkeypatch.setattr("app.protection.protocols.FIRST_REQUEST_S", 0.1)
    server = serve()
    with opened(server) as silent:
        assert silent.recv(1) == b""
    assert server.services.protection.refusals["no_request"] == 1


def test_sockets_beyond_the_cap_are_refused_and_their_places_are_given_back(serve):
    server = serve(limits=Limits(sockets_per_address=3))
    client = server.client()
    begun = client.post("/api/sessions", json={"size": 9}).json()
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(server.socket(begun["session"], client)).receive("frame")
        with pytest.raises(InvalidStatus) as refused, server.socket(begun["session"], client):
            pass
        assert refused.value.response.status_code == 503
        assert refused.value.response.headers["Retry-After"] == "30"
        assert b"too many sockets are open" in refused.value.response.body
    eventually(lambda: server.services.protection.sockets.open == 0)
    with server.socket(begun["session"], client) as socket:
        socket.receive("frame")


def test_boards_and_episodes_have_a_rate_for_each_player_and_for_each_address(serve):
    server = serve(limits=Limits(sessions_per_player="2/minute", sessions_per_address="5/minute", episodes_per_player="1/hour"))
    first, second = server.client(), server.client()

    def begin(client):
        return client.post("/api/sessions", json={"size": 9})

    session = begin(first).json()["session"]  # without a cookie yet
    assert [begin(first).status_code for _ in range(3)] == [201, 201, 429]
    refused = begin(first)
    assert 1 <= int(refused.headers["retry-after"]) <= 61
    assert "too many new boards from this browser (2 per 1 minute at most): try again in" in refused.json()["detail"]
    codes = [begin(second).status_code for _ in range(3)]
    assert codes == [201, 201, 429]
    assert "from this network" in begin(second).json()["detail"]
    codes = [first.post(f"/api/sessions/{session}/episodes").status_code for _ in range(2)]
    assert codes == [201, 429]
    assert server.services.protection.refusals == {"rate_session": 4, "rate_episode": 1}


def test_joins_have_a_rate_and_whoever_has_the_token_has_none(serve, tmp_path):
    freeze(tmp_path / "studies")
    server = serve(limits=Limits(joins_per_address="3/hour", token=TOKEN))
    codes = [server.client().post("/api/studies/small/join").status_code for _ in range(4)]
    assert codes == [201, 201, 201, 429]
    assert server.client(headers={"X-Mars-Token": TOKEN + "x"}).post("/api/studies/small/join").status_code == 429
    codes = [server.client(headers={"X-Mars-Token": TOKEN}).post("/api/studies/small/join").status_code for _ in range(3)]
    assert codes == [201] * 3


def test_addresses_are_distinguished_behind_a_named_proxy_alone(serve):
    def codes(server):
        found = []
        for number in range(4):
            client = server.client(headers={"X-Forwarded-For": f"203.0.113.{number}"})
            found.append(client.post("/api/sessions", json={"size": 9}).status_code)
        return found

    limits = Limits(sessions_per_address="2/hour", connections_per_address=1)
    behind = serve(limits=limits, trusted_proxies=("127.0.0.1",))
    assert codes(behind) == [201] * 4
    behind.stop()
    assert codes(serve(limits=Limits(sessions_per_address="2/hour"))) == [201, 201, 429, 429]


def test_a_class_of_a_hundred_people_behind_one_address_plays_unhindered(server, tmp_path):
    """Each joins, loads what the page asks for and begins a board; the default settings refuse nothing."""
    freeze(tmp_path / "studies")
    with ExitStack() as stack:
        for _ in range(100):
            person = Person(server, client=server.client())
            board = person.client.post("/api/sessions", json={"size": 9}).json()
            socket = stack.enter_context(server.socket(board["session"], person.client))
            frame = socket.receive("frame")
            for step, action in enumerate(("south", "north")):
                socket.act({**frame, "step": step}, action)
        assert not server.services.protection.refusals
