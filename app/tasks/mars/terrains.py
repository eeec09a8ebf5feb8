"""The terrain that an episode begins on: a seed's, or a given map's; and the maps on offer by name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.task import Cause, Choice
from app.tasks.mars.messages import DRAWN_LEVELS, MAX_API_SIDE, NewEpisode, NewSession
from marsexplorer.config import ALL_LEVELS, MAP, EnvConfig
from marsexplorer.episode import unpack_terrain
from marsexplorer.maps import CELL_M, read_map
from marsexplorer.terrain import generate
from marsexplorer.world import cells_that_count


@dataclass(frozen=True, eq=False)
class GivenTerrain:
    """A terrain that no seed draws.

    cells  bool[rows, cols], True where blocked
    start  (row, col) of a free cell
    """

    cells: NDArray[np.bool_]
    start: tuple[int, int]


@dataclass(frozen=True)
class OfferedMap:
    """A map that may be chosen by name."""

    name: str
    terrain: Choice

    @property
    def summary(self) -> str:
        """One sentence about it."""
        config = self.terrain.config
        return f"a map of {config.rows} × {config.cols} cells; what can be seen from where the rover can go counts"


class MapCatalogue:
    """The maps on offer by name, in the order given."""

    def __init__(self, maps: Iterable[OfferedMap] = ()) -> None:
        self._maps: dict[str, OfferedMap] = {}
        for each in maps:
            if each.name in self._maps:
                raise ValueError(f"two maps are called {each.name!r}; rename one of the files")
            self._maps[each.name] = each

    @classmethod
    def read(cls, paths: Iterable[Path], cell_m: float | None = None) -> MapCatalogue:
        """Return the maps of files, each under its file's name without suffix; ValueError for a file that is none.

        cell_m  side of a cell in metres; None for 0.5
        """
        return cls(_offered(path, cell_m or CELL_M) for path in paths)

    def offers(self) -> list[OfferedMap]:
        """Return what may be chosen."""
        return list(self._maps.values())

    def listed(self) -> list[dict[str, Any]]:
        """Return what may be chosen, as the API lists it."""
        offers = [(each, each.terrain.config) for each in self.offers()]
        return [
            {"name": each.name, "summary": each.summary, "size": [config.rows, config.cols]}
            for each, config in offers
        ]

    def name_of(self, row: Cause) -> str | None:
        """Return the name of the map that an episode is played on; None for a seed's terrain and a map not on offer."""
        if row.seed is not None:
            return None
        packed = ((each, each.terrain) for each in self._maps.values())
        return next((each.name for each, terrain in packed if _is_of(row, terrain)), None)

    def first_terrain(self, wanted: NewSession) -> Choice:
        """Return the terrain that a new session asks for; ValueError for an unknown map."""
        if wanted.map is not None:
            return self._find(wanted.map)
        return Choice(EnvConfig.of(wanted.level or "random", wanted.size or 21), wanted.seed)

    def next_terrain(self, was: Cause, wanted: NewEpisode) -> Choice:
        """Return the terrain of a session's next episode: what is left out stays as it was, so a map is played again."""
        if wanted.map is not None:
            return self._find(wanted.map)
        if was.config.level == MAP and wanted.leaves_terrain:
            return terrain_of(was)
        level = wanted.level or ("random" if was.config.level == MAP else was.config.level)
        return Choice(
            EnvConfig.of(level, wanted.size or (was.config.rows, was.config.cols)), wanted.seed
        )

    def _find(self, name: str) -> Choice:
        if name not in self._maps:
            offered = (
                f"choose one of: {', '.join(self._maps)}"
                if self._maps
                else "this server offers none (serve --map FILE.yaml)"
            )
            raise ValueError(f"no map {name!r}; {offered}")
        return self._maps[name].terrain


def levels_on_offer() -> list[dict[str, Any]]:
    """Return the levels whose terrains seeds draw, as the API lists them."""
    return [
        {
            "name": level.name,
            "summary": level.summary,
            "topology": level.topology,
            "morphology": level.morphology,
            "pays_bonus": level.has_bonus,
        }
        for level in (ALL_LEVELS[name] for name in DRAWN_LEVELS)
    ]


def terrain_of(row: Cause) -> Choice:
    """Return the terrain of an episode, to be played once more."""
    if row.seed is not None:
        return Choice(row.config, row.seed)
    cells = unpack_terrain(row.terrain, row.config)
    return Choice(row.config, None, GivenTerrain(cells, row.start))


@lru_cache(maxsize=64)
def cells_of_seed(config: EnvConfig, seed: int) -> int:
    """Return how many cells coverage refers to on the terrain of a seed: all, or those that can be discovered."""
    if not config.discoverable_only:
        return config.n
    return cells_that_count(config, generate(config, seed), (0, 0))


def _is_of(row: Cause, terrain: Choice) -> bool:
    given: GivenTerrain = terrain.given
    return (row.config, row.start) == (terrain.config, given.start) and row.terrain == np.packbits(
        given.cells
    ).tobytes()


def _offered(path: Path, cell_m: float) -> OfferedMap:
    found = read_map(path, cell_m)
    rows, cols = found.terrain.shape
    if max(rows, cols) > MAX_API_SIDE:
        raise ValueError(
            f"{path}: a board has at most {MAX_API_SIDE} cells a side, and this map has {rows}x{cols}; "
            "give a larger --cell, which makes fewer cells of it"
        )
    return OfferedMap(
        path.stem, Choice(found.config(), None, GivenTerrain(found.terrain, found.start))
    )
