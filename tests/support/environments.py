"""Small environments of the tests' own, each unlike Gymnasium's in one way."""

import contextlib
import ctypes
import enum
import os
import pathlib
import socket
import time
from typing import ClassVar

import gymnasium
import numpy as np


class Path(gymnasium.Env):
    """A walk from cell 0 to cell `length`, shown as text; its coins are in `info`."""

    metadata: ClassVar = {"render_modes": ["ansi"]}
    observation_space = gymnasium.spaces.Discrete(100)
    action_space = gymnasium.spaces.Discrete(3)

    class actions(enum.IntEnum):  # noqa: N801
        back = 0
        forward = 1
        wave = 2

    def __init__(self, length=5, render_mode=None):
        self.length, self.render_mode = length, render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at, self.coins = int(self.np_random.integers(2)), 0
        return self.at, {}

    def step(self, action):
        self.at = max(0, self.at + (-1, 1, 0)[action])
        self.coins += 2 * (action == 1)
        home = self.at >= self.length
        return self.at, -1.0, home, False, {"coins": self.coins, "home": home}

    def render(self):
        return "." * self.at + "@" + "." * max(0, self.length - self.at)


class Meanings(Path):
    """Names its actions as ALE does, and draws."""

    metadata: ClassVar = {"render_modes": ["rgb_array"]}
    actions = None

    def get_action_meanings(self):
        return ["NOOP", "RIGHT", "RIGHTFIRE"]

    def render(self):
        return np.full((8, 8, 3), self.at, np.uint8)


class OwnKeys(Meanings):
    """Tells its keys as pygame has them."""

    get_action_meanings = None

    def get_keys_to_action(self):
        return {(): 0, (276,): 0, (ord("j"),): 1, (275, 276): 2}


class Blind(Path):
    metadata: ClassVar = {"render_modes": ["human"]}


class Wheel(Meanings):
    action_space = gymnasium.spaces.Box(-1, 1, (1,))


class Steered(gymnasium.ActionWrapper):
    """Two actions of a wheel."""

    def __init__(self, env):
        super().__init__(env)
        self.action_space = gymnasium.spaces.Discrete(2)

    def action(self, action):
        return action


class Seeded(Meanings):
    """Heeds the seed that it is made with, and no other."""

    def __init__(self, seed=0, render_mode=None):
        super().__init__(render_mode=render_mode)
        self.seed = seed

    def reset(self, *, seed=None, options=None):
        super().reset(seed=self.seed)
        return self.at, {}


class Failing(Path):
    """Fails at the action `wave`: at every one, or once if a file `once` exists."""

    def __init__(self, how, once="", step_s=0, render_mode=None):
        super().__init__(30, render_mode)
        self.how, self.once, self.step_s = how, once, step_s

    def step(self, action):
        if self.how in ("nan", "-inf") and action == 2:
            return self.at, float(self.how), False, False, {}
        if self.how == "told" and action == 2:
            return self.at, 0.0, False, False, {"coins": np.inf}
        time.sleep(self.step_s)
        if action == 2 and not (self.once and pathlib.Path(self.once).exists()):
            if self.once:
                pathlib.Path(self.once).touch()
            self.fail()
        return super().step(action)

    def fail(self):
        match self.how:
            case "crash":
                ctypes.string_at(0)
            case "exit":
                os._exit(0)
            case "raise":
                raise KeyError("no such room")
            case "loop":
                while True:
                    pass
            case "sleep":
                time.sleep(1e9)
            case "memory":
                eaten = []
                while True:
                    eaten.append(bytearray(2**23))


class Sleeper(Path):
    """Never begins on seed 7."""

    def reset(self, *, seed=None, options=None):
        if seed == 7:
            time.sleep(1e9)
        return super().reset(seed=seed)


class Nosy(Path):
    """Shows what it reads of a file, what a port answers, and who it is."""

    def __init__(self, path, port, render_mode=None):
        super().__init__(30, render_mode)
        self.path, self.port = path, port

    def render(self):
        return f"{tried(pathlib.Path(self.path).read_bytes)}, {tried(self.connect)}"

    def connect(self):
        socket.create_connection(("127.0.0.1", self.port), timeout=2).close()


def tried(call):
    """The name of the error that a call ends with, "done" where it succeeds."""
    try:
        call()
    except OSError as error:
        return type(error).__name__
    return "done"


class Shipped(gymnasium.Env):
    """Crafter as it is shipped."""

    metadata: ClassVar = {"render_modes": ["rgb_array"]}
    action_space = gymnasium.spaces.Discrete(17)
    observation_space = gymnasium.spaces.Box(0, 255, (90, 90, 3), np.uint8)

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        import crafter

        self.inner = crafter.Env(seed=seed, size=(90, 90))
        return self.inner.reset(), {}

    def step(self, action):
        seen, reward, ended, _ = self.inner.step(action)
        return seen, reward, ended, False, {}

    def render(self):
        return self.inner.render()


for each in (Shipped, Path, Failing, Nosy, Sleeper, Meanings, OwnKeys, Blind, Wheel, Seeded):
    gymnasium.register(f"{each.__name__}-v0", each)


def forward(observation):
    """A rule for `Path`."""
    return 1


def nosy(observation):
    """A rule for `Path`; RuntimeError if it sees what others share, or reaches a port."""
    with contextlib.suppress(PermissionError):
        raise RuntimeError(f"it sees {[*pathlib.Path('/dev/shm').iterdir()]}")
    try:
        socket.create_connection(("127.0.0.1", 9), timeout=2)
    except ConnectionRefusedError as error:
        raise RuntimeError("it reaches ports") from error
    except OSError:
        return 1


def nowhere(observation):
    """A rule that chooses what is no action."""
    return 99
