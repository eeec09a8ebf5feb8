"""Environments that say which actions are allowed, and raise at every other one."""

from typing import ClassVar

import gymnasium
import numpy as np


class Masked(gymnasium.Env):
    """A marker on a line of `cells` cells, with one of three forms of mask.

    how  "info", "observation" or "method"
    """

    metadata: ClassVar = {"render_modes": ["rgb_array"]}
    names: ClassVar[list[str]] = []
    cells = 6

    def __init__(self, how="info", render_mode=None):
        self.how, self.render_mode = how, render_mode
        self.action_space = gymnasium.spaces.Discrete(len(self.names))
        cell = gymnasium.spaces.Discrete(self.cells)
        mask = gymnasium.spaces.MultiBinary(len(self.names))
        parts = {"cell": cell, "action_mask": mask}
        self.observation_space = gymnasium.spaces.Dict(parts) if how == "observation" else cell
        if how == "method":
            self.action_masks = self.mask

    def get_action_meanings(self):
        return self.names

    def mask(self):
        return np.array([name in self.allowed() for name in self.names])

    def _shown(self):
        mask = self.mask().astype(np.int8)
        seen = {"cell": self.cell, "action_mask": mask} if self.how == "observation" else self.cell
        return seen, {"action_mask": mask} if self.how == "info" else {}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.cell = 0
        self.begin()
        return self._shown()

    def step(self, action):
        if not self.mask()[action]:
            raise KeyError(f"{self.names[action]} in cell {self.cell}")
        reward, ended = self.move(self.names[action])
        observation, info = self._shown()
        return observation, reward, ended, False, info

    def render(self):
        picture = np.zeros((40, 40 * self.cells, 3), np.uint8)
        picture[:, 40 * self.cell : 40 * self.cell + 40] = (240, 200, 60)
        return picture


class Doors(Masked):
    """To the last cell through a door, which must be opened first."""

    names: ClassVar = ["left", "right", "open"]

    def begin(self):
        self.door, self.is_open = int(self.np_random.integers(1, 4)), False

    def allowed(self):
        is_at_door = self.cell == self.door and not self.is_open
        return {
            *(["left"] if self.cell else []),
            *(["open"] if is_at_door else ["right"]),
        }

    def move(self, name):
        self.is_open |= name == "open"
        self.cell += {"left": -1, "right": 1, "open": 0}[name]
        ended = self.cell == self.cells - 1
        return float(ended), ended

    def render(self):
        picture = super().render()
        if not self.is_open:
            at = 40 * self.door + 36
            picture[:, at : at + 4] = (200, 40, 40)
        return picture


class Belt(Masked):
    """A belt with its own bans: no staying in odd cells, no leaving at its ends."""

    names: ClassVar = ["noop", "left", "right"]

    def begin(self):
        pass

    def allowed(self):
        return {
            *(["noop"] if self.cell % 2 == 0 else []),
            *(["left"] if self.cell else []),
            *(["right"] if self.cell < self.cells - 1 else []),
        }

    def move(self, name):
        self.cell += {"left": -1, "right": 1, "noop": 0}[name]
        return float(name == "right"), False


class Spent(Doors):
    """Allows nothing at all after its first move, and takes everything."""

    def allowed(self):
        return set() if self.cell else {"right"}

    def step(self, action):
        reward, ended = self.move(self.names[action] if self.cell < 5 else "open")
        return *self._shown()[:1], reward, ended, False, self._shown()[1]


class Crooked(Doors):
    """Its mask is not as long as its actions are many."""

    def mask(self):
        return np.ones(7, bool)


def last_allowed(observation, action_masks):
    """A policy that takes masks: the last action that is allowed."""
    return int(np.flatnonzero(action_masks)[-1])


for kind in (Doors, Belt, Spent, Crooked):
    gymnasium.register(f"{kind.__name__}-v0", kind, max_episode_steps=200)
