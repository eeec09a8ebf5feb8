"""Small maps like those of robots: float pixels [height, width].

0 occupied, 1 free, 0.804 unknown
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

UNKNOWN = 205 / 255

Pixels = NDArray[np.float64]


def save(
    folder: Path, pixels: Pixels, origin: tuple[float, float] = (0, 0), resolution: float = 0.05
) -> Path:
    """Write a map with its south-west corner at `origin` metres; return the YAML."""
    height, width = pixels.shape
    grey = np.round(255 * pixels).astype(np.uint8)
    (folder / "map.pgm").write_bytes(b"P5\n%d %d\n255\n" % (width, height) + grey.tobytes())
    path = folder / "map.yaml"
    path.write_text(
        f"image: map.pgm\nresolution: {resolution}\norigin: [{origin[0]}, {origin[1]}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path


def pillars() -> tuple[Pixels, tuple[float, float]]:
    """Nine pillars in a round room, as TurtleBot3's world: pockets at 0.5 m."""
    pixels = np.full((384, 384), UNKNOWN)
    rows, cols = np.indices(pixels.shape)
    distance = np.hypot(rows - 192, cols - 192)
    pixels[distance < 50] = 0
    pixels[distance < 47] = 1
    for row in (170, 192, 214):
        for col in (170, 192, 214):
            pixels[np.hypot(rows - row, cols - col) < 3.5] = 0
    pixels[192, 192] = 0
    return pixels, (-10.0, -10.0)


def depot() -> tuple[Pixels, tuple[float, float]]:
    """A hall with shelves, free cells outside where the origin is, as Nav2's depot."""
    pixels = np.ones((240, 400))
    pixels[3:-5, 5:8] = pixels[3:-5, -6:-3] = 0
    pixels[3:6, 5:-3] = pixels[-8:-5, 5:-3] = 0
    for row in range(45, 200, 40):
        pixels[row : row + 12, 60:180] = pixels[row : row + 12, 220:340] = 0
    return pixels, (0.0, 0.0)


def offices() -> tuple[Pixels, tuple[float, float]]:
    """Rooms with doors of 0.8 m, and free specks outside, as the maps of stdr."""
    pixels = np.full((300, 400), UNKNOWN)
    pixels[20:280, 20:380] = 0
    for row in range(24, 276, 84):
        for col in range(24, 376, 88):
            pixels[row : row + 80, col : col + 84] = 1
            pixels[row + 30 : row + 46, col + 84 : col + 88] = 1
            pixels[row + 80 : row + 84, col + 30 : col + 46] = 1
    pixels[:, 376:] = UNKNOWN
    pixels[272:] = UNKNOWN
    pixels[296:299, 2:60:6] = 1
    return pixels, (0.0, 0.0)


def race_track() -> tuple[Pixels, tuple[float, float]]:
    """A closed track 2 m wide between walls, as the tracks of F1TENTH.

    Inside and outside are free and larger.
    """
    pixels = np.ones((360, 480))
    rows, cols = np.indices(pixels.shape)
    distance = np.hypot((rows - 180) / 0.75, cols - 240)
    pixels[(distance > 146) & (distance < 204)] = 0
    pixels[(distance > 150) & (distance < 200)] = 1
    return pixels, (-(240 - 175) * 0.05, -180 * 0.05)


KINDS = {"pillars": pillars, "depot": depot, "offices": offices, "race track": race_track}
