"""MarsExplorer as a task of the playground."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from app.task import Cause, Choice, Decides
from app.tasks.mars.messages import NewEpisode, NewSession
from app.tasks.mars.policies import PolicyCatalogue
from app.tasks.mars.rules import MarsRules
from app.tasks.mars.run import MarsRun
from app.tasks.mars.terrains import GivenTerrain, MapCatalogue, levels_on_offer, terrain_of
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies.network import batch


@dataclass(frozen=True)
class Mars(MarsRules):
    """MarsExplorer (`app.task.Task`) with the policies and the maps that a server offers."""

    policies: PolicyCatalogue
    catalogue: MapCatalogue = field(default_factory=MapCatalogue)

    daily: ClassVar[EnvConfig] = EnvConfig.of("random", 21)
    decides: ClassVar[Decides] = batch

    def levels(self) -> list[dict[str, Any]]:
        """Return the levels whose terrains seeds draw."""
        return levels_on_offer()

    def maps(self) -> list[dict[str, Any]]:
        """Return the maps that the server was started with."""
        return self.catalogue.listed()

    def first(self, wanted: NewSession) -> Choice:
        """Return the terrain that a new session asks for; ValueError for an unknown map."""
        return self.catalogue.first_terrain(wanted)

    def next(self, was: Cause, wanted: NewEpisode) -> Choice:
        """Return the terrain of the next episode: what is left out stays as it was, so a map is played again."""
        return self.catalogue.next_terrain(was, wanted)

    def again(self, was: Cause) -> Choice:
        """Return the terrain of an episode, to be played once more."""
        return terrain_of(was)

    def wanted_again(self, config: EnvConfig, wanted: NewEpisode, **rest: Any) -> NewSession:
        """Return what begins an episode that is wanted, of a configuration, on a board of its own."""
        if wanted.map is not None:
            return NewSession(map=wanted.map, **rest)
        size = (config.rows, config.cols)
        return NewSession(level=config.level, size=size, seed=wanted.seed, **rest)

    def describe(self, was: Cause) -> dict[str, Any]:
        """Return `level`, `map` and `size` of an episode; its size is one number where it is square."""
        config: EnvConfig = was.config
        size = config.rows if config.rows == config.cols else [config.rows, config.cols]
        return {"level": config.level, "map": self.catalogue.name_of(was), "size": size}

    def begin(self, choice: Choice) -> MarsRun:
        """Return a run at its start; ValueError before a seed is drawn."""
        given: GivenTerrain | None = choice.given
        if given is None:
            return MarsRun(Episode.begin(choice.config, choice.seed))
        return MarsRun(Episode.begin(choice.config, None, given.cells, given.start))
