"""Hypothesis strategies of configurations, terrains and moves; never square."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from marsexplorer.config import LEVELS, EnvConfig

sides = st.integers(5, 40)
seeds = st.integers(0, 2**53 - 1)
moves = st.lists(st.integers(0, 3), min_size=1, max_size=120)


@st.composite
def terrains(draw, max_side=24, max_density=0.5):
    """bool[rows, cols] of any density with a free north-west corner."""
    rows = draw(st.integers(5, max_side))
    cols = draw(st.integers(5, max_side).filter(lambda side: side != rows))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    terrain = rng.random((rows, cols)) < draw(st.floats(0, max_density))
    terrain[0, 0] = False
    return terrain


@st.composite
def configs(draw, max_side=40):
    rows = draw(st.integers(5, max_side))
    return EnvConfig(
        level=draw(st.sampled_from(sorted(LEVELS))),
        rows=rows,
        cols=draw(st.integers(5, max_side)),
        sensor_radius=draw(st.integers(2, 8)),
    )
