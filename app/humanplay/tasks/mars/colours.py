"""The colours of a terrain, and what is known of one as a small picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from humanplay.board.pictures import png

Colour = tuple[int, int, int]
NIGHT: Colour = (14, 11, 13)
SOIL: Colour = (168, 98, 60)
AMBER: Colour = (255, 179, 71)
ROCK: Colour = (220, 203, 184)


def data_url(codes: NDArray[np.uint8]) -> str:
    """Return the known map as a PNG's data URL, its longer side near 480 pixels."""
    colours = np.array([NIGHT, SOIL, AMBER, ROCK], np.uint8)
    cell = max(1, 480 // max(codes.shape))
    pixels: NDArray[np.uint8] = np.repeat(np.repeat(colours[codes], cell, 0), cell, 1)
    return png(pixels, quick=True)
