"""Environments in which actions without names move a marker."""

import gymnasium
import numpy as np


class Field(gymnasium.Env):
    """Bring the square into the corner.

    It is drawn as a picture.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012
    action_space = gymnasium.spaces.Discrete(4)
    observation_space = gymnasium.spaces.MultiDiscrete([6, 6])
    moves = ((1, 0), (0, -1), (0, 1), (-1, 0))

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.cell = self.np_random.integers(0, 5, 2)  # never in the corner already
        return self.cell.copy(), {}

    def step(self, action):
        self.cell = np.clip(self.cell + self.moves[action], 0, 5)
        is_there = bool((self.cell == 5).all())
        return self.cell.copy(), float(is_there), is_there, False, {}

    def render(self):
        picture = np.zeros((60, 60, 3), np.uint8)
        row, col = 10 * self.cell
        picture[row : row + 10, col : col + 10] = (200, 30, 30)
        return picture


class Walled(Field):
    """Bring the square into the corner. A step into a wall is forbidden, and raises."""

    def action_masks(self):
        cells = self.cell + np.array(self.moves)
        return ((cells >= 0) & (cells <= 5)).all(axis=1)

    def step(self, action):
        if not self.action_masks()[action]:
            raise ValueError("there is a wall")
        return super().step(action)


class Faint(Field):
    """Bring the square into the corner, in numbers from 0 to 1."""

    def render(self):
        return super().render() / 255


class Letters(Field):
    """Move the letter, or stay."""

    metadata = {"render_modes": ["ansi"]}  # noqa: RUF012
    action_space = gymnasium.spaces.Discrete(3)
    moves = ((-1, 0), (0, 0), (1, 0))

    def render(self):
        rows = [["."] * 6 for _ in range(6)]
        rows[self.cell[0]][self.cell[1]] = "X"
        return "\n".join(map("".join, rows))


class Levers(Field):
    """Only the first of many levers works; each of the others raises."""

    action_space = gymnasium.spaces.Discrete(18)

    def step(self, action):
        if action:
            raise RuntimeError("the lever is broken")
        return self.cell.copy(), 1.0, True, False, {}
