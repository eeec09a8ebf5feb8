"""Environments with bad habits; `test_bad_habits.py` has the table of outcomes."""

import os
from typing import ClassVar

import gymnasium
import numpy as np

spaces = gymnasium.spaces


class Habit(gymnasium.Env):
    """Counts its moves; the classes below each do one thing in their own way."""

    metadata: ClassVar = {"render_modes": ["rgb_array"]}
    action_space = spaces.Discrete(2)
    observation_space = spaces.Discrete(100)

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at = 0
        return self.at, {}

    def step(self, action):
        assert self.action_space.contains(action), action
        self.at += 1
        return self.at, 1.0, False, False, {}

    def render(self):
        return np.full((8, 8, 3), self.at, np.uint8)


class StartsAtOne(Habit):
    action_space = spaces.Discrete(3, start=1)


class TwoWheels(Habit):
    action_space = spaces.MultiDiscrete([3, 2])


class Switches(Habit):
    action_space = spaces.MultiBinary(3)


class ManyWheels(Habit):
    action_space = spaces.MultiDiscrete([9, 9])


class Crowd(Habit):
    action_space = spaces.Discrete(81)


class Throttle(Habit):
    action_space = spaces.Box(-1, 1, (2,))


class Words(Habit):
    action_space = spaces.Text(5)


class FloatPicture(Habit):
    def render(self):
        return np.full((8, 8, 3), 0.5)


class NoPicture(Habit):
    def render(self):
        return None


class ChannelsFirst(Habit):
    def render(self):
        return np.zeros((3, 8, 8), np.uint8)


class Grey(Habit):
    def render(self):
        return np.zeros((8, 8), np.uint8)


class Transparent(Habit):
    def render(self):
        return np.zeros((8, 8, 4), np.uint8)


class Listed(Habit):
    def render(self):
        return [np.zeros((8, 8, 3), np.uint8)]


class TwoRewards(Habit):
    def step(self, action):
        return self.at, np.array([1.0, 2.0]), False, False, {}


class TwoGoals(TwoRewards):
    """Says so, as mo-gymnasium's do."""

    reward_space = spaces.Box(-1, 1, (2,))


class OldReset(Habit):
    def reset(self, *, seed=None, options=None):
        return 0


class OldStep(Habit):
    def step(self, action):
        return 0, 1.0, False, {}


class NoReset(Habit):
    def reset(self, *, seed=None, options=None):
        raise KeyError("no level file")


class Raises(Habit):
    def step(self, action):
        raise KeyError("no such room")


class Exits(Habit):
    def step(self, action):
        os._exit(3)


class NotANumber(Habit):
    def step(self, action):
        return self.at, float("nan"), False, False, {}


class Objects(Habit):
    def reset(self, *, seed=None, options=None):
        return np.array([object()]), {}


class NoMode(Habit):
    def __init__(self):
        self.render_mode = "human"


class Talks(Habit):
    def step(self, action):
        print("a move " * 10_000)
        return super().step(action)


class Asks(Habit):
    def reset(self, *, seed=None, options=None):
        input("which level? ")
        return 0, {}


def decide_as_it_is(observation):
    """A policy that returns the action of `TwoWheels` as the environment has it."""
    return np.array([2, 1])
