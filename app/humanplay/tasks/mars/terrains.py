"""An episode's terrain, from a seed or a map, and the maps on offer by name."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from click import echo
from numpy.typing import NDArray

from humanplay.task import Cause, Choice
from humanplay.tasks.mars.narrowing import own_config
from marsexplorer.maps import MOST_CELLS, GridMap, MapFileError, MapWarning, read_map

MOST_MOVES = 20_000
"""Most moves on a map: two events a move, a key's down and up, leave a fifth of the 50,000 for others."""


@dataclass(frozen=True, eq=False)
class GivenTerrain:
    """A terrain that no seed draws.

    cells  bool[rows, cols], True where blocked
    start  (row, col) of a free cell
    """

    cells: NDArray[np.bool_]
    start: tuple[int, int]


class MapCatalogue:
    """The maps on offer by name, in the order given."""

    def __init__(self, maps: Iterable[tuple[str, Choice]] = ()) -> None:
        self._maps: dict[str, Choice] = {}
        for name, terrain in maps:
            if name in self._maps:
                raise ValueError(f"two maps are called {name!r}; rename one of the files")
            self._maps[name] = terrain

    @classmethod
    def read(cls, paths: Iterable[Path], cell_m: float | None = None) -> MapCatalogue:
        """Return the maps of files by their files' stems; ValueError for a bad file.

        cell_m  side of a cell in metres; None: as `read_map` chooses it
        """
        return cls(_read_offer(path, cell_m) for path in paths)

    def descriptions(self) -> list[dict[str, object]]:
        """Return what may be chosen, as the API lists it."""
        configs = {name: own_config(terrain.config) for name, terrain in self._maps.items()}
        return [
            {
                "name": name,
                "summary": f"a map of {config.rows} × {config.cols} cells; what can be seen from where the "
                "rover can go counts",
                "size": [config.rows, config.cols],
            }
            for name, config in configs.items()
        ]

    def name_of(self, row: Cause) -> str | None:
        """Return the name of an episode's map; None for a seed and a map not on offer."""
        if row.seed is not None:
            return None
        return next((name for name, terrain in self._maps.items() if _is_of(row, terrain)), None)

    def find(self, name: str) -> Choice:
        """Return the terrain of a map; ValueError where none on offer is called so."""
        if name not in self._maps:
            way_out = (
                f"choose one of: {', '.join(self._maps)}"
                if self._maps
                else "this server offers none (serve --map FILE.yaml)"
            )
            raise ValueError(f"no map {name!r}; {way_out}")
        return self._maps[name]


def _is_of(row: Cause, terrain: Choice) -> bool:
    terrain_given = terrain.given
    if not isinstance(terrain_given, GivenTerrain):
        return False
    packed = np.packbits(terrain_given.cells).tobytes()
    return (row.config, row.start, row.terrain) == (terrain.config, terrain_given.start, packed)


def open_map(path: Path, cell_m: float | None) -> GridMap:
    """Read a map file and print its cells and warnings; ValueError if it is not one.

    cell_m  side of a cell in metres; None: as `read_map` chooses it
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", MapWarning)
        grid_map = read_map(path, cell_m)
    for warning in caught:
        echo(f"warning: {warning.message}", err=True)
    rows, cols = grid_map.terrain.shape
    row, col = grid_map.start
    x, y = grid_map.to_metres(grid_map.start)
    echo(
        f"{path}: {rows} x {cols} cells of {grid_map.cell:g} m, start in row {row}, column {col}, at ({x:g}, {y:g}) m",
        err=True,
    )
    return grid_map


def _read_offer(path: Path, cell_m: float | None) -> tuple[str, Choice]:
    grid_map = open_map(path, cell_m)
    rows, cols = grid_map.terrain.shape
    if max(rows, cols) > MOST_CELLS:
        raise ValueError(
            f"{path}: a board has at most {MOST_CELLS} cells a side, and this map has {rows}x{cols}; "
            f"{_smaller_board(path)}"
        )
    config = grid_map.config()
    config = replace(config, max_steps=min(config.limit, MOST_MOVES))
    return path.stem, Choice(config, None, GivenTerrain(grid_map.terrain, grid_map.start))


def _smaller_board(path: Path) -> str:
    """The way out if a map's cells, as requested, make too large a board."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MapWarning)
            read_map(path)
    except MapFileError:  # larger cells leave nothing to explore
        return "cut it into maps that are smaller"
    return "leave --cell out, or give a larger one"
