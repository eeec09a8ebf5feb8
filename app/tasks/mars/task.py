"""MarsExplorer as a task of the playground."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from app.task import Cause, Choice, Decides, Metric
from app.tasks.mars.messages import NewEpisode, NewSession
from app.tasks.mars.policies import PolicyCatalogue
from app.tasks.mars.run import MarsRun
from app.tasks.mars.terrains import GivenTerrain, MapCatalogue, terrain_of
from marsexplorer.config import ACTIONS, CORE_VERSION, EnvConfig
from marsexplorer.episode import Episode, Record, replay
from marsexplorer.policies.network import batch

KEYS: Mapping[str, tuple[str, ...]] = {
    "north": ("ArrowUp", "KeyW"),
    "east": ("ArrowRight", "KeyD"),
    "south": ("ArrowDown", "KeyS"),
    "west": ("ArrowLeft", "KeyA"),
}
"""The keys that all pages begin with."""
METRICS = (
    Metric("score", "", None, None, "higher"),
    Metric("coverage", "share of the cells that count", 0.0, 1.0, "higher"),
    Metric("steps to 99 %", "moves", 0.0, None, "lower"),
)
MAX_REPLAY_CELLS = 2_000_000
"""Most cells in the frames of one replay: beyond it some frames are left out."""


@dataclass(frozen=True)
class Mars:
    """MarsExplorer (`app.task.Task`) with the policies and the maps that a server offers."""

    policies: PolicyCatalogue
    maps: MapCatalogue = field(default_factory=MapCatalogue)

    name: ClassVar[str] = "mars"
    version: ClassVar[str] = CORE_VERSION
    actions: ClassVar[tuple[str, ...]] = tuple(ACTIONS)
    keys: ClassVar[Mapping[str, tuple[str, ...]]] = KEYS
    daily: ClassVar[EnvConfig] = EnvConfig.of("random", 21)
    metrics: ClassVar[tuple[Metric, ...]] = METRICS
    successes: ClassVar[frozenset[str]] = frozenset({"explored"})
    decides: ClassVar[Decides] = batch

    def first(self, wanted: NewSession) -> Choice:
        """Return the terrain that a new session asks for; ValueError for an unknown map."""
        return self.maps.first_terrain(wanted)

    def next(self, was: Cause, wanted: NewEpisode) -> Choice:
        """Return the terrain of the next episode: what is left out stays as it was, so a map is played again."""
        return self.maps.next_terrain(was, wanted)

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
        return {"level": config.level, "map": self.maps.name_of(was), "size": size}

    def begin(self, choice: Choice) -> MarsRun:
        """Return a run at its start; ValueError before a seed is drawn."""
        given: GivenTerrain | None = choice.given
        if given is None:
            return MarsRun(Episode.begin(choice.config, choice.seed))
        return MarsRun(Episode.begin(choice.config, None, given.cells, given.start))

    def replay(self, was: Cause, actions: bytes = b"", ended: bool = False) -> MarsRun:
        """Return the run of a stored episode after its actions; one that had ended without an ending move was abandoned."""
        outcome = "abandoned" if ended else "running"
        record = Record(
            was.config, was.seed, was.terrain, was.start, actions, outcome, 0.0, 0, 0, ""
        )
        return self.replay_record(record)

    def replay_record(self, record: Record) -> MarsRun:
        """Return the run of a record; ValueError where the core's version is another one."""
        return MarsRun(replay(record))

    def frames(self, record: Record, episode_id: str) -> list[dict[str, Any]]:
        """Return the frames of a finished episode from its start to its end; on large boards only every so many."""
        return frames(record, episode_id)


def frames(record: Record, episode_id: str) -> list[dict[str, Any]]:
    """Return the frames of a finished episode from its start to its end; on large boards only every so many."""
    config = record.config
    stride = max(1, -(-len(record.actions) * config.n // MAX_REPLAY_CELLS))
    run = MarsRun(Episode.begin(config, terrain=record.terrain_map(), start=record.start))
    texts = [run.view().frame(episode_id)]
    for number, action in enumerate(record.actions, 1):
        run.step(action)
        if number % stride == 0 or number == len(record.actions):
            texts.append(run.view().frame(episode_id))
    if record.outcome == "abandoned":
        texts.append(MarsRun(replay(record)).view().frame(episode_id))
    return [json.loads(each) for each in texts]
