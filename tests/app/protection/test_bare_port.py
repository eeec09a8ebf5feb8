"""What the port promises without a proxy, each against a real server process.

Whoever misbehaves may slow others. But nothing acknowledged is lost, an unanswered move is whole or
absent, memory stays bounded, what is malformed is answered with 4xx and without a traceback, and
SIGTERM under all of that ends with a closed database.
"""

import json
import random
import signal
import socket
import time
from contextlib import suppress
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed

from humanplay.study.verification import verify_database
from humanplay.web.settings import Limits
from tests.app.protection.test_limits import masked, why_closed
from tests.support.others import misbehaving
from tests.support.recorded import ask
from tests.support.servers import eventually

MOST_GROWTH_MB = 100
"""How much more memory a server may come to while it is flooded; it has some 400 MB at the start."""

MISBEHAVING = """
import socket, sys, threading, time
port, path, kind = int(sys.argv[1]), sys.argv[2], sys.argv[3]
ask = f"GET {path} HTTP/1.1\\r\\nHost: 127.0.0.1\\r\\nUpgrade: websocket\\r\\nConnection: Upgrade\\r\\n"
ask += "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\\r\\nSec-WebSocket-Version: 13\\r\\n\\r\\n"
page = b"GET / HTTP/1.1\\r\\nHost: 127.0.0.1\\r\\n\\r\\n"
frames = {
    "pings": (bytes([137, 253]) + bytes(4 + 125)) * 500,
    "messages": (bytes([129, 128]) + bytes(4)) * 5000,
    "requests": page * 50,
}
def connect(sends):
    each = socket.create_connection(("127.0.0.1", port), source_address=("127.0.0.2", 0))
    each.sendall(sends)
    return each
def flood(reads):
    while True:
        try:
            with connect(b"" if kind == "requests" else ask.encode()) as each:
                while True:
                    each.sendall(frames[kind])
                    if reads:
                        each.recv(2**18)
        except OSError:
            pass
def drip(held):
    while True:
        time.sleep(0.05)
        for each in held:
            each.sendall(b"a")
if kind == "silent":
    held = [connect(b"") for _ in range(500)]
elif kind == "head":
    threading.Thread(target=drip, args=[[connect(page[:-2] + b"a: ") for _ in range(100)]]).start()
else:
    for number in range(6):
        threading.Thread(target=flood, args=[number % 2]).start()
print("begun", flush=True)
time.sleep(600)
"""
"""Floods, half of the connections reading nothing; sends heads for ever; or is silent."""


def megabytes(server):
    status = Path(f"/proc/{server.process.pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


LONG = [pytest.param(kind, marks=pytest.mark.long) for kind in ("pings", "head")]


@pytest.mark.parametrize("kind", ["messages", "requests", "silent", *LONG])
def test_others_play_on_and_a_server_that_is_stopped_meanwhile_has_every_move(
    spawn, tmp_path, kind
):
    server = spawn(limits=Limits())
    client = server.client()
    begun = client.post("/api/sessions", json={"size": 42, "seed": 5}).json()
    other = client.post("/api/sessions", json={"size": 9}).json()["session"]
    before_mb, most_mb = megabytes(server), 0.0
    with (
        server.socket(begun["session"], client) as board,
        misbehaving(MISBEHAVING, server.port, f"/ws/sessions/{other}", kind),
    ):
        frame, until = board.receive("frame"), time.monotonic() + 4
        while time.monotonic() < until or frame["step"] < 20:
            board.act(frame, ("east", "west")[frame["step"] % 2])
            frame = board.frame_after(frame["step"])
            most_mb = max(most_mb, megabytes(server))
        board.act(frame, "east")  # perhaps it is answered, perhaps not
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(15) == 0
        try:
            while True:
                message = board.receive()
                frame = message if message["kind"] == "frame" else frame
        except ConnectionClosed:
            pass
    log = server.process.stdout.read()
    server.close()
    assert "Traceback" not in log
    assert most_mb < before_mb + MOST_GROWTH_MB
    assert not (tmp_path / "playground.db-wal").exists(), "SQLite deletes it when all is closed"
    assert verify_database(tmp_path / "playground.db").findings == ()
    count = "SELECT count(*) FROM steps WHERE episode_id = ?"
    ((steps,),) = ask(tmp_path / "playground.db", count, frame["episode"])
    assert steps in (frame["step"], frame["step"] + 1)


@pytest.mark.alone
def test_a_quarter_of_a_megabyte_of_messages_delays_others_once_and_closes_its_socket(spawn):
    server = spawn(limits=Limits())
    client = server.client()
    begun = client.post("/api/sessions", json={"size": 42, "seed": 5}).json()
    other = client.post("/api/sessions", json={"size": 9}).json()["session"]
    with server.socket(begun["session"], client) as board, server.socket(other) as flooding:
        frame, waits_s, quiet_s = board.receive("frame"), [], []
        smallest = masked(1, b"")
        sending, left = flooding.connection.socket, b""
        for spent_s in (quiet_s, waits_s):
            until = time.monotonic() + 2
            while time.monotonic() < until:
                began = time.monotonic()
                board.act(frame, ("east", "west")[frame["step"] % 2])
                frame = board.frame_after(frame["step"])
                spent_s.append(time.monotonic() - began)
                try:
                    left = left[sending.send(left, socket.MSG_DONTWAIT) :]
                except BlockingIOError:
                    pass
                except OSError:  # it is closed
                    left = b""
            left = smallest * (2**18 // len(smallest))
        assert why_closed(flooding.connection)[0] == 1008
    server.kill()
    print(f"\nworst wait {1000 * max(quiet_s):.0f} ms quiet, {1000 * max(waits_s):.0f} ms")
    assert max(waits_s) <= 0.5 + max(quiet_s)


def asked(server, *parts):
    """Send bytes over a connection and return all that comes until it is closed."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as connection:
        try:
            for part in parts:
                connection.sendall(part)
            return b"".join(iter(lambda: connection.recv(65536), b""))
        except ConnectionResetError:
            return b""


HANDSHAKE = (
    b"GET /ws/sessions/x HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
)
MALFORMED = {
    "no request": b"nonsense\r\n\r\n",
    "control characters": b"GET /\x00\x01 HTTP/1.1\r\nHost: a\r\n\r\n",
    "a header without a colon": b"GET / HTTP/1.1\r\nHost 127.0.0.1\r\n\r\n",
    "a long head": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\na: " + b"a" * 20_000,
    "two lengths": b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n",
    "a chunk without a size": b"POST /api/sessions HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Connection: close\r\nContent-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\nx\r\n",
    "a length and chunks": b"POST /api/sessions HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
    b"Content-Type: application/json\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "a handshake with a body": HANDSHAKE + b"Content-Length: 5\r\n\r\nhello",
    "a handshake in chunks": HANDSHAKE + b"Transfer-Encoding: chunked\r\n\r\n",
    "a handshake with a long line": HANDSHAKE + b"X-Long: " + b"a" * 9000 + b"\r\n\r\n",
    "a handshake with many lines": HANDSHAKE + b"a: b\r\n" * 300 + b"\r\n",
    "a handshake without a key": HANDSHAKE.replace(b"Sec-WebSocket-Key", b"X-Key") + b"\r\n",
    "a handshake whose key is no text": HANDSHAKE.replace(b"AAAA=", b"\xf5A==") + b"\r\n",
    "a handshake of another version": HANDSHAKE.replace(b"13", b"7") + b"\r\n",
    "a handshake for another host": HANDSHAKE.replace(b"127.0.0.1", b"evil.example") + b"\r\n",
    "a handshake of another site": HANDSHAKE + b"Origin: https://evil.example\r\n\r\n",
}
FRAMES = (
    *(masked(9, bytes(size)) for size in (0, 125)),  # pings
    *(masked(1, text) for text in (b"nonsense", b"[" * 30_000, b'{"a":' * 9_000, b"\xff")),
    *(masked(8, reason) for reason in (b"", b"\x03", b"\x03\xe8bye")),
    bytes([1, 128 | 3]) + bytes(4) + b"abc",  # the first part of a message
    b"\xff" * 50,
)


def test_what_is_malformed_is_answered_with_4xx_closed_and_not_logged(spawn):
    server = spawn(limits=Limits())
    files = Path(f"/proc/{server.process.pid}/fd")
    before = len(list(files.iterdir()))
    for name, data in MALFORMED.items():
        answer = asked(server, data)
        assert answer[:10] == b"HTTP/1.1 4", (name, answer[:200])
    draw = random.Random(28)
    for _ in range(300):
        data = bytearray(draw.choice(list(MALFORMED.values()))[:3000])
        for _ in range(draw.randrange(1, 8)):
            data[draw.randrange(len(data))] = draw.randrange(256)
        with socket.create_connection(("127.0.0.1", server.port), timeout=10) as connection:
            connection.sendall(bytes(data))
            connection.shutdown(socket.SHUT_WR)
    client = server.client()
    begun = client.post("/api/sessions", json={"size": 9}).json()
    ways = ("/ws/sessions/x", f"/ws/sessions/{begun['session']}", "/ws/watch/x", "/viewer/x")
    for number in range(300):  # some of it comes before the handshake is answered
        parts = [*draw.choices(FRAMES, k=draw.randrange(1, 20)), draw.randbytes(30)]
        first = HANDSHAKE.replace(b"/ws/sessions/x", ways[number % 4].encode()) + b"\r\n"
        opened = socket.create_connection(("127.0.0.1", server.port), timeout=10)
        with opened as connection, suppress(ConnectionError):
            for part in (first, *parts):
                connection.sendall(part)
    for junk in (b"\xff" * 100, masked(1, b"\xff"), masked(9, b"") * 3 + b"\x83\xff", b"\x0f" * 99):
        with server.socket(begun["session"], client) as board:
            board.receive("frame")
            board.connection.socket.sendall(junk)
            assert why_closed(board.connection)[0] in (1002, 1007)
    eventually(lambda: len(list(files.iterdir())) <= before + 3)
    server.process.send_signal(signal.SIGTERM)
    assert server.process.wait(15) == 0
    log = server.process.stdout.read()
    server.close()
    assert log.strip() == "", log[:2000]


def test_a_websocket_that_is_refused_is_told_why_and_closed(serve):
    server = serve(limits=Limits(sockets=1))
    session = server.client().post("/api/sessions", json={"size": 9}).json()["session"]
    with server.socket(session) as board:
        board.receive("frame")
        head, _, body = asked(server, HANDSHAKE + b"\r\n").partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 503 ")
    assert b"retry-after: 30" in head.lower()
    assert json.loads(body)["detail"].startswith("too many sockets are open")


def test_pings_beyond_their_rate_are_not_answered(serve):
    """Counted and not timed: others wait for the answers, on whatever machine."""
    server = serve(limits=Limits())
    session = server.client().post("/api/sessions", json={"size": 9}).json()["session"]
    ping, pong = masked(9, b"of mine"), b"\x8a\x07of mine"
    handshake = HANDSHAKE.replace(b"sessions/x", f"sessions/{session}".encode()) + b"\r\n"
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
        connection.sendall(handshake)
        answers = connection.recv(2**16)
        connection.sendall(ping * 100)
        while answers.count(pong) < 100 and (answer := connection.recv(2**16)):
            answers += answer
        assert answers.count(pong) == 100, answers
        began = time.monotonic()
        with suppress(ConnectionError):
            connection.sendall(ping * 20_000)
        with suppress(ConnectionError):
            answers += b"".join(iter(lambda: connection.recv(2**16), b""))
        most = 100 + 10 * (time.monotonic() - began) + 10
    assert answers.count(pong) <= most
