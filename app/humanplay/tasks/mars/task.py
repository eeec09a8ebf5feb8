"""MarsExplorer as a task of the playground."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from humanplay.task import (
    Cause,
    Choice,
    Configuration,
    Policies,
    WantedBoard,
    WantedEpisode,
)
from humanplay.task.registration import Start
from humanplay.tasks.base import BaseTask
from humanplay.tasks.mars.compilation import Compilation
from humanplay.tasks.mars.environment import MarsEnvironment, environment
from humanplay.tasks.mars.messages import DRAWN_LEVELS, MAX_DRAWN_SIDE, NewEpisode, NewSession
from humanplay.tasks.mars.narrowing import own_config
from humanplay.tasks.mars.policies import PolicyCatalogue, check_file
from humanplay.tasks.mars.run import MarsRun
from humanplay.tasks.mars.terrains import GivenTerrain, MapCatalogue
from marsexplorer.config import ALL_LEVELS, MAP, EnvConfig
from marsexplorer.episode import Episode, unpack_terrain

if TYPE_CHECKING:
    from humanplay.tasks.mars.viewer3d.viewer import Viewer

SIDE = 21
"""Cells along a side of a terrain, unless another size is asked for."""
EXAMPLES = Path(__file__).with_name("levels.json")
"""A terrain of each level by its name: rocks as bits of rows. `python -m tests.support.level_examples` draws them."""


class Mars(BaseTask, MarsEnvironment):
    """MarsExplorer (`humanplay.task.Task`), with a server's policies and maps."""

    def __init__(
        self,
        policies: Policies,
        catalogue: MapCatalogue | None = None,
        compilation: Compilation | None = None,
    ) -> None:
        self.policies = policies
        self.catalogue = catalogue or MapCatalogue()
        self.compilation = compilation

    def viewer(self) -> Viewer:
        """Return a 3-D view (`humanplay.tasks.mars.viewer3d.viewer.Viewer`)."""
        from humanplay.tasks.mars.viewer3d.viewer import Viewer

        return Viewer()

    def is_getting_ready(self) -> bool:
        """Return whether kernels are being compiled that a board waits for."""
        return self.compilation is not None and self.compilation.is_running

    def close(self) -> None:
        """End the process that compiles; all else runs in the server."""
        if self.compilation is not None:
            self.compilation.close()

    def levels(self) -> list[dict[str, object]]:
        """Return the levels drawn from seeds; an example has its rocks as bits of rows."""
        examples = _examples()
        return [
            {
                "name": level.name,
                "summary": level.summary,
                "topology": level.topology,
                "morphology": level.morphology,
                "pays_bonus": level.has_bonus,
                "example": examples[level.name],
            }
            for level in (ALL_LEVELS[name] for name in DRAWN_LEVELS)
        ]

    def maps(self) -> list[dict[str, object]]:
        """Return the maps that the server was started with."""
        return self.catalogue.descriptions()

    def first(self, wanted: WantedBoard) -> Choice:
        """Return the terrain that a new session asks for; ValueError for an unknown map."""
        message = own_wanted(wanted)
        if message.map is not None:
            return self.catalogue.find(message.map)
        return Choice(EnvConfig.of(message.level or "random", message.size or SIDE), message.seed)

    def next(self, cause: Cause, wanted: WantedEpisode) -> Choice:
        """Return the next terrain: what is omitted stays, and a map is played again."""
        config, message = own_config(cause.config), own_wanted(wanted)
        if message.map is not None:
            return self.catalogue.find(message.map)
        if config.level == MAP and message.leaves_terrain:
            return self.again(cause)
        level = message.level or ("random" if config.level == MAP else config.level)
        size = config.size if max(config.size) <= MAX_DRAWN_SIDE else SIDE
        return Choice(EnvConfig.of(level, message.size or size), message.seed)

    def again(self, cause: Cause) -> Choice:
        """Return the terrain of an episode, to be played once more."""
        if cause.seed is not None:
            return Choice(cause.config, cause.seed)
        cells = unpack_terrain(cause.terrain, own_config(cause.config))
        return Choice(cause.config, None, GivenTerrain(cells, cause.start))

    def wanted_again(
        self,
        config: Configuration,
        wanted: WantedEpisode,
        player: str = "human",
        rival: str | None = None,
    ) -> NewSession:
        """Return the message that begins an episode of a configuration on a new board."""
        message = own_wanted(wanted)
        if message.map is not None:
            return NewSession(map=message.map, player=player, rival=rival)
        size = own_config(config).size
        return NewSession(
            level=config.level, size=size, seed=message.seed, player=player, rival=rival
        )

    def describe(self, cause: Cause) -> dict[str, object]:
        """Return `level`, `map` and `size` of an episode; a square's size is one number."""
        config = own_config(cause.config)
        size = config.rows if config.rows == config.cols else [config.rows, config.cols]
        return {"level": config.level, "map": self.catalogue.name_of(cause), "size": size}

    def begin(self, choice: Choice) -> MarsRun:
        """Return a run at its start; ValueError before a seed is drawn."""
        config, terrain = own_config(choice.config), choice.given
        if not isinstance(terrain, GivenTerrain):
            return MarsRun(Episode.begin(config, choice.seed))
        return MarsRun(Episode.begin(config, None, terrain.cells, terrain.start))


def own_wanted(wanted: WantedEpisode) -> NewEpisode:
    """What somebody wants as MarsExplorer's message; TypeError for another task's."""
    if not isinstance(wanted, NewEpisode):
        raise TypeError(f"expected what MarsExplorer is asked for, got a {type(wanted).__name__}")
    return wanted


@cache
def _examples() -> dict[str, list[int]]:
    """Return one stored terrain of each level; drawing them would compile every level."""
    examples: dict[str, list[int]] = json.loads(EXAMPLES.read_text())
    return examples


def serve(variant: str, start: Start) -> Mars:
    """The task of a server; LookupError, ValueError or OSError if a file is bad."""
    environment(variant)
    for path in start.policies:
        check_file(path)
    compilation = Compilation() if start.compiles_beside else None
    if compilation is not None:
        compilation.start()
    try:
        policies = start.loaded or PolicyCatalogue(start.policies)
        return Mars(policies, MapCatalogue.read(start.maps, start.cell_m), compilation)
    except Exception:
        # a process that goes on after a failed start compiles for itself again
        if compilation is not None:
            compilation.close()
        raise
