"""MarsExplorer's rules: its stored episodes are read, replayed and checked here."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

import marsexplorer  # noqa: F401  # registers the environment
from humanplay import task
from humanplay.task import (
    About,
    Cause,
    Configuration,
    Courses,
    Ending,
    Messages,
    Metric,
    Policies,
    Texts,
)
from humanplay.tasks.base import BaseEnvironment, ExactLock
from humanplay.tasks.mars.about import ABOUT, texts_of
from humanplay.tasks.mars.boards import MarsBoards
from humanplay.tasks.mars.messages import (
    MAX_DRAWN_SIDE,
    Course,
    Frame,
    History,
    Mistake,
    NewEpisode,
    NewSession,
)
from humanplay.tasks.mars.narrowing import own_config, own_record
from humanplay.tasks.mars.run import MarsRun
from marsexplorer.config import ACTIONS, CORE_VERSION, EnvConfig
from marsexplorer.episode import Episode, Record, replay, unpack_terrain
from marsexplorer.episode import score as score_of
from marsexplorer.evaluation.effort import makes_no_effort
from marsexplorer.terrain import generate
from marsexplorer.warmup import step_once
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
ASSUMED_MEAN, ASSUMED_PLAYER_SD, ASSUMED_TERRAIN_SD, ASSUMED_EPISODE_SD = 118.0, 27.0, 12.0, 27.0
"""Steps to 99 % on 441 cells, of episodes that reach it (`MarsEnvironment.assumed`)."""
MAX_REPLAY_CELLS = 2_000_000
"""Most cells in the frames of one replay: beyond it some frames are left out."""


class MarsEnvironment(BaseEnvironment):
    """MarsExplorer's part in reading what is stored (`humanplay.task.Environment`)."""

    name: ClassVar[str] = "mars"
    about: ClassVar[About] = ABOUT
    lock: ClassVar[ExactLock] = ExactLock(CORE_VERSION)
    assets: ClassVar[str] = "mars"
    version: ClassVar[str] = CORE_VERSION
    messages: ClassVar[Messages] = Messages(NewSession, NewEpisode, Frame, History, Course, Mistake)
    actions: ClassVar[tuple[str, ...]] = tuple(ACTIONS)
    keys: ClassVar[Mapping[str, tuple[str, ...]]] = KEYS
    metrics: ClassVar[tuple[Metric, ...]] = METRICS
    successes: ClassVar[frozenset[str]] = frozenset({"explored"})

    def configuration(self, values: Mapping[str, object]) -> EnvConfig:
        """Return the configuration of plain values; ValueError or TypeError for others."""
        return EnvConfig.of_dict(values)

    def gymnasium_env(self, config: Configuration) -> gymnasium.Env[object, object]:
        """Return the environment whose observations are uint8[rows, cols]."""
        names = ("level", "sensor_radius", "beta", "max_steps")
        parameters = {name: getattr(config, name) for name in names}
        parameters |= {"size": config.size, "observation": "uint8"}
        return gymnasium.make("MarsExplorer-v0", **parameters, disable_env_checker=True)

    def observations(self, record: task.Record) -> list[NDArray[np.uint8]]:
        """Return what was seen before each move and after the last: uint8[rows, cols]."""
        again = Episode.again(own_record(record))
        observations = [again.codes.copy()]
        for action in record.actions:
            again.step(action)
            observations.append(again.codes.copy())
        return observations

    def returns(self, config: Configuration) -> tuple[float, float]:
        """Return that of an invalid first move, and the theoretical maximum."""
        settings = own_config(config)
        return float(-settings.r_invalid), float(settings.r_bonus + settings.n)

    boards: ClassVar[MarsBoards] = MarsBoards()
    expert: ClassVar[str] = "ppo"
    requirements: ClassVar[tuple[str, ...]] = ("humanplay[mars]",)

    @cached_property
    def courses(self) -> Courses:
        """What draws episodes and prices moves, loaded when it is asked for."""
        from humanplay.tasks.mars.courses import MarsCourses

        return MarsCourses()

    @cached_property
    def policies(self) -> Policies:
        """The shipped policies, loaded when they are asked for."""
        from humanplay.tasks.mars.policies import PolicyCatalogue

        return PolicyCatalogue()

    def texts(self, config: Configuration) -> Texts:
        """What pages, reports and studies say of a configuration."""
        return texts_of(own_config(config))

    def assumed(self, config: Configuration, metric: str) -> Mapping[str, float]:
        """The mean and spread that a new study assumes, by the protocol's fields.

        No measurement of people, of whom none has played yet: the synthetic players `mixed` of
        `python -m research.methods.assumed_spread`. Other sizes go by their number of cells.
        """
        settings = own_config(config)
        scale = settings.n / 441
        mean = ASSUMED_MEAN * scale
        sds = np.array([ASSUMED_PLAYER_SD, ASSUMED_TERRAIN_SD, ASSUMED_EPISODE_SD]) * scale
        digits = 1
        if (
            metric == "score"
        ):  # half a point a step, and what the first scan shows is not discovered
            most = settings.r_invalid + settings.r_bonus + settings.n
            mean = 1 - (mean / 2 + np.pi / 4 * settings.sensor_radius**2) / most
            sds, digits = sds / (2 * most), 4
        names = "assumed_mean", "assumed_player_sd", "assumed_terrain_sd", "assumed_episode_sd"
        return {
            name: round(float(number), digits)
            for name, number in zip(names, (mean, *sds), strict=True)
        }

    def bounds(self, config: Configuration) -> tuple[float, float]:
        """Return the least and the greatest mean score.

        The least is a limit of fruitless moves that ends in a collision; the greatest is 1.

        Where only what can be discovered counts, that may be a single cell.
        """
        settings = own_config(config)
        cells = 1 if settings.discoverable_only else settings.n
        return -0.5 * settings.limit / (settings.r_invalid + settings.r_bonus + cells), 1.0

    def given_up_score(self, cause: Cause, outcome: str, total: float, score: float) -> float:
        """The score by giving up instead: no bonus, and a penalty if there was none."""
        if outcome not in ("explored", "timed_out"):
            return score
        config = own_config(cause.config)
        total -= config.r_bonus if outcome == "explored" else 0
        return score_of(config, total - config.r_invalid, self.cells(cause))

    def labels(self, cause: Cause, counts: Sequence[int]) -> tuple[str, ...]:
        """Return `no effort` or nothing; counts are the cells known after each move."""
        config, cells = own_config(cause.config), self.cells(cause)
        return ("no effort",) if makes_no_effort(config, counts, cells) else ()

    def check_study(self, config: Configuration) -> None:
        """Raise ValueError unless all cells count and the board fits the page."""
        settings = own_config(config)
        if settings.discoverable_only:
            raise ValueError(
                f"a study's terrains are of the levels of the paper, of which all cells count; got {config.level!r}, "
                "where those count that can be discovered"
            )
        if max(settings.rows, settings.cols) > MAX_DRAWN_SIDE:
            got = f"got {settings.rows}x{settings.cols}"
            raise ValueError(f"a study's boards have at most {MAX_DRAWN_SIDE} cells a side, {got}")

    def prepare(self) -> None:
        """Compile the rules now: a moment if the cache has them, seconds otherwise."""
        step_once()

    def run(self, config: Configuration, seed: int, actions: bytes = b"") -> MarsRun:
        """Begin a run on the terrain of a seed, and make some moves."""
        run = MarsRun(Episode.begin(own_config(config), seed=seed))
        for action in actions:
            run.step(action)
        return run

    def instance(self, config: Configuration, seed: int) -> tuple[bytes, tuple[int, int]]:
        """Return the packed terrain of a seed, and the north-west corner."""
        return _draw(own_config(config), seed), (0, 0)

    def instance_hash(self, cause: Cause) -> str:
        """Return SHA-256 (hex) of shape and packed bits: equal terrains, equal hashes."""
        rows, cols = own_config(cause.config).size
        shape = f"{rows}x{cols}:".encode()
        return hashlib.sha256(shape + cause.terrain).hexdigest()

    def cells(self, cause: Cause) -> int:
        """Return how many cells coverage refers to: all, or those that can be discovered."""
        config = own_config(cause.config)
        return _cells(config, cause.terrain, cause.start) if config.discoverable_only else config.n

    def record(self, cause: Cause, actions: bytes, ending: Ending) -> Record:
        """Return the cause of a finished episode, ready to be replayed."""
        return Record(
            own_config(cause.config),
            cause.seed,
            cause.terrain,
            cause.start,
            actions,
            outcome=ending["outcome"],
            total=ending["total"],
            steps=ending["steps"],
            discovered=ending["discovered"],
            trajectory_hash=ending["trajectory_hash"],
            core_version=ending["core_version"],
        )

    def replay(self, cause: Cause, actions: bytes = b"", ended: bool = False) -> MarsRun:
        """Return the run of a stored episode after its actions.

        One that ended without an ending move was abandoned.
        """
        fields = own_config(cause.config), cause.seed, cause.terrain, cause.start
        outcome = "abandoned" if ended else "running"
        return self.replay_record(Record(*fields, actions, outcome, 0.0, 0, 0, ""))

    def replay_record(self, record: task.Record) -> MarsRun:
        """Return the run of a record; ValueError where the core's version is another one."""
        return MarsRun(replay(own_record(record)))

    def frames(self, record: task.Record, episode_id: str) -> list[dict[str, object]]:
        """Return an episode's frames from start to end, on large boards only some."""
        episode = own_record(record)
        stride = max(1, -(-len(episode.actions) * episode.config.n // MAX_REPLAY_CELLS))
        run = MarsRun(Episode.again(episode))
        texts = [run.view().frame(episode_id)]
        for number, action in enumerate(record.actions, 1):
            run.step(action)
            if number % stride == 0 or number == len(record.actions):
                texts.append(run.view().frame(episode_id))
        if record.outcome == "abandoned":
            texts.append(self.replay_record(record).view().frame(episode_id))
        return [json.loads(text) for text in texts]


def environment(variant: str) -> MarsEnvironment:
    """Return the rules; ValueError where a variant is named, since there is none."""
    if variant:
        raise ValueError(f"the task mars has no variants, got {variant!r}")
    return MarsEnvironment()


@lru_cache(maxsize=1024)
def _draw(config: EnvConfig, seed: int) -> bytes:
    return np.packbits(generate(config, seed)).tobytes()


@lru_cache(maxsize=1024)
def _cells(config: EnvConfig, terrain: bytes, start: tuple[int, int]) -> int:
    return cells_that_count(config, unpack_terrain(terrain, config), start)
