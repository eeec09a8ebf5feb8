"""Work that tries what it is asked to in a confined process, and how it ended.

See `humanplay.tasks.processes`.
"""

import os
import signal
import socket
from pathlib import Path


def prepare(argument):
    if argument == "cannot":
        raise ValueError("there is nothing to prepare")


def work(argument, request):
    yield from range(request.get("steps", 0))
    answer = argument
    while True:
        name, *rest = yield answer
        try:
            answer = str(TRIED[name](*rest))
        except OSError as error:
            answer = type(error).__name__ + ": " + str(error.strerror)


def connect(port):
    with socket.create_connection(("127.0.0.1", port), timeout=2):
        return "connected"


def send(port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b"x", ("127.0.0.1", port))
    return "sent"


TRIED = {
    "read": lambda path: Path(path).read_text(),
    "write": lambda path: Path(path).write_text("x"),
    "connect": connect,
    "send": send,
    "end": lambda pid: os.kill(pid, signal.SIGTERM),
    "user": os.getuid,
}
