"""The rules of MarsExplorer: how its stored episodes are read, replayed, checked and measured."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from app.task import Cause, Metric
from app.tasks.mars.messages import MAX_API_SIDE
from app.tasks.mars.run import MarsRun, compile_rules
from marsexplorer.config import ACTIONS, CORE_VERSION, EnvConfig
from marsexplorer.episode import Episode, Record, replay, unpack_terrain
from marsexplorer.terrain import generate
from marsexplorer.world import cells_that_count

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


class MarsRules:
    """MarsExplorer's part in reading what is stored (`app.task.Rules`)."""

    name: ClassVar[str] = "mars"
    title: ClassVar[str] = "MarsExplorer"
    assets: ClassVar[str] = "mars"
    version: ClassVar[str] = CORE_VERSION
    actions: ClassVar[tuple[str, ...]] = tuple(ACTIONS)
    keys: ClassVar[Mapping[str, tuple[str, ...]]] = KEYS
    metrics: ClassVar[tuple[Metric, ...]] = METRICS
    successes: ClassVar[frozenset[str]] = frozenset({"explored"})

    def configuration(self, values: Mapping[str, Any]) -> EnvConfig:
        """Return the configuration of plain values; ValueError or TypeError where they are none."""
        return EnvConfig(**values)

    def check_study(self, config: EnvConfig) -> None:
        """Raise ValueError unless all cells count and the board fits the page."""
        if config.discoverable_only:
            raise ValueError(
                f"a study's terrains are of the levels of the paper, of which all cells count; got {config.level!r}, "
                "where those count that can be discovered"
            )
        if max(config.rows, config.cols) > MAX_API_SIDE:
            raise ValueError(
                f"a study's boards have at most {MAX_API_SIDE} cells a side, got {config.rows}x{config.cols}"
            )

    def prepare(self) -> None:
        """Let the rules be compiled now: a moment where it has been done before, seconds else."""
        compile_rules()

    def drawn(self, config: EnvConfig, seed: int) -> tuple[bytes, tuple[int, int]]:
        """Return the packed terrain of a seed, and the north-west corner."""
        return _drawn(config, seed), (0, 0)

    def instance_hash(self, was: Cause) -> str:
        """Return SHA-256 (hex) of the shape and the packed bits: the same for two seeds that draw the same terrain."""
        shape = f"{was.config.rows}x{was.config.cols}:".encode()
        return hashlib.sha256(shape + was.terrain).hexdigest()

    def cells(self, was: Cause) -> int:
        """Return how many cells coverage refers to: all, or those that can be discovered."""
        config: EnvConfig = was.config
        if not config.discoverable_only:
            return config.n
        return _cells(config, was.terrain, was.start)

    def record(self, was: Cause, actions: bytes, came_to: Mapping[str, Any]) -> Record:
        """Return the cause of a finished episode, ready to be replayed."""
        return Record(was.config, was.seed, was.terrain, was.start, actions=actions, **came_to)

    def replay(self, was: Cause, actions: bytes = b"", ended: bool = False) -> MarsRun:
        """Return the run of a stored episode after its actions; one that had ended without an ending move was abandoned."""
        outcome = "abandoned" if ended else "running"
        came_to = {
            "outcome": outcome,
            "total": 0.0,
            "steps": 0,
            "discovered": 0,
            "trajectory_hash": "",
        }
        return self.replay_record(self.record(was, actions, came_to))

    def replay_record(self, record: Record) -> MarsRun:
        """Return the run of a record; ValueError where the core's version is another one."""
        return MarsRun(replay(record))

    def frames(self, record: Record, episode_id: str) -> list[dict[str, Any]]:
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


def rules(variant: str) -> MarsRules:
    """Return the rules; ValueError where a variant is named, since there is none."""
    if variant:
        raise ValueError(f"the task mars has no variants, got {variant!r}")
    return MarsRules()


@lru_cache(maxsize=1024)
def _drawn(config: EnvConfig, seed: int) -> bytes:
    return np.packbits(generate(config, seed)).tobytes()


@lru_cache(maxsize=1024)
def _cells(config: EnvConfig, terrain: bytes, start: tuple[int, int]) -> int:
    return cells_that_count(config, unpack_terrain(terrain, config), start)
