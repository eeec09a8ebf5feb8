"""The terrain that an episode begins on: a seed's, or a given map's; and the maps on offer by name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.play.messages import NewEpisode, NewSession
from app.play.validation import MAX_API_SIDE
from app.storage.store import Trial
from marsexplorer.config import MAP, EnvConfig
from marsexplorer.episode import Episode, unpack_terrain
from marsexplorer.maps import CELL_M, read_map


@dataclass(frozen=True)
class ChosenTerrain:
    """What an episode begins on: the terrain of `seed`, that of a seed still to be drawn, or a given map.

    cells  of a given map: bool[rows, cols], True where blocked; then `seed` is None
    start  (row, col) of a free cell
    """

    config: EnvConfig
    seed: int | None = None
    cells: NDArray[np.bool_] | None = None
    start: tuple[int, int] = (0, 0)

    @property
    def is_chosen(self) -> bool:
        """Return whether it was named beforehand, so that it never counts."""
        return self.seed is not None or self.cells is not None

    def begin(self) -> Episode:
        """Return an episode at its start; ValueError before a seed is drawn."""
        return Episode.begin(self.config, self.seed, self.cells, self.start)


@dataclass(frozen=True)
class OfferedMap:
    """A map that may be chosen by name."""

    name: str
    terrain: ChosenTerrain

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
    def read(cls, paths: Iterable[Path], cell_m: float = CELL_M) -> MapCatalogue:
        """Return the maps of files, each under its file's name without suffix; ValueError for a file that is none.

        cell_m  side of a cell in metres
        """
        return cls(_offered(path, cell_m) for path in paths)

    def offers(self) -> list[OfferedMap]:
        """Return what may be chosen."""
        return list(self._maps.values())

    def name_of(self, row: Trial) -> str | None:
        """Return the name of the map that an episode is played on; None for a seed's terrain and a map not on offer."""
        if row.seed is not None:
            return None
        packed = ((each, each.terrain) for each in self._maps.values())
        return next((each.name for each, terrain in packed if _is_of(row, terrain)), None)

    def first_terrain(self, wanted: NewSession) -> ChosenTerrain:
        """Return the terrain that a new session asks for; ValueError for an unknown map."""
        if wanted.map is not None:
            return self._find(wanted.map)
        return ChosenTerrain(EnvConfig.of(wanted.level or "random", wanted.size or 21), wanted.seed)

    def next_terrain(self, was: Trial, wanted: NewEpisode) -> ChosenTerrain:
        """Return the terrain of a session's next episode: what is left out stays as it was, so a map is played again."""
        if wanted.map is not None:
            return self._find(wanted.map)
        if was.config.level == MAP and wanted.leaves_terrain:
            return terrain_of(was)
        level = wanted.level or ("random" if was.config.level == MAP else was.config.level)
        return ChosenTerrain(
            EnvConfig.of(level, wanted.size or (was.config.rows, was.config.cols)), wanted.seed
        )

    def _find(self, name: str) -> ChosenTerrain:
        if name not in self._maps:
            offered = (
                f"choose one of: {', '.join(self._maps)}"
                if self._maps
                else "this server offers none (serve --map FILE.yaml)"
            )
            raise ValueError(f"no map {name!r}; {offered}")
        return self._maps[name].terrain


def terrain_of(row: Trial) -> ChosenTerrain:
    """Return the terrain of an episode, to be played once more."""
    if row.seed is not None:
        return ChosenTerrain(row.config, row.seed)
    return ChosenTerrain(row.config, None, unpack_terrain(row.terrain, row.config), row.start)


def _is_of(row: Trial, terrain: ChosenTerrain) -> bool:
    assert terrain.cells is not None
    return (row.config, row.start) == (
        terrain.config,
        terrain.start,
    ) and row.terrain == np.packbits(terrain.cells).tobytes()


def _offered(path: Path, cell_m: float) -> OfferedMap:
    found = read_map(path, cell_m)
    rows, cols = found.terrain.shape
    if max(rows, cols) > MAX_API_SIDE:
        raise ValueError(
            f"{path}: a board has at most {MAX_API_SIDE} cells a side, and this map has {rows}x{cols}; "
            "give a larger --cell, which makes fewer cells of it"
        )
    return OfferedMap(path.stem, ChosenTerrain(found.config(), None, found.terrain, found.start))
