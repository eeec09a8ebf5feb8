"""While one client floods the server, the moves of the others take at most twice as long: the 99th percentile of one run."""

import numpy as np
import pytest

from tests.support.others import measure, misbehaving

pytestmark = pytest.mark.long

ROUNDS = 4
"""Quiet times and floods take turns, since the machine has other work that comes and goes."""

FLOOD = """
import socket, sys, threading, time
from base64 import b64encode
port, path, message, opcode = int(sys.argv[1]), sys.argv[2], sys.argv[3].encode(), int(sys.argv[4])
length = bytes([128 | len(message)]) if len(message) < 126 else bytes([254, 0, len(message)])
data = (bytes([128 | opcode]) + length + bytes(4) + message) * 500
ask = f"GET {path} HTTP/1.1\\r\\nHost: 127.0.0.1:{port}\\r\\nUpgrade: websocket\\r\\nConnection: Upgrade\\r\\n"
ask += "Sec-WebSocket-Key: " + b64encode(bytes(16)).decode() + "\\r\\nSec-WebSocket-Version: 13\\r\\n\\r\\n"
def flood():
    while True:
        try:
            with socket.create_connection(("127.0.0.1", port), source_address=("127.0.0.2", 0)) as each:
                each.sendall(ask.encode())
                each.recv(4096)
                each.settimeout(5)
                while message:
                    each.sendall(data)
        except OSError:
            pass
time.sleep(float(sys.argv[6]))
for _ in range(int(sys.argv[5])):
    threading.Thread(target=flood).start()
"""
"""Floods over some sockets of one address, and opens the next when one is closed; without a message it opens and leaves."""

GETS = """
import sys, threading, time
from http.client import HTTPConnection, HTTPException
def flood():
    while True:
        try:
            each = HTTPConnection("127.0.0.1", int(sys.argv[1]), timeout=5, source_address=("127.0.0.2", 0))
            while True:
                each.request("GET", "/")
                each.getresponse().read()
        except (OSError, HTTPException):
            each.close()
time.sleep(float(sys.argv[6]))
for _ in range(int(sys.argv[5])):
    threading.Thread(target=flood).start()
"""
"""Asks for the page over some connections, each time as soon as the answer is there; the arguments are those of FLOOD."""

FLOODS = {
    "pings": (b"", 9),
    "history": (b'{"kind":"history"}', 1),
    "bad": (b"nonsense", 1),
    "refused": (b'{"kind":"act","episode":"x","step":0,"action":"north"}', 1),
    "events": (b'{"kind":"events","episode":"x","events":[{"kind":"blur","client_ms":1}]}', 1),
    "opening": (b"", 1),
    "requests": (b"", 0),
}


@pytest.mark.parametrize(
    ("begins_s", "seconds"), [(0, 3), (0.6, 4)], ids=["with the first moves", "while people play"]
)
@pytest.mark.parametrize("sockets", [1, 30])
@pytest.mark.parametrize("kind", FLOODS)
def test_others_wait_at_most_twice_as_long_during_a_flood(
    spawn, tmp_path, kind, sockets, begins_s, seconds
):
    """In the quiet times the same client floods another server, so that the machine has as much to do."""
    server, other = spawn(), spawn(database=str(tmp_path / "other.db"))
    paths = {}
    for each in (server, other):
        with each.client() as client:
            paths[each] = (
                f"/ws/sessions/{client.post('/api/sessions', json={'size': 21}).json()['session']}"
            )
    measure(server, 2)  # the first moves of a process take longer
    message, opcode = FLOODS[kind]
    script = {0: GETS, 9: FLOOD.replace("while message:", "while True:")}.get(opcode, FLOOD)
    trips = {server: [], other: []}
    for _ in range(ROUNDS):
        for flooded in (other, server):
            with misbehaving(
                script, flooded.port, paths[flooded], message.decode(), opcode, sockets, begins_s
            ):
                trips[flooded].extend(measure(server, seconds))
    (quiet, quiet_p99), (flood, flood_p99) = (
        [float(np.percentile(each, p)) for p in (50, 99)] for each in reversed(trips.values())
    )
    print(
        f"\n{kind}, {sockets} at once: median and p99 of the others {quiet:.1f}, {quiet_p99:.1f} ms quiet;",
        end=" ",
    )
    print(f"{flood:.1f}, {flood_p99:.1f} ms; ratio {flood_p99 / quiet_p99:.1f}")
    assert flood_p99 <= 2 * quiet_p99
