"""A request that comes a byte at a time is answered 408 and gives its connection back; what is slow on a phone passes."""

import json
import select
import socket as sockets
import time

import pytest

from app.settings import Limits
from tests.app.protection.test_floods import begin, text
from tests.support.servers import eventually

START = b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n"
BODY = b"POST /api/sessions HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 1000\r\n\r\n"


def opened(server):
    return sockets.create_connection(("127.0.0.1", server.port), timeout=5)


def drip(connection, data, pause_s=0.02):
    """Send byte after byte until an answer comes; return it whole."""
    for each in data:
        connection.sendall(bytes([each]))
        if select.select([connection], [], [], pause_s)[0]:
            break
    return b"".join(iter(lambda: connection.recv(65536), b"")).decode()


def read_until(connection, end):
    """Read what comes over a connection that stays open, until some bytes have come; return it whole."""
    read = b""
    while end not in read:
        data = connection.recv(65536)
        assert data, f"closed after {read!r}"
        read += data
    return read


def send_in_pieces(connection, data, pieces=4, seconds=0.3):
    size = -(-len(data) // pieces)
    for start in range(0, len(data), size):
        connection.sendall(data[start : start + size])
        time.sleep(seconds / pieces)


@pytest.mark.parametrize("before", [b"", START + b"\r\n"])
def test_headers_that_never_end_are_answered_408_also_after_another_request(serve, before):
    server = serve(limits=Limits(headers_s=0.4))
    with opened(server) as connection:
        if before:
            connection.sendall(before)
            assert read_until(connection, b"}").startswith(b"HTTP/1.1 200 ")
        answer = drip(connection, START + b"X-Slow: " + b"a" * 60)
    assert answer.startswith("HTTP/1.1 408 ")
    assert (
        json.loads(answer.split("\r\n\r\n")[1])["detail"]
        == "the headers of a request must come within 0.4 s"
    )
    assert server.services.protection.refusals == {"slow_headers": 1}
    eventually(lambda: server.services.protection.connections.slots.open == 0)


def test_a_body_that_never_ends_is_answered_408(serve):
    server = serve(limits=Limits(body_s=0.4))
    with opened(server) as connection:
        connection.sendall(BODY)
        answer = drip(connection, b" " * 100)
    assert answer.startswith("HTTP/1.1 408 ")
    assert "the body of a request must come within 0.4 s" in answer
    assert server.services.protection.refusals == {"slow_body": 1}
    eventually(lambda: server.services.protection.connections.slots.open == 0)


def test_a_body_that_nobody_waits_for_any_more_ends_too(serve):
    """The answer has been sent, and the client goes on with the body: no second answer, and the connection is closed."""
    server = serve(limits=Limits(body_s=0.4))
    with opened(server) as connection:
        connection.sendall(BODY.replace(b"/api/sessions", b"/nowhere"))
        assert read_until(connection, b"}").startswith(b"HTTP/1.1 404 ")
        assert drip(connection, b" " * 100) == ""
    assert server.services.protection.refusals == {"slow_body": 1}


def test_a_slow_body_and_a_slow_handshake_pass_and_a_socket_has_no_time_limit(serve):
    server = serve(limits=Limits(headers_s=1, body_s=1))
    _, begun = begin(server)
    with opened(server) as connection:
        connection.sendall(BODY)
        send_in_pieces(connection, b'{"size": 9}'.ljust(1000))
        assert read_until(connection, b"}").startswith(b"HTTP/1.1 201 ")
    ask = f"GET /ws/sessions/{begun['session']} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    ask += "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    with opened(server) as connection:
        send_in_pieces(connection, ask.encode())
        assert connection.recv(65536).startswith(b"HTTP/1.1 101 ")
        time.sleep(1.2)
        connection.sendall(
            text(
                {"kind": "act", "episode": begun["frame"]["episode"], "step": 0, "action": "south"}
            )
        )
        read_until(connection, b'"step":1')
    assert not server.services.protection.refusals


def test_the_time_of_a_request_begins_with_its_turn(serve):
    server = serve(limits=Limits(served="1+2/s", headers_s=0.4))
    asked = [opened(server) for _ in range(3)]
    for each in asked:
        each.sendall(START + b"Connection: close\r\n\r\n")
    for each in asked:
        with each:
            assert each.recv(65536).startswith(b"HTTP/1.1 200 ")


@pytest.mark.parametrize(
    "wrong",
    ["Content-Length: 5\r\n", "Transfer-Encoding: chunked\r\n", f"X-Long: {'a' * 9000}\r\n"],
)
def test_a_handshake_that_is_not_taken_is_answered_and_keeps_no_connection(serve, wrong):
    """Neither library answered it, and no time limit held: such a connection stayed for ever, and counted as no socket."""
    server = serve(limits=Limits(headers_s=0.4, body_s=0.4))
    ask = f"GET /ws/sessions/x HTTP/1.1\r\nHost: 127.0.0.1\r\n{wrong}Upgrade: websocket\r\nConnection: Upgrade\r\n"
    ask += "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    with opened(server) as connection:
        connection.sendall(ask.encode())
        answer = b"".join(iter(lambda: connection.recv(65536), b"")).decode()
    assert answer.startswith("HTTP/1.1 400 ")
    assert "as browsers send it" in json.loads(answer.split("\r\n\r\n")[1])["detail"]
    assert server.services.protection.refusals == {"handshake": 1}
    eventually(lambda: server.services.protection.connections.slots.open == 0)
