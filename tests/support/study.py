"""A frozen study on small boards, and a participant who goes through it as the page would."""

from contextlib import contextmanager

from app.study.folder import Folder
from app.study.protocol import default_protocol
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.policies import load

SIZE = (7, 9)


def freeze(root, name="small", **rest):
    """Return a frozen study: 2 warm-up and 3 ranked episodes on 7x9, a break after every 2, the rules as debrief policy."""
    small = {
        "warm_up": 2,
        "ranked": 3,
        "players": 2,
        "break_every": 2,
        "policies": ("frontier-cost",),
    }
    folder = Folder(root)
    config = EnvConfig.of("random", rest.pop("size", SIZE))
    folder.create(
        default_protocol(name, config, **{**small, "debrief_policy": "frontier-cost", **rest})
    )
    return folder.freeze(name)


class Person:
    """A participant with a cookie of their own; `where` is the last answer."""

    def __init__(self, server, study="small", client=None, **join):
        self.server, self.client = server, client or server.client()
        self.url = f"/api/studies/{study}"
        self.where = {}
        if join.pop("joins", True):
            self.call("join", join or None, status=(200, 201))

    def call(self, what, body=None, status=(200,)):
        """POST and keep the answer."""
        answer = self.client.post(f"{self.url}/{what}", json=body)
        assert answer.status_code in status, (what, answer.status_code, answer.text)
        if answer.status_code < 300:
            self.where = answer.json()
        return answer.json()

    def refused(self, what, body=None, status=409):
        """POST, expect a refusal and return its sentence."""
        return self.call(what, body, (status,))["detail"]

    def me(self):
        self.where = self.client.get(f"{self.url}/me").json()
        return self.where

    @property
    def frame(self):
        return self.where["about"]["frame"]

    def to_tutorial(self):
        self.call("consent", {"version": "1", "agree": True})
        self.call("advance", {"from": "instructions"})

    def to_warm_up(self):
        self.to_tutorial()
        self.call("next")
        self.call("give-up", {"episode": self.frame["episode"], "step": self.frame["step"]})
        self.call("advance", {"from": "tutorial"})
        self.call("answers", {"answers": [0, 1, 1]})

    @contextmanager
    def socket(self):
        with self.server.socket(self.where["session"], self.client) as socket:
            yield socket

    def play(self, moves=None, **act):
        """Play the running episode with a frontier rule, to its end or for some moves; return the frames.

        The moves are a person's by key, with their input events; `input=None` makes them a script's.
        """
        policy = load("frontier-cost")
        policy.reset(1)
        with self.socket() as socket:
            frames = [socket.receive("frame")]
            while frames[-1]["outcome"] is None and (moves is None or len(frames) <= moves):
                action = ACTIONS[policy.act(codes(frames[-1]))]
                socket.act(frames[-1], action, **{"input": "key", **act})
                frames.append(socket.frame_after(frames[-1]["step"]))
        return frames

    def play_on(self, until=("debrief",), **act):
        """Play every episode until one of the stages; return all frames by phase."""
        seen = {"tutorial": [], "warm_up": [], "ranked": []}
        while self.me()["stage"] not in until:
            self.call("next")
            seen[self.where["phase"]].append(self.play(**act))
        return seen


def codes(frame):
    """The occupancy grid of a frame: uint8[rows, cols]."""
    import numpy as np

    return np.array([["?.@#".index(cell) for cell in row] for row in frame["grid"]], np.uint8)
