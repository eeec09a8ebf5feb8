"""Work that tries what a confined process is asked to (`humanplay.tasks.processes`), and says how it ended."""

import os
import signal
import socket
from pathlib import Path


def prepare(argument):
    if argument == "cannot":
        raise ValueError("there is nothing to prepare")


def work(argument, request):
    yield from range(request.get("steps", 0))
    said = argument
    while True:
        what, *rest = yield said
        try:
            said = str(TRIED[what](*rest))
        except OSError as error:
            said = type(error).__name__ + ": " + str(error.strerror)


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
