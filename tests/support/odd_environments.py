"""Environments that do not follow from seed and actions, beside twins that do.

`tests.support.odd_environments:Odd-clock-v0` is the odd one, `Even-clock-v0` its twin.
"""

import random
import time
from pathlib import Path

import gymnasium
import numpy as np

REASONS = (
    "python",
    "numpy",
    "clock",
    "sets",
    "pair",
    "mask",
    "module",
    "counter",
    "file",
    "render",
    "picture",
    "late",
    "reset",
)
module_state = [0]


class Walk(gymnasium.Env):
    """A number shown as a picture; the odd one adds something to seed and actions."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012
    action_space = gymnasium.spaces.Discrete(3)
    observation_space = gymnasium.spaces.Box(-1e9, 1e9, (1,), np.float64)
    made = 0

    def __init__(self, reason, odd, render_mode=None):
        self.reason, self.odd, self.render_mode = reason, odd, render_mode
        Walk.made += 1
        self.number, self.resets, self.steps = Walk.made, 0, 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps, self.place = 0, float(self.np_random.integers(100))
        self.resets += 1
        module_state[0] += 1
        self.place += self._other() if self.reason in ("counter", "module", "reset", "file") else 0
        return np.array([self.place]), self._info()

    def _info(self):
        if self.reason != "mask":
            return {}
        drawn = np.random.default_rng() if self.odd else self.np_random
        return {"action_mask": drawn.integers(0, 2, 3, np.int8)}

    def _other(self):
        if not self.odd:
            return float(self.np_random.integers(5))
        match self.reason:
            case "python":
                return random.random()
            case "numpy":
                return np.random.random()
            case "clock":
                return time.time_ns() % 1000
            case "sets":
                return ord(next(iter({"ant", "bee", "cat", "dog", "eel", "fox"}))[0])
            case "pair":  # in the same order under the hash seeds 0 and 77
                return ord(next(iter({"ant", "bee"}))[0])
            case "counter":
                return self.number
            case "module":
                return module_state[0]
            case "reset":
                return self.resets
            case "file":
                path = Path("odd.txt")
                count = int(path.read_text() or 0) if path.exists() else 0  # several play at once
                path.write_text(str(count + 1))
                return count
            case "late":
                return time.time_ns() % 1000 if self.steps > 1000 else 0
        return 0

    def step(self, action):
        self.steps += 1
        self.place += action + self.np_random.integers(3)
        if self.reason in ("python", "numpy", "clock", "sets", "pair", "late"):
            self.place += self._other()
        return np.array([self.place]), 0.0, False, False, self._info()

    def render(self):
        picture = np.full((4, 6, 3), int(self.place) % 256, np.uint8)
        if self.odd and self.reason == "render":
            self.np_random.integers(3)
        if self.odd and self.reason == "picture":
            picture[0, 0] = time.time_ns() // 1000 % 256
        return picture


for reason in REASONS:
    for kind in ("Odd", "Even"):
        gymnasium.register(
            f"{kind}-{reason}-v0", "tests.support.odd_environments:Walk",
            kwargs={"reason": reason, "odd": kind == "Odd"},
            max_episode_steps=1500 if reason == "late" else 30,
        )  # fmt: skip


class HeedsMakeAlone(Walk):
    """Draws from the seed that it was made with, and heeds that of `reset` no more."""

    def __init__(self, seed=None, render_mode=None):
        super().__init__("made", False, render_mode)
        self.own = np.random.default_rng(seed)

    def reset(self, *, seed=None, options=None):
        gymnasium.Env.reset(self, seed=int(self.own.integers(2**31)))
        self.steps, self.place = 0, float(self.np_random.integers(100))
        return np.array([self.place]), {}


gymnasium.register("Heeds-make-alone-v0", HeedsMakeAlone, max_episode_steps=30)


class SlowReset(Walk):
    """Takes long to begin an episode, which ends at its first move."""

    def reset(self, *, seed=None, options=None):
        time.sleep(0.1)
        return super().reset(seed=seed)


gymnasium.register(
    "Slow-reset-v0", SlowReset, kwargs={"reason": "", "odd": False}, max_episode_steps=1
)
