"""The terrain that an episode begins on: a seed's, or a given map's; and the maps on offer by name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from humanplay.task import Cause, Choice
from humanplay.tasks.mars.messages import MAX_API_SIDE
from marsexplorer.maps import CELL_M, read_map


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
        """Return the maps of files, each under its file's name without suffix; ValueError for a file that is none.

        cell_m  side of a cell in metres; None for 0.5
        """
        return cls(_offered(path, cell_m or CELL_M) for path in paths)

    def listed(self) -> list[dict[str, Any]]:
        """Return what may be chosen, as the API lists it."""
        what = "a map of {} × {} cells; what can be seen from where the rover can go counts"
        sizes = [(name, (each.config.rows, each.config.cols)) for name, each in self._maps.items()]
        return [{"name": name, "summary": what.format(*of), "size": [*of]} for name, of in sizes]

    def name_of(self, row: Cause) -> str | None:
        """Return the name of the map that an episode is played on; None for a seed's terrain and a map not on offer."""
        if row.seed is not None:
            return None
        return next((name for name, terrain in self._maps.items() if _is_of(row, terrain)), None)

    def find(self, name: str) -> Choice:
        """Return the terrain of a map; ValueError where none on offer is called so."""
        if name not in self._maps:
            offered = f"choose one of: {', '.join(self._maps)}"
            none = "this server offers none (serve --map FILE.yaml)"
            raise ValueError(f"no map {name!r}; {offered if self._maps else none}")
        return self._maps[name]


def _is_of(row: Cause, terrain: Choice) -> bool:
    given: GivenTerrain = terrain.given
    packed = np.packbits(given.cells).tobytes()
    return (row.config, row.start, row.terrain) == (terrain.config, given.start, packed)


def _offered(path: Path, cell_m: float) -> tuple[str, Choice]:
    found = read_map(path, cell_m)
    rows, cols = found.terrain.shape
    if max(rows, cols) > MAX_API_SIDE:
        raise ValueError(
            f"{path}: a board has at most {MAX_API_SIDE} cells a side, and this map has {rows}x{cols}; "
            "give a larger --cell, which makes fewer cells of it"
        )
    return path.stem, Choice(found.config(), None, GivenTerrain(found.terrain, found.start))
