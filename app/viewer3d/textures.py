"""The pictures: the soil, fixed for each size, the fog over it, made from what the rover knows, and the sky behind them."""

from __future__ import annotations

import io
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from marsexplorer.config import OBSTACLE, UNKNOWN

NIGHT = (14, 11, 13)
SOIL = (168, 98, 60)
DUST, GLOW = (120, 70, 46), (255, 206, 158)

CLEAR, FOG, LINE, EDGE, SHADE = range(5)
FOG_COLOURS = bytes([0, 0, 0, 26, 20, 23, 34, 26, 29, 255, 214, 150, 40, 24, 20])
FOG_ALPHA = bytes([0, 255, 255, 46, 150])
"""Colours (RGB) and opacities of clear ground, unknown cells, lines between them, known cells beside them, and under rocks."""


def pixels_a_cell(side: int, pixels: int, most: int) -> int:
    """Return how many pixels, 1 to `most`, a cell gets so that the longer side of a picture stays within `pixels`."""
    return max(1, min(most, pixels // side))


@lru_cache(maxsize=16)
def soil(rows: int, cols: int) -> bytes:
    """Return the ground as a JPEG, the same for every terrain of a size: value noise and a faint grid."""
    scale = pixels_a_cell(max(rows, cols), 768, 16)
    height, width = rows * scale, cols * scale
    rng = np.random.default_rng(rows * 1009 + cols)
    noise = np.zeros((height, width))
    for cells, weight in (
        (max(rows, cols) / 9, 0.5),
        (max(rows, cols) / 3, 0.3),
        (max(rows, cols) * 1.5, 0.2),
    ):
        coarse = rng.random(
            (
                max(2, round(cells * rows / max(rows, cols))),
                max(2, round(cells * cols / max(rows, cols))),
            )
        )
        blurred = Image.fromarray(coarse.astype(np.float32)).resize(
            (width, height), Image.Resampling.BICUBIC
        )
        noise += weight * np.asarray(blurred)
    ground = np.array(SOIL) * (0.74 + 0.5 * noise[..., None])
    lines = (np.arange(height)[:, None] % scale == 0) | (np.arange(width)[None] % scale == 0)
    ground[lines] *= 0.86
    ground *= 1 + 0.05 * rng.standard_normal((height, width, 1))
    return encoded(
        Image.fromarray(np.clip(ground, 0, 255).astype(np.uint8)), format="JPEG", quality=80
    )


@lru_cache(maxsize=1)
def sky() -> NDArray[np.uint8]:
    """Return the sky as uint8[160, 256, 3]: dust lit by a low sun along the horizon at the top, night below it."""
    down, across = np.mgrid[0:1:160j, 0:1:256j]
    dust = np.exp(-(((down - 0.05) / 0.16) ** 2))[..., None]
    away = np.hypot((across - 0.24) * 1.6, down - 0.07)
    glow = (0.5 * np.exp(-((away / 0.22) ** 2)) + 0.9 * np.exp(-((away / 0.025) ** 4)))[..., None]
    colours = (
        np.array(NIGHT) * (1 - 0.85 * dust) + np.array(DUST) * 0.85 * dust + np.array(GLOW) * glow
    )
    picture: NDArray[np.uint8] = np.clip(colours, 0, 255).astype(np.uint8)
    return picture


def encoded(image: Image.Image, **options: Any) -> bytes:
    """Return an image as the bytes of a file."""
    file = io.BytesIO()
    image.save(file, **options)
    return file.getvalue()


def fog(codes: NDArray[np.uint8]) -> bytes:
    """Return the fog over codes[rows, cols] as a PNG with a palette and alpha."""
    unknown = codes == UNKNOWN
    near = np.pad(unknown, 1)
    borders = near[:-2, 1:-1] | near[2:, 1:-1] | near[1:-1, :-2] | near[1:-1, 2:]
    picture = np.where(
        unknown, FOG, np.where(codes == OBSTACLE, SHADE, np.where(borders, EDGE, CLEAR))
    ).astype(np.uint8)
    scale = pixels_a_cell(max(codes.shape), 400, 4)
    picture = picture.repeat(scale, 0).repeat(scale, 1)
    if scale > 2:
        for lines in (picture[::scale], picture[:, ::scale]):
            lines[lines == FOG] = LINE
    image = Image.fromarray(picture, "P")
    image.putpalette(FOG_COLOURS)
    return encoded(image, format="PNG", transparency=FOG_ALPHA, compress_level=1)
