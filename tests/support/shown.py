"""An environment that draws one picture in the ways in which others draw it."""

import gymnasium
import numpy as np

RGB = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
GREY = np.array([[0, 100, 255], [7, 8, 9]], np.uint8)


def figure():
    from matplotlib.figure import Figure

    drawn = Figure((0.2, 0.1), dpi=10, facecolor=(1, 0, 0))
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(drawn)
    return drawn


def closed_figure():
    """One that pyplot has made and forgotten, so that it holds no memory."""
    from matplotlib import pyplot

    drawn = pyplot.figure(figsize=(0.2, 0.1), dpi=10, facecolor=(1, 0, 0))
    pyplot.close(drawn)
    return drawn


WAYS = {
    "rgb": lambda: RGB,
    "rgba": lambda: np.dstack([RGB, np.full((2, 3), 255, np.uint8)]),
    "wide": lambda: RGB.astype(np.int64),
    "list": lambda: [GREY, RGB],
    "nested": lambda: RGB.tolist(),
    "grey": lambda: GREY,
    "grey channel": lambda: GREY[:, :, None],
    "mask": lambda: GREY > 50,
    "figure": figure,
    "closed figure": closed_figure,
    "float": lambda: RGB / 255,
    "negative": lambda: RGB.astype(np.int64) - 1,
    "channels first": lambda: np.moveaxis(np.zeros((5, 6, 3), np.uint8), -1, 0),
    "nothing": lambda: None,
    "one number": lambda: 3,
}


class Shown(gymnasium.Env):
    """Never ends."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012
    action_space = gymnasium.spaces.Discrete(2)
    observation_space = gymnasium.spaces.Discrete(2)

    def __init__(self, way, render_mode=None):
        self.way, self.render_mode = way, render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return 0, {}

    def step(self, action):
        return 0, 0.0, False, False, {}

    def render(self):
        return WAYS[self.way]()
