"""A pilot's server as the program that started it sees it."""

from __future__ import annotations

import atexit
import json
import os
import socket
import subprocess
import sys
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread
from typing import TypedDict

from humanplay.cli.pilot.errors import PilotError

START_S = 300.0
"""Seconds in which a page must be open."""
END_S = 20.0
"""Seconds in which a server must have written all that it knows."""


class Request(TypedDict):
    """What a server is to serve.

    settings  of the server
    held      functions that the program holds
    people    who are invited
    board     descriptor of what asks the program to step its environment; None if the server's processes step it
    """

    settings: dict[str, object]
    held: dict[str, str]
    people: int
    board: int | None


class Answer(TypedDict, total=False):
    """The address of the page with the invitations of people, or why there is none."""

    address: str
    invitations: list[str]
    error: str


def start_process(connection: int, board: int) -> subprocess.Popen[str]:
    """Start a server, and return its process, which inherits two descriptors.

    Args:
        connection: Over which it is sent its request.
        board: Over which it asks the program to step an environment.
    """
    paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
    return subprocess.Popen(
        [sys.executable, "-m", "humanplay.cli.pilot.server", str(connection)],
        env=os.environ | {"PYTHONPATH": paths},
        pass_fds=[connection, board],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,  # Ctrl-C is this program's
    )


class RunningServer:
    """A server in a process of its own. What it logs is printed here.

    boards  what it asks a program that steps the environment itself
    """

    boards: Connection

    def __init__(self, request: Request, steps: bool = False) -> None:
        """Start it; `steps` says whether this program steps the environment itself."""
        mine, theirs = socket.socketpair()
        asked, asks = socket.socketpair()
        with mine, theirs, asked, asks:
            self._process = start_process(theirs.fileno(), asks.fileno())
            self._connection = Connection(mine.detach())
            self.boards = Connection(asked.detach())
            if steps:
                request["board"] = asks.fileno()
        self._printer = Thread(target=self._print_log, daemon=True)
        self._printer.start()
        atexit.register(self.close)
        answer = self._opened(request)
        if "error" in answer:
            self.close()
            raise PilotError(answer["error"])
        self.address, self.invitations = answer["address"], answer["invitations"]

    def _opened(self, request: Request) -> Answer:
        try:
            self._connection.send_bytes(json.dumps(request).encode())
            if self._connection.poll(START_S):
                answer: Answer = json.loads(self._connection.recv_bytes())
                return answer
        except (EOFError, OSError):
            return {"error": "the server ended before its page was open; what it printed says why"}
        except KeyboardInterrupt:
            self.close()
            raise
        return {"error": f"the page was not open within {START_S:g} s"}

    def _print_log(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            print(line, end="", flush=True)

    def wait(self) -> None:
        """Wait until the server ends."""
        self._process.wait()

    @property
    def is_open(self) -> bool:
        """Whether people can play."""
        return self._process.poll() is None

    def close(self) -> None:
        """End the server once all that was played is written."""
        atexit.unregister(self.close)
        self.boards.close()  # first: no move of an episode is asked for that goes on
        self._connection.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            with suppress(ProcessLookupError):
                self._process.kill()
            self._process.wait()
        self._printer.join(1.0)
        assert self._process.stderr is not None
        self._process.stderr.close()
