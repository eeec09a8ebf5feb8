"""A person at the keys of a board on which time runs, over its socket."""

import json
import secrets
import time

from humanplay.board.clock import STALLED
from tests.support.page_loads import LOAD


def press(socket, episode, step, action, code, at_ms, seen=None):
    """Send a press at a time of the page's clock and its move, as the page does.

    seen  the step that was on screen, if it was not the move's own
    """
    seen = step if seen is None else seen
    key = {"kind": "keydown", "code": code, "repeat": False, "trusted": True}
    event = {**key, "client_ms": at_ms, "step": seen}
    batch = {"batch": secrets.token_hex(8), "episode": episode, **LOAD, "events": [event]}
    socket.send({"kind": "events", **batch})
    times = {"input": "key", "key_down_ms": at_ms, "client_ms": at_ms}
    socket.send({"kind": "act", "episode": episode, "step": step, "action": action, **times})


class Keyboard:
    """Sends key events on a socket, and follows the frames and the clock's state."""

    def __init__(self, socket, episode=None):
        self.socket = socket
        self.frame = socket.receive("frame")
        self.state, self.kinds, self.refused = "standing", set(), None
        self.sent = []

    def send(self, *events, **changes):
        """Send (kind, code) events in one batch."""
        sent_events = [
            {
                "kind": kind,
                "code": code,
                "repeat": code and False,
                "trusted": code and True,
                "client_ms": self.socket.clock.page_ms(),
                "step": self.frame["step"],
                **changes,
            }
            for kind, code in events
        ]
        batch = {"batch": secrets.token_hex(8), "episode": self.frame["episode"]}
        self.sent.append({"kind": "events", **batch, **LOAD, "events": sent_events})
        self.socket.send(self.sent[-1])

    def go_on(self):
        """Ask for time to run, and wait until it does."""
        self.send(("resume", None))
        self.until(lambda: self.state == "running")

    def hold(self, code, ticks):
        """Hold a key for so many ticks."""
        self.send(("keydown", code))
        self.pass_ticks(ticks)
        self.send(("keyup", code))

    def pass_ticks(self, ticks):
        """Wait until so many more ticks were made, or the episode has ended."""
        last = self.frame["step"] + ticks
        self.until(lambda: self.frame["step"] >= last or self.frame["outcome"])

    def until(self, claim, seconds=60.0):
        """Receive messages until something holds."""
        deadline = time.monotonic() + seconds
        while not claim():
            assert time.monotonic() < deadline, (self.state, self.frame["step"])
            self.take(json.loads(self.socket.connection.recv(timeout=seconds)))

    def take(self, message):
        self.kinds.add(message["kind"])
        if message["kind"] == "frame":
            self.frame = message
        elif message["kind"] == "clock":
            self.state, self.reason = message["state"], message["reason"]
            if self.reason == STALLED:  # the machine that tests was busy
                self.send(("resume", None))
        elif message["kind"] == "kept":
            self.refused = message["reason"] or self.refused

    def drain(self, seconds):
        """Receive what comes in so many seconds."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0:
            try:
                self.take(json.loads(self.socket.connection.recv(timeout=left)))
            except TimeoutError:
                return
