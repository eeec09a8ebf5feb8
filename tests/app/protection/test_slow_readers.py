"""A connection whose client does not take what is sent to it is closed; one that takes it slowly gets everything."""

import socket as sockets
import time
from contextlib import contextmanager, suppress

from app.settings import Limits
from tests.app.protection.test_floods import text
from tests.support.servers import eventually

FAST = "100000+100000/s"
"""A rate that is no limit to a test."""

ASK = b"GET /static/play/play.css HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
TIMES = 500
"""Requests one after the other whose answers are more than the buffers of the system hold."""


@contextmanager
def opened(server):
    """Open a connection of which the system keeps little for its reader."""
    with sockets.socket() as connection:
        connection.setsockopt(sockets.SOL_SOCKET, sockets.SO_RCVBUF, 4096)
        connection.settimeout(2)
        connection.connect(("127.0.0.1", server.port))
        yield connection


def test_a_connection_whose_answers_nobody_reads_is_closed(serve):
    server = serve(limits=Limits(answer_s=0.3, files=FAST))
    with opened(server) as connection:
        connection.sendall(ASK * TIMES)
        eventually(lambda: server.services.protection.refusals == {"slow_reader": 1}, 20)
        eventually(lambda: server.services.protection.connections.slots.open == 0)


def test_a_websocket_whose_messages_nobody_reads_is_closed(serve):
    server = serve(
        limits=Limits(
            answer_s=0.3, acts=FAST, refused_acts=FAST, messages=FAST, messages_per_address=FAST
        )
    )
    begun = server.client().post("/api/sessions", json={"size": 42}).json()
    ask = f"GET /ws/sessions/{begun['session']} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    ask += "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    with opened(server) as connection:
        connection.sendall(ask.encode())
        assert connection.recv(1000).startswith(b"HTTP/1.1 101 ")
        refusals = server.services.protection.refusals
        with suppress(OSError):  # the server reads no more either
            for _ in range(100):
                connection.sendall(
                    text({"kind": "act", "episode": "x", "step": 0, "action": "south"}) * 100
                )
        eventually(lambda: refusals["slow_reader"] == 1, 20)


def test_a_client_that_takes_its_answers_slowly_gets_all_of_them(serve):
    server = serve(limits=Limits(answer_s=0.3, files=FAST))
    size = len(server.client().get("/static/play/play.css").content)
    with sockets.create_connection(("127.0.0.1", server.port), timeout=5) as connection:
        connection.sendall(ASK * 2 * TIMES)
        read, began = 0, time.monotonic()
        while read < 2 * TIMES * size:
            data = connection.recv(262144)
            assert data, f"closed after {read} bytes"
            read += len(data)
            time.sleep(0.02)
    assert time.monotonic() - began > 0.6
    assert not server.services.protection.refusals
