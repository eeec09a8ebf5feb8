"""An environment as its author keeps it: a module in a folder, registered nowhere."""

import gymnasium
import numpy as np

STEP_COST = 0.1


class Line(gymnasium.Env):
    """A marker on a line of nine cells; the rightmost one ends the episode."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012
    action_space = gymnasium.spaces.Discrete(2)
    observation_space = gymnasium.spaces.Discrete(9)

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.cell = int(self.np_random.integers(0, 4))
        return self.cell, {}

    def step(self, action):
        self.cell = max(0, self.cell + (1 if action else -1))
        return self.cell, 1.0 if self.cell == 8 else -STEP_COST, self.cell == 8, False, {}

    def render(self):
        picture = np.zeros((20, 180, 3), np.uint8)
        picture[:, 20 * self.cell : 20 * self.cell + 20] = 255
        return picture


def make_line():
    return Line(render_mode="rgb_array")


def make_blind():
    return Line()
