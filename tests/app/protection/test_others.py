"""While one client floods the server, the moves of the others take at most twice as long: the 99th percentile of one run."""

import numpy as np
import pytest

from tests.support.others import measure, misbehaving

pytestmark = pytest.mark.long

ROUNDS, SECONDS = 4, 3
"""Quiet times and floods take turns, since the machine has other work that comes and goes."""

FLOOD = """
import socket, sys, time
from base64 import b64encode
port, path, message, opcode = int(sys.argv[1]), sys.argv[2], sys.argv[3].encode(), int(sys.argv[4])
length = bytes([128 | len(message)]) if len(message) < 126 else bytes([254, 0, len(message)])
data = (bytes([128 | opcode]) + length + bytes(4) + message) * 500
ask = f"GET {path} HTTP/1.1\\r\\nHost: 127.0.0.1:{port}\\r\\nUpgrade: websocket\\r\\nConnection: Upgrade\\r\\n"
ask += "Sec-WebSocket-Key: " + b64encode(bytes(16)).decode() + "\\r\\nSec-WebSocket-Version: 13\\r\\n\\r\\n"
while True:
    try:
        with socket.create_connection(("127.0.0.1", port)) as each:
            each.sendall(ask.encode())
            each.recv(4096)
            each.settimeout(5)
            while message:
                each.sendall(data)
    except OSError:
        pass
"""
"""Floods over one socket, and opens the next when that one is closed; without a message it opens and leaves at once."""

FLOODS = {
    "pings": (b"", 9),
    "history": (b'{"kind":"history"}', 1),
    "bad": (b"nonsense", 1),
    "refused": (b'{"kind":"act","episode":"x","step":0,"action":"north"}', 1),
    "events": (b'{"kind":"events","episode":"x","events":[{"kind":"blur","client_ms":1}]}', 1),
    "opening": (b"", 1),
}


@pytest.mark.parametrize("kind", FLOODS)
def test_others_wait_at_most_twice_as_long_during_a_flood(spawn, kind):
    server = spawn()
    with server.client() as client:
        begun = client.post("/api/sessions", json={"size": 21}).json()
    measure(server, 2)  # the first moves of a process take longer
    message, opcode = FLOODS[kind]
    script = FLOOD.replace("while message:", "while True:") if opcode == 9 else FLOOD
    path, trips = f"/ws/sessions/{begun['session']}", ([], [])
    for _ in range(ROUNDS):
        with misbehaving("while True: pass") as computing:  # so that the cores are as busy as during the flood
            trips[0].extend(measure(server, SECONDS))
            computing.kill()
        with misbehaving(script, server.port, path, message.decode(), opcode) as flooding:
            trips[1].extend(measure(server, SECONDS))
            flooding.kill()
    quiet, flooded = ([float(np.percentile(each, p)) for p in (50, 99)] for each in trips)
    print(
        f"\n{kind}: median and p99 of the others {quiet[0]:.1f}, {quiet[1]:.1f} ms quiet; {flooded[0]:.1f}, {flooded[1]:.1f} ms"
    )
    assert flooded[1] <= 2 * quiet[1]
