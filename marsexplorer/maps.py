"""Maps of robots as terrains: a map file's occupancy cut into cells.

A map keeps its place in the robot's frame.

A cell of the terrain is free when every pixel that it overlaps is free (occupancy 0), so a robot as
wide as a cell that moves from middle to middle of free cells touches nothing. A wider robot needs
the pixels within (its diameter - cell) / 2 of the cell free too, which is what `inflation` does.

The terrain is cut to what is known: the cells that hold a pixel which is not unknown, and one ring
of cells round them. Cells are counted from the file's origin, so each keeps its place in metres.

Regions of free cells that share edges are where a rover can go. One is *playable* when it has at
least 5 % of the free cells, and the rover sees at most 30 % of what counts from its start. A map
that is too small for that in cells of any size is played from the nearest region of 5 % where at
most 90 % is seen at once.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marsexplorer.config import MAP, MAX_SIDE, MIN_SIDE, EnvConfig
from marsexplorer.map_files import (
    FREE,
    UNKNOWN,
    MapFileError,
    MapWarning,
    Occupancy,
    read_occupancy,
)
from marsexplorer.regions import label_regions
from marsexplorer.rules import AT_START, CELLS
from marsexplorer.world import Worlds

__all__ = [
    "CELLS_M",
    "MOST_CELLS",
    "GridMap",
    "MapFileError",
    "MapWarning",
    "read_map",
    "write_map",
]

CELLS_M = (0.5, 0.35, 0.25, 0.2, 0.15, 0.1)
"""Metres of a cell's side that are tried, the width of a usual indoor robot first."""
LARGE_CELLS_M = (0.75, 1.0)
"""Those that are tried only where all others give more than MOST_CELLS a side."""
MOST_CELLS = 256
"""Cells a side that a cell chosen here gives at most: those of the page's largest board."""
LEAST_SHARE = 0.05
"""Share of the free cells that a playable region has at least."""
MOST_SEEN = 0.3
"""Share of what counts that is seen at once from a playable start at most."""
MOST_SEEN_OF_SMALL = 0.9
"""The same of a map that is too small for less."""
LEAST_CONNECTED = 0.5
"""Share of the free area that a cell's size leaves connected to the start at least."""


@dataclass(frozen=True)
class GridMap:
    """A terrain with its place in a robot's frame.

    terrain  bool[rows, cols], True where blocked, row 0 at the north edge
    cell     metres of a cell's side
    origin   (x, y, yaw) of the terrain's south-west corner: metres, and radians from the x axis to
             the rows' east
    start    (row, col) of a free cell
    """

    terrain: NDArray[np.bool_]
    cell: float
    origin: tuple[float, float, float]
    start: tuple[int, int]

    def config(self, sensor_radius: int = 6, beta: float = 0.99) -> EnvConfig:
        """The configuration of an episode here: 99 % of what the start can discover."""
        rows, cols = self.terrain.shape
        return EnvConfig.of(MAP, (rows, cols), sensor_radius=sensor_radius, beta=beta)

    def to_metres(self, position: tuple[int, int]) -> tuple[float, float]:
        """(x, y) of the middle of a cell (row, col) in the robot's frame."""
        (x,), (y,) = self.middles(np.array([position[0]]), np.array([position[1]]))
        return float(x), float(y)

    def middles(
        self, rows: NDArray[np.intp], cols: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """`to_metres` of many cells."""
        east = (cols + 0.5) * np.float64(self.cell)
        north = (self.terrain.shape[0] - rows - 0.5) * np.float64(self.cell)
        x, y, yaw = self.origin
        cosine, sine = np.float64(math.cos(yaw)), np.float64(math.sin(yaw))
        return x + east * cosine - north * sine, y + east * sine + north * cosine

    def to_cell(self, x: float, y: float) -> tuple[int, int]:
        """(row, col) of the cell at a point in the robot's frame; ValueError off the map."""
        dx, dy, yaw = x - self.origin[0], y - self.origin[1], self.origin[2]
        east = dx * math.cos(yaw) + dy * math.sin(yaw)
        north = dy * math.cos(yaw) - dx * math.sin(yaw)
        row = self.terrain.shape[0] - 1 - math.floor(north / self.cell)
        col = math.floor(east / self.cell)
        if not (0 <= row < self.terrain.shape[0] and 0 <= col < self.terrain.shape[1]):
            raise ValueError(
                f"the point ({x:g}, {y:g}) m lies off the map of {self.terrain.shape} cells of "
                f"{self.cell:g} m"
            )
        return row, col


def read_map(
    path: Path | str,
    cell: float | None = None,
    inflation: float = 0.0,
    start: tuple[float, float] | None = None,
) -> GridMap:
    """Read a map_server YAML file as a terrain; MapFileError if that is impossible.

    Args:
        path: The YAML file; as in Nav2 a first `~` is the user's home.
        cell: Metres of a cell's side, at least a pixel. None takes the largest of CELLS_M from
            which the start is playable and at least half of the free cells are reached, or the
            share that is reached at the size of a pixel if that is less. Where no size reaches that
            many, it is the largest that reaches nine tenths of what the best one does.
        inflation: Metres by which obstacles are widened before cells are formed.
        start: (x, y) in metres where the rover starts, with a MapWarning where that is not
            playable. None takes the free cell nearest to (0, 0), where mapping usually begins, in
            the nearest playable region; of several the northernmost, then the westernmost.
    """
    path = Path(path).expanduser()
    occupancy = read_occupancy(path)
    reading = _Reading(path, occupancy, inflation, start)
    if cell is not None and not (math.isfinite(cell) and cell >= occupancy.resolution):
        raise MapFileError(
            f"cell must be at least a pixel, {occupancy.resolution:g} m, got {cell!r}"
        )
    if not (math.isfinite(inflation) and 0 <= inflation <= 100 * (cell or CELLS_M[0])):
        raise MapFileError(
            f"inflation must be between 0 and 100 cells, in metres, got {inflation!r}"
        )
    if not (occupancy.cells == FREE).any():
        raise MapFileError(f"{path}: no pixel is free; check negate, mode and the thresholds")
    return reading.with_chosen_cell() if cell is None else reading.with_cell(cell)


def write_map(grid_map: GridMap, path: Path | str) -> None:
    """Write a map as a YAML file and a PGM picture beside it, one pixel for each cell.

    ValueError if the YAML file's name is the picture's.
    """
    import yaml

    path = Path(path)
    picture = path.with_suffix(".pgm")
    if path.suffix.lower() == ".pgm":
        raise ValueError(
            f"expected the name of a YAML file, got {path}, which the picture beside it would "
            f"have too; give {path.with_suffix('.yaml')}"
        )
    rows, cols = grid_map.terrain.shape
    pixels = np.where(grid_map.terrain, np.uint8(0), np.uint8(254))
    picture.write_bytes(f"P5\n{cols} {rows}\n255\n".encode() + pixels.tobytes())
    fields = {
        "image": picture.name,
        "mode": "trinary",
        "resolution": float(grid_map.cell),
        "origin": [float(number) for number in grid_map.origin],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    path.write_text(yaml.safe_dump(fields, sort_keys=False, default_flow_style=None))


def _warn(message: str) -> None:
    warnings.warn(message, MapWarning, stacklevel=5)


class _Reading:
    """A map file that is being read: its terrains and starts at several cell sizes."""

    def __init__(
        self,
        path: Path,
        occupancy: Occupancy,
        inflation: float,
        start: tuple[float, float] | None,
    ) -> None:
        self._path, self._occupancy, self._inflation = path, occupancy, inflation
        self._start, self._point = start, start or (0.0, 0.0)

    def with_cell(self, cell: float) -> GridMap:
        """The map in cells of a size that was asked for."""
        size = self._form(cell)
        if not all(MIN_SIDE <= side <= MAX_SIDE for side in size.shape):
            rows, cols = size.shape
            raise MapFileError(
                f"{self._path}: a side must have {MIN_SIDE} to {MAX_SIDE} cells, got "
                f"{rows}x{cols} cells of {cell:g} m; choose another cell"
            )
        self._check_free(size)
        if self._start is not None:
            return self._with_start(size, self._start)
        if (start := next(size.playable(), None)) is None:
            return self._small([size])
        return size.map_from(start.position)

    def _check_free(self, size: _Cells) -> None:
        """Raise MapFileError where all cells are blocked."""
        if size.terrain.all():
            raise MapFileError(
                f"{self._path}: no cell of {size.map.cell:g} m is free; choose a smaller cell "
                "or less inflation"
            )

    def with_chosen_cell(self) -> GridMap:
        """The map in the largest cells that connect enough of it to a playable start."""
        sizes = self._sizes()
        if not sizes:
            raise MapFileError(
                f"{self._path}: no cell of {CELLS_M[-1]:g} to {LARGE_CELLS_M[-1]:g} m gives "
                f"{MIN_SIDE} to {MOST_CELLS} cells a side; give the metres of a cell (--cell)"
            )
        for home, share in self._homes():
            starts = [(size, self._start_in(size, home)) for size in sizes]
            playable = [(size, start) for size, start in starts if start is not None]
            if playable:
                best = max(start.share for _, start in playable)
                enough = min(LEAST_CONNECTED, share)
                if best < enough:
                    enough = 0.9 * best
                chosen = next((size, start) for size, start in playable if start.share >= enough)
                if self._start is not None:
                    return self._with_start(chosen[0], self._start)
                return chosen[0].map_from(chosen[1].position)
        if self._start is not None:
            for size in sizes:
                if size.is_free(self._start):
                    return self._with_start(size, self._start)
            return self._with_start(sizes[-1], self._start)
        return self._small(sizes)

    def _sizes(self) -> list[_Cells]:
        """The map in cells of each size that may be chosen, the largest first."""
        resolution = self._occupancy.resolution
        lengths = [length for length in CELLS_M if length >= resolution * (1 - 1e-9)]
        sizes = [self._form(max(length, resolution)) for length in lengths or [resolution]]
        if all(max(size.shape) > MOST_CELLS for size in sizes):
            more = [length for length in LARGE_CELLS_M if length >= resolution]
            sizes = [self._form(length) for length in reversed(more)] + sizes
        return [
            size for size in sizes if min(size.shape) >= MIN_SIDE and max(size.shape) <= MOST_CELLS
        ]

    def _homes(self) -> Iterator[tuple[int, float]]:
        """The large regions of free pixels, the nearest first, each with its share."""
        for start in self._pixels.starts():
            if start.share >= LEAST_SHARE or self._start is not None:
                yield start.region, start.share
            if self._start is not None:
                return

    def _start_in(self, size: _Cells, home: int) -> _Start | None:
        """The start in the nearest playable region of cells within a region of pixels."""
        if self._start is not None:
            if not size.is_free(self._start):
                return None
            start = size.start_at(size.map.to_cell(*self._start))
            return start if size.is_playable(start) else None
        fine = self._pixels
        for start in size.starts():
            x, y = size.map.to_metres(start.position)
            is_home = fine.is_free((x, y)) and fine.labels[fine.map.to_cell(x, y)] == home
            if is_home and size.is_playable(start):
                return start
        return None

    def _with_start(self, size: _Cells, point: tuple[float, float]) -> GridMap:
        """The map with a start that was asked for."""
        try:
            position = size.map.to_cell(*point)
        except ValueError as error:
            raise MapFileError(f"start: {error}") from error
        self._check_free(size)
        if size.terrain[position]:
            near = next(size.playable(), None) or next(size.starts())
            x, y = size.map.to_metres(near.position)
            raise MapFileError(
                f"start {point} m lies in a blocked cell; the nearest free one is at ({x:g}, "
                f"{y:g}) m"
            )
        start = size.start_at(position)
        if not size.is_playable(start):
            _warn(
                f"{self._path}: from the start {point} m {size.describe(start)}; "
                "leave the start out to begin where there is more to explore"
            )
        return size.map_from(position)

    def _small(self, sizes: list[_Cells]) -> GridMap:
        """A map too small for a playable start, as long as something is left to explore.

        MapFileError otherwise, and if another size of a cell has a playable start.
        """
        fitting = self._fitting([size.map.cell for size in sizes])
        if fitting is None:
            for size in sizes:
                for start in size.starts():
                    if start.share >= LEAST_SHARE and size.seen(start) <= MOST_SEEN_OF_SMALL:
                        return size.map_from(start.position)
        sentences = []
        for size in sizes:
            largest = max(size.starts(), key=lambda start: start.share, default=None)
            sentence = "no cell is free" if largest is None else size.describe(largest)
            sentences.append(f"in cells of {size.map.cell:g} m {sentence}")
        way_out = "give a map with more rooms"
        if fitting is not None:
            way_out = f"cells of {fitting:g} m would do (--cell {fitting:g})"
            rows, cols = self._form(fitting).shape
            if max(rows, cols) > MOST_CELLS:
                way_out += f", {rows}x{cols} of them; `serve` takes {MOST_CELLS} a side: cut the map for it"
        raise MapFileError(
            f"{self._path}: nowhere is enough to explore: {'; '.join(sentences)}. Expected a "
            f"region of at least {LEAST_SHARE:.0%} of the free cells, of which at most "
            f"{MOST_SEEN:.0%} is seen at once; {way_out}"
        )

    def _fitting(self, tried: list[float]) -> float | None:
        """The largest other size of a cell from which some start is playable."""
        resolution = self._occupancy.resolution
        for length in (*reversed(LARGE_CELLS_M), *CELLS_M, resolution):
            if length < resolution or length in tried:
                continue
            size = self._form(length)
            is_fine = min(size.shape) >= MIN_SIDE and max(size.shape) <= MAX_SIDE
            if is_fine and next(size.playable(), None) is not None:
                return length
        return None

    @cached_property
    def _pixels(self) -> _Cells:
        """The map in cells of a pixel."""
        return self._form(self._occupancy.resolution)

    def _form(self, cell: float) -> _Cells:
        return _Cells(_form_cells(self._occupancy, cell, self._inflation), self._point)


@dataclass(frozen=True)
class _Start:
    """The cell of a region that is nearest to a point.

    region    the region's number
    share     of all free cells that lie in it
    position  (row, col)
    """

    region: int
    share: float
    position: tuple[int, int]


class _Cells:
    """A map in cells of one size, and its regions from the one nearest to a point on."""

    def __init__(self, grid_map: GridMap, point: tuple[float, float]) -> None:
        self.map, self.terrain, self._point = grid_map, grid_map.terrain, point

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, cols = self.terrain.shape
        return rows, cols

    @cached_property
    def labels(self) -> NDArray[np.int32]:
        """The region of each cell, 0 where blocked."""
        return label_regions(~self.terrain)

    @cached_property
    def _sizes(self) -> NDArray[np.intp]:
        """The number of cells of each region; of 0 none."""
        counts = np.bincount(self.labels.reshape(-1))
        counts[0] = 0
        return counts

    def starts(self) -> Iterator[_Start]:
        """The start of each region, the nearest first."""
        rows, cols = np.nonzero(~self.terrain)  # from north to south, then from west to east
        x, y = self.map.middles(rows, cols)
        order = np.argsort(np.hypot(x - self._point[0], y - self._point[1]), kind="stable")
        _, first = np.unique(self.labels[rows, cols][order], return_index=True)
        for index in order[np.sort(first)]:
            yield self.start_at((int(rows[index]), int(cols[index])))

    def start_at(self, position: tuple[int, int]) -> _Start:
        """A free cell as a start."""
        region = int(self.labels[position])
        return _Start(region, self._sizes[region] / self._sizes.sum(), position)

    def playable(self) -> Iterator[_Start]:
        """The starts of the playable regions, the nearest first."""
        return (start for start in self.starts() if self.is_playable(start))

    def is_playable(self, start: _Start) -> bool:
        """Whether a start has enough cells, and enough of them unseen."""
        return start.share >= LEAST_SHARE and self.seen(start) <= MOST_SEEN

    def is_free(self, point: tuple[float, float]) -> bool:
        """Whether a point in metres lies in a free cell."""
        try:
            return not self.terrain[self.map.to_cell(*point)]
        except ValueError:
            return False

    def describe(self, start: _Start) -> str:
        """What a rover has from a start, in words."""
        cells, free = self._sizes[start.region], self._sizes.sum()
        noun = "cell" if free == 1 else "cells"
        return (
            f"{cells:,} of {free:,} free {noun} can be reached, and {self.seen(start):.0%} of "
            "what counts is seen at once"
        )

    def map_from(self, position: tuple[int, int]) -> GridMap:
        """The map with a start."""
        return replace(self.map, start=position)

    def seen(self, start: _Start) -> float:
        """The share of what counts that is seen at once from a start."""
        worlds = Worlds(self.map.config())
        worlds.start_on(0, self.terrain, start.position)
        return int(worlds.scalars[0, AT_START]) / int(worlds.scalars[0, CELLS])


def _form_cells(occupancy: Occupancy, cell: float, inflation: float) -> GridMap:
    """Cut a map into cells, as far as it is known; the start is none yet.

    The grid begins in the south-west, as the origin does. What lies beyond the picture is blocked.
    """
    height, width = occupancy.cells.shape
    resolution = occupancy.resolution
    is_known = occupancy.cells != UNKNOWN
    rows = _known_cells(is_known.any(axis=1)[::-1], resolution, cell)
    cols = _known_cells(is_known.any(axis=0), resolution, cell)
    if max(len(rows), len(cols)) > max(
        MAX_SIDE, *is_known.shape
    ):  # refused by the caller, in words
        return GridMap(np.ones((len(rows), len(cols)), np.bool_), cell, occupancy.origin, (0, 0))
    reach = inflation + resolution
    south, north = _pixels_of(rows, resolution, cell, height, reach)
    west, east = _pixels_of(cols, resolution, cell, width, reach)
    blocked = occupancy.cells[height - north : height - south, west:east][::-1] != FREE
    terrain = _overlapped(blocked, rows, south, resolution, cell)
    terrain = _overlapped(terrain.T, cols, west, resolution, cell).T
    if inflation > 0:
        terrain |= _near(blocked, (rows, cols), (south, west), resolution, cell, inflation)
    terrain[np.add(rows, 1) * cell > height * resolution + 1e-9] = True
    terrain[:, np.add(cols, 1) * cell > width * resolution + 1e-9] = True
    x, y, yaw = occupancy.origin
    dx, dy = cols[0] * cell, rows[0] * cell
    x, y = x + dx * math.cos(yaw) - dy * math.sin(yaw), y + dx * math.sin(yaw) + dy * math.cos(yaw)
    return GridMap(np.ascontiguousarray(terrain[::-1]), cell, (x, y, yaw), (0, 0))


def _known_cells(is_known: NDArray[np.bool_], resolution: float, cell: float) -> range:
    """The cells along one side from the first known to the last, and one more around.

    The additional cells are there only if the picture has them.
    """
    pixels = np.flatnonzero(is_known)
    first = math.floor(pixels[0] * resolution / cell + 1e-9)
    behind = math.ceil((pixels[-1] + 1) * resolution / cell - 1e-9)
    most = math.ceil(len(is_known) * resolution / cell - 1e-9)
    return range(max(first - 1, 0), min(behind + 1, most))


def _pixels_of(
    cells: range, resolution: float, cell: float, most: int, reach: float
) -> tuple[int, int]:
    """The first pixel along one side within reach of cells, and the one behind all."""
    first = math.floor((cells[0] * cell - reach) / resolution)
    behind = math.ceil(((cells[-1] + 1) * cell + reach) / resolution)
    return max(first, 0), min(behind, most)


def _overlapped(
    blocked: NDArray[np.bool_], cells: range, first: int, resolution: float, cell: float
) -> NDArray[np.bool_]:
    """Which cells along the first axis overlap a blocked pixel.

    `first` is the number of the first pixel there.
    """
    counts = np.zeros((len(blocked) + 1, blocked.shape[1]), np.int32)
    np.cumsum(blocked, axis=0, out=counts[1:])
    edges = np.array([*cells, cells[-1] + 1]) * (cell / resolution)
    lows = np.floor(edges[:-1] + 1e-9).astype(int) - first
    highs = np.ceil(edges[1:] - 1e-9).astype(int) - first
    overlapped: NDArray[np.bool_] = (
        counts[highs.clip(0, len(blocked))] > counts[lows.clip(0, len(blocked))]
    )
    return overlapped


def _near(
    blocked: NDArray[np.bool_],
    cells: tuple[range, range],
    first: tuple[int, int],
    resolution: float,
    cell: float,
    inflation: float,
) -> NDArray[np.bool_]:
    """Which cells lie within `inflation` metres of a blocked pixel beside a free one.

    Rows count from the south.
    """
    padded = np.pad(blocked, 1, constant_values=True)
    inner = padded[1:-1].copy()
    inner &= padded[:-2] & padded[2:]
    edge = blocked & ~(inner[:, 1:-1] & inner[:, :-2] & inner[:, 2:])
    at_row, at_col = np.nonzero(edge)
    south, west = (at_row + first[0]) * resolution, (at_col + first[1]) * resolution
    rows, cols = cells
    near = np.zeros((len(rows), len(cols)), np.bool_)
    low, high = 1e-9 - inflation, inflation - 1e-9
    reach = math.ceil((resolution + 2 * inflation) / cell) + 1
    first_row = np.floor((south + low) / cell).astype(int)
    first_col = np.floor((west + low) / cell).astype(int)
    for step_row in range(reach + 1):
        for step_col in range(reach + 1):
            r, c = first_row + step_row, first_col + step_col
            gap_y = np.maximum(0, np.maximum(r * cell - south - resolution, south - (r + 1) * cell))
            gap_x = np.maximum(0, np.maximum(c * cell - west - resolution, west - (c + 1) * cell))
            is_near = (r >= rows[0]) & (r <= rows[-1]) & (c >= cols[0]) & (c <= cols[-1])
            is_near &= np.hypot(gap_x, gap_y) <= inflation
            is_near &= (r * cell < south + resolution + high) & (
                c * cell < west + resolution + high
            )
            near[r[is_near] - rows[0], c[is_near] - cols[0]] = True
    return near
