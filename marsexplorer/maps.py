"""Maps as robots keep them, read as terrains: the YAML file and the picture of ROS's map_server (PGM or PNG).

The YAML file names the picture (`image`), the metres of a pixel's side (`resolution`), the pose of the picture's south-west
corner (`origin`: x, y in metres and yaw in radians), `negate` (0 or 1), `occupied_thresh` and `free_thresh` (0..1), and maybe
`mode`, which must be `trinary`. A pixel of brightness v (0..255, the mean of its colours) is occupied with probability
p = (255 - v) / 255, or v / 255 when negated: an obstacle for p > occupied_thresh, free for p < free_thresh, unknown between.

A cell of the terrain is blocked when any pixel that it overlaps is an obstacle or unknown, so a robot as wide as a cell that
moves from middle to middle of free cells touches nothing. A wider robot needs the pixels within (its diameter - cell) / 2 of
the cell blocked too, which is what `inflation` does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import MAP, MAX_SIDE, MIN_SIDE, EnvConfig

MAX_PIXELS = 16_000_000
"""Pictures with more pixels are refused."""
MAX_YAML_BYTES = 100_000
CELL_M = 0.5
"""Metres of a cell's side, unless another is asked for: the width of a usual indoor robot."""


class MapFileError(ValueError):
    """A map cannot be read: what was expected, what came, what to do."""


@dataclass(frozen=True)
class GridMap:
    """A terrain with its place in a robot's frame.

    terrain  bool[rows, cols], True where blocked, row 0 at the north edge
    cell     metres of a cell's side
    origin   (x, y, yaw) of the terrain's south-west corner: metres, and radians from the x axis to the rows' east
    start    (row, col) of a free cell
    """

    terrain: NDArray[np.bool_]
    cell: float
    origin: tuple[float, float, float]
    start: tuple[int, int]

    def config(self, sensor_radius: int = 6, beta: float = 0.99) -> EnvConfig:
        """Return the configuration of an episode on this map: 99 % of what can be discovered from the start."""
        rows, cols = self.terrain.shape
        return EnvConfig.of(MAP, (rows, cols), sensor_radius=sensor_radius, beta=beta)

    def to_metres(self, position: tuple[int, int]) -> tuple[float, float]:
        """Return (x, y) of the middle of a cell (row, col) in the robot's frame."""
        east = (position[1] + 0.5) * self.cell
        north = (self.terrain.shape[0] - position[0] - 0.5) * self.cell
        x, y, yaw = self.origin
        x, y = x + east * math.cos(yaw), y + east * math.sin(yaw)
        return x - north * math.sin(yaw), y + north * math.cos(yaw)

    def to_cell(self, x: float, y: float) -> tuple[int, int]:
        """Return (row, col) of the cell that a point in the robot's frame lies in; ValueError off the map."""
        dx, dy, yaw = x - self.origin[0], y - self.origin[1], self.origin[2]
        east = dx * math.cos(yaw) + dy * math.sin(yaw)
        north = dy * math.cos(yaw) - dx * math.sin(yaw)
        row = self.terrain.shape[0] - 1 - math.floor(north / self.cell)
        col = math.floor(east / self.cell)
        if not (0 <= row < self.terrain.shape[0] and 0 <= col < self.terrain.shape[1]):
            raise ValueError(
                f"the point ({x:g}, {y:g}) m lies off the map of {self.terrain.shape} cells of {self.cell:g} m"
            )
        return row, col


def read_map(
    path: Path | str,
    cell: float = CELL_M,
    inflation: float = 0.0,
    start: tuple[float, float] | None = None,
) -> GridMap:
    """Return the map of a map_server YAML file; MapFileError when it, its picture or the arguments cannot be used.

    cell       metres of a cell's side, at least a pixel
    inflation  metres by which obstacles are widened before cells are formed
    start      (x, y) in metres where the rover starts; None: the free cell nearest to (0, 0), where mapping usually begins;
               of several the northernmost, then the westernmost
    """
    path = Path(path)
    fields = _read_fields(path)
    resolution, origin = fields["resolution"], fields["origin"]
    if not (math.isfinite(cell) and cell >= resolution):
        raise MapFileError(f"cell must be at least a pixel, {resolution:g} m, got {cell!r}")
    if not (math.isfinite(inflation) and 0 <= inflation <= 100 * cell):
        known = "between 0 and 100 cells, in metres"
        raise MapFileError(f"inflation must be {known}, got {inflation!r}")
    blocked = _blocked_pixels(path.parent / fields["image"], fields)
    terrain = _form_cells(blocked, resolution, cell, inflation)
    if not all(MIN_SIDE <= side <= MAX_SIDE for side in terrain.shape):
        raise MapFileError(
            f"{path}: a side must have {MIN_SIDE} to {MAX_SIDE} cells, got {terrain.shape[0]}x{terrain.shape[1]} cells of "
            f"{cell:g} m; choose another cell"
        )
    free = np.argwhere(~terrain)
    if not len(free):
        why = f"no cell of {cell:g} m is free"
        raise MapFileError(f"{path}: {why}; choose a smaller cell or less inflation")
    unplaced = GridMap(terrain, cell, origin, (0, 0))
    points = np.array([unplaced.to_metres((int(row), int(col))) for row, col in free])
    nearest = free[int(np.hypot(*(points - (start or (0.0, 0.0))).T).argmin())]
    chosen = (int(nearest[0]), int(nearest[1]))
    if start is not None:
        try:
            own = unplaced.to_cell(*start)
        except ValueError as error:
            raise MapFileError(f"start: {error}") from error
        if own != chosen:
            raise MapFileError(
                f"start {start} m lies in a blocked cell; the nearest free one is at {unplaced.to_metres(chosen)} m"
            )
    return GridMap(terrain, cell, origin, chosen)


def write_map(found: GridMap, path: Path | str) -> None:
    """Write a map as a YAML file, and beside it a PGM picture of the same name with one pixel for each cell."""
    import yaml

    path = Path(path)
    rows, cols = found.terrain.shape
    pixels = np.where(found.terrain, np.uint8(0), np.uint8(254))
    path.with_suffix(".pgm").write_bytes(f"P5\n{cols} {rows}\n255\n".encode() + pixels.tobytes())
    fields = {
        "image": path.with_suffix(".pgm").name,
        "mode": "trinary",
        "resolution": float(found.cell),
        "origin": [float(each) for each in found.origin],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    path.write_text(yaml.safe_dump(fields, sort_keys=False, default_flow_style=None))


def _read_fields(path: Path) -> dict[str, Any]:
    """Return the fields of a YAML file, checked: numbers as float, origin as a tuple."""
    import yaml

    try:
        text = path.read_bytes()
        found = yaml.safe_load(text) if len(text) <= MAX_YAML_BYTES else None
    except (OSError, yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise MapFileError(f"{path} is no readable YAML file: {error}") from error
    if not isinstance(found, dict):
        known = "the fields of a map_server file, such as image and resolution"
        raise MapFileError(f"{path}: expected {known}, got none")
    fields: dict[str, Any] = {"image": found.get("image")}
    if not isinstance(fields["image"], str) or not fields["image"]:
        raise MapFileError(f"{path}: image must name the picture, got {found.get('image')!r}")
    fields["resolution"] = _number(path, "resolution", found.get("resolution"), 1e-4, 1e3)
    for name in ("occupied_thresh", "free_thresh", "negate"):
        fields[name] = _number(path, name, found.get(name), 0, 1)
    if (free := fields["free_thresh"]) > fields["occupied_thresh"]:
        raise MapFileError(f"{path}: free_thresh must not exceed occupied_thresh, got {free}")
    if found.get("mode", "trinary") != "trinary":
        given = f"mode must be trinary, got {found['mode']!r}"
        raise MapFileError(f"{path}: {given}; save the map in that mode")
    origin = found.get("origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapFileError(f"{path}: origin must be [x, y, yaw], got {origin!r}")
    fields["origin"] = tuple(_number(path, "origin", each, -1e9, 1e9) for each in origin)
    return fields


def _number(path: Path, name: str, value: object, low: float, high: float) -> float:
    if not isinstance(value, (int, float)) or not low <= value <= high:
        known = f"a number from {low:g} to {high:g}"
        raise MapFileError(f"{path}: {name} must be {known}, got {value!r}")
    return float(value)


def _blocked_pixels(path: Path, fields: dict[str, Any]) -> NDArray[np.bool_]:
    """Return bool[height, width], True for pixels that are not free."""
    from PIL import Image

    try:
        with Image.open(path, formats=("PPM", "PNG")) as picture:
            if picture.width * picture.height > MAX_PIXELS:
                size = f"{picture.width} x {picture.height}"
                raise MapFileError(f"{path}: at most {MAX_PIXELS:,} pixels are read, got {size}")
            if picture.mode not in ("L", "RGB", "RGBA", "LA", "P", "1"):
                given = f"got mode {picture.mode}"
                raise MapFileError(f"{path}: expected a picture of 8 bits a colour, {given}")
            pixels = np.asarray(picture.convert("RGBA"), np.float32)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        if isinstance(error, MapFileError):
            raise
        raise MapFileError(f"{path} is no readable PGM or PNG picture: {error}") from error
    shares = pixels[..., :3].mean(axis=2) / 255
    occupied = shares if fields["negate"] else 1 - shares
    free: NDArray[np.bool_] = (occupied < fields["free_thresh"]) & (pixels[..., 3] == 255)
    return ~free


def _form_cells(
    blocked: NDArray[np.bool_], resolution: float, cell: float, inflation: float
) -> NDArray[np.bool_]:
    """Return bool[rows, cols], True where a blocked pixel lies in the cell or within `inflation` metres of it.

    The grid begins in the south-west, as the origin does. What lies beyond the picture is blocked.
    """
    height, width = blocked.shape
    rows, cols = (math.ceil(side * resolution / cell - 1e-9) for side in (height, width))
    if max(rows, cols) > MAX_SIDE:  # refused by the caller, in words
        return np.ones((rows, cols) if rows * cols <= MAX_PIXELS else (MAX_SIDE + 1, 1), np.bool_)
    at_row, at_col = np.nonzero(blocked)
    south, west = (height - 1 - at_row) * resolution, at_col * resolution
    terrain = np.zeros((rows, cols), np.bool_)
    low, high = 1e-9 - inflation, inflation - 1e-9
    reach = math.ceil((resolution + 2 * inflation) / cell) + 1
    first_row = np.floor((south + low) / cell).astype(int)
    first_col = np.floor((west + low) / cell).astype(int)
    for step_row in range(reach + 1):
        for step_col in range(reach + 1):
            r, c = first_row + step_row, first_col + step_col
            gap_y = np.maximum(0, np.maximum(r * cell - south - resolution, south - (r + 1) * cell))
            gap_x = np.maximum(0, np.maximum(c * cell - west - resolution, west - (c + 1) * cell))
            is_on_grid = (r >= 0) & (r < rows) & (c >= 0) & (c < cols)
            near = is_on_grid & (np.hypot(gap_x, gap_y) <= max(inflation, 0.0))
            near &= (r * cell < south + resolution + high) & (c * cell < west + resolution + high)
            terrain[rows - 1 - r[near], c[near]] = True
    if rows * cell > height * resolution + 1e-9:
        terrain[0] = True
    if cols * cell > width * resolution + 1e-9:
        terrain[:, -1] = True
    return terrain
