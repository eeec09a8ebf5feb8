"""Occupancy maps of map_server, written by hand: a PGM and a YAML beside it.

One pixel for each cell.
"""

import numpy as np

WAREHOUSE = np.array([[mark == "#" for mark in row] for row in (
    "..............",
    ".####..######.",
    ".####..######.",
    ".####..######.",
    ".####..######.",
    "..............",
    "...####.......",
    "...####..##...",
    "...####.......",
)])  # fmt: skip
"""bool[9, 14], True where blocked: the insides of its blocks can be seen from nowhere."""
INSIDES = 2 * 2 + 2 * 4 + 2 * 2
"""Cells of it that can be seen from nowhere: no free cell shares an edge or a corner with them.
One block meets the edge.
"""


def write_map(folder, name="warehouse", cells=WAREHOUSE, metres=1.0):
    """Write a map of square cells and return the path of its YAML file."""
    pixels = np.where(cells, 0, 254).astype(np.uint8)
    rows, cols = cells.shape
    (folder / f"{name}.pgm").write_bytes(b"P5\n%d %d\n255\n" % (cols, rows) + pixels.tobytes())
    path = folder / f"{name}.yaml"
    path.write_text(
        f"image: {name}.pgm\nresolution: {metres}\norigin: [0.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path
