"""The rules of MarsExplorer: how its stored episodes are read, replayed, checked and measured."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

import marsexplorer  # noqa: F401  # registers the environment
from humanplay.task import Cause, Courses, Messages, Metric, Policies, Words, counted
from humanplay.tasks.mars.boards import MarsBoards
from humanplay.tasks.mars.messages import (
    MAX_API_SIDE,
    Course,
    Frame,
    History,
    Mistake,
    NewEpisode,
    NewSession,
)
from humanplay.tasks.mars.run import MarsRun
from marsexplorer.config import ACTIONS, CORE_VERSION, EnvConfig
from marsexplorer.episode import Episode, Record, replay, unpack_terrain
from marsexplorer.episode import score as score_of
from marsexplorer.evaluation.effort import QUANTILE, SHORTEST, makes_no_effort
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
"""Steps to 99 % on 441 cells, of episodes that reach it (`MarsRules.assumed`)."""
WORDS = Words(
    score="normalized score",
    steps="steps to 99 %",
    reached="reached 99 %",
    short="short of 99 %",
    definition="An episode that ends short of 99 % counts max_steps. The score is (return + r_invalid) / "
    "(r_invalid + r_bonus + cells), never clipped.",
)
OPENING = (
    "You are invited to take part in a study of how well people explore unknown terrain with a rover that sees only the "
    "cells around itself. You drive the rover with the keyboard or by touch, in your browser."
)
"""What a participant reads first."""
MAX_REPLAY_CELLS = 2_000_000
"""Most cells in the frames of one replay: beyond it some frames are left out."""


class MarsRules:
    """MarsExplorer's part in reading what is stored (`humanplay.task.Rules`)."""

    name: ClassVar[str] = "mars"
    title: ClassVar[str] = "MarsExplorer"
    instructions: ClassVar[str] = ""
    assets: ClassVar[str] = "mars"
    version: ClassVar[str] = CORE_VERSION
    messages: ClassVar[Messages] = Messages(NewSession, NewEpisode, Frame, History, Course, Mistake)
    actions: ClassVar[tuple[str, ...]] = tuple(ACTIONS)
    keys: ClassVar[Mapping[str, tuple[str, ...]]] = KEYS
    clock: ClassVar[None] = None
    noop: ClassVar[None] = None
    metrics: ClassVar[tuple[Metric, ...]] = METRICS
    successes: ClassVar[frozenset[str]] = frozenset({"explored"})

    def configuration(self, values: Mapping[str, Any]) -> EnvConfig:
        """Return the configuration of plain values; ValueError or TypeError where they are none."""
        return EnvConfig(**values)

    def environment(self, config: EnvConfig) -> Any:
        """Return the environment whose observations are uint8[rows, cols]."""
        names = ("level", "sensor_radius", "beta", "max_steps")
        given = {name: getattr(config, name) for name in names}
        given |= {"size": (config.rows, config.cols), "observation": "uint8"}
        return gymnasium.make("MarsExplorer-v0", **given, disable_env_checker=True)

    def observations(self, record: Record) -> list[NDArray[np.uint8]]:
        """Return what was seen before each move and after the last: uint8[rows, cols]."""
        again = Episode.again(record)
        found = [again.codes.copy()]
        for action in record.actions:
            again.step(action)
            found.append(again.codes.copy())
        return found

    def returns(self, config: EnvConfig) -> tuple[float, float]:
        """Return that of an invalid first move, and the theoretical maximum."""
        return float(-config.r_invalid), float(config.r_bonus + config.n)

    words: ClassVar[Words] = WORDS

    boards: ClassVar[MarsBoards] = MarsBoards()
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

    assumptions_in_words: ClassVar[str] = "those of synthetic players"
    label_texts: ClassVar[Mapping[str, str]] = {
        "no effort": f"no better explored than by random moves in {QUANTILE:.0%} of cases; "
        f"{SHORTEST:.1%} of the limit or longer"
    }

    def study(self, config: EnvConfig) -> Mapping[str, Any]:
        """Return texts and policies of a new study."""
        return {
            "title": "How well do people explore Mars? ({name})",
            "opening": OPENING,
            "things": "terrains",
            "questions": _questions(),
        }

    def assumed(self, config: EnvConfig, metric: str) -> Mapping[str, float]:
        """The mean and the spread that a new study assumes of people, by the protocol's fields.

        No measurement of people, of whom none has played yet: the synthetic players `mixed` of
        `python -m research.methods.assumed_spread`. Other sizes go by their number of cells.
        """
        scale = config.n / 441
        mean = ASSUMED_MEAN * scale
        sds = np.array([ASSUMED_PLAYER_SD, ASSUMED_TERRAIN_SD, ASSUMED_EPISODE_SD]) * scale
        digits = 1
        if (
            metric == "score"
        ):  # half a point a step, and what the first scan shows is not discovered
            most = config.r_invalid + config.r_bonus + config.n
            mean = 1 - (mean / 2 + np.pi / 4 * config.sensor_radius**2) / most
            sds, digits = sds / (2 * most), 4
        names = "assumed_mean", "assumed_player_sd", "assumed_terrain_sd", "assumed_episode_sd"
        return {
            name: round(float(number), digits)
            for name, number in zip(names, (mean, *sds), strict=True)
        }

    def placeholders(self, config: EnvConfig) -> Mapping[str, Any]:
        """Return what texts may name of a configuration."""
        size, share = {"rows": config.rows, "cols": config.cols}, f"{100 * config.beta:g} %"
        return {"coverage": share, "lidar_radius": config.sensor_radius, **size}

    def setting(self, config: EnvConfig) -> str:
        """Return level and size in words."""
        return f"level {config.level}, {config.rows} x {config.cols}"

    def observations_in_words(self, config: EnvConfig) -> str:
        """Say that a person's page and a policy's observation hold the same."""
        return "People and policies are given the same: the cells that were discovered."

    def briefing(self, config: EnvConfig) -> str:
        """Return what the rover sees, how it moves, and how an attempt ends."""
        share = "of what can be seen" if config.discoverable_only else "of all cells"
        return (
            f"A rover explores {config.rows} x {config.cols} cells that it does not know. It sees the free cells and the rock "
            f"in its line of sight, up to {config.sensor_radius} cells away. A move takes it one cell north, east, south or "
            f"west; a move into rock or off the map ends the attempt. The attempt is complete at {100 * config.beta:g} % "
            f"{share}, and over after {counted(config.limit, 'move')}. Map as much as you can in as few moves as you can."
        )

    def design(self, config: EnvConfig) -> str:
        """Return level, size, lidar and what is complete."""
        where = f"Level `{config.level}` at {config.rows}x{config.cols}"
        share = f"{100 * config.beta:g} % of the cells"
        return f"{where}, lidar radius {config.sensor_radius},\ncomplete at {share}."

    def minutes(self, config: EnvConfig) -> float:
        """Return how long a person takes for an episode: three quarters of a minute on 441 cells."""
        return config.n / 441 * 0.75

    def bounds(self, config: EnvConfig) -> tuple[float, float]:
        """Return the bounds of a mean score: a limit of fruitless moves that ends in a collision, and 1.

        Where only what can be discovered counts, that may be a single cell.
        """
        cells = 1 if config.discoverable_only else config.n
        return -0.5 * config.limit / (config.r_invalid + config.r_bonus + cells), 1.0

    def given_up_score(self, cause: Cause, outcome: str, total: float, score: float) -> float:
        """Return the score without the bonus, and with the penalty of leaving where none was paid: else its own."""
        if outcome not in ("explored", "timed_out"):
            return score
        total -= cause.config.r_bonus if outcome == "explored" else 0
        return score_of(cause.config, total - cause.config.r_invalid, self.cells(cause))

    def labels(self, was: Cause, counts: Sequence[int]) -> tuple[str, ...]:
        """Return `no effort` or nothing; counts are the cells known after each move."""
        return ("no effort",) if makes_no_effort(was.config, counts, self.cells(was)) else ()

    def lock(self) -> dict[str, Any]:
        """Return nothing: the version of the core says it, whose rules have no floating-point arithmetic that could differ."""
        return {}

    def lock_differences(self, lock: Mapping[str, Any]) -> str:
        """Return ""."""
        return ""

    def why_not_replayable(self, record: Record, rewards: Sequence[float]) -> str:
        """Return that another version's episode needs that version."""
        return f"{self.version} here: only the release that made it can simulate it"

    def examine(self, config: EnvConfig) -> None:
        """Do nothing: the tests have examined it."""

    def check_study(self, config: EnvConfig) -> None:
        """Raise ValueError unless all cells count and the board fits the page."""
        if config.discoverable_only:
            raise ValueError(
                f"a study's terrains are of the levels of the paper, of which all cells count; got {config.level!r}, "
                "where those count that can be discovered"
            )
        if max(config.rows, config.cols) > MAX_API_SIDE:
            got = f"got {config.rows}x{config.cols}"
            raise ValueError(f"a study's boards have at most {MAX_API_SIDE} cells a side, {got}")

    def prepare(self) -> None:
        """Let the rules be compiled now: a moment where it has been done before, seconds else."""
        step_once()

    def run(self, config: EnvConfig, seed: int, actions: bytes = b"") -> MarsRun:
        """Begin a run on the terrain of a seed, and make some moves."""
        run = MarsRun(Episode.begin(config, seed=seed))
        for action in actions:
            run.step(action)
        return run

    def instance(self, config: EnvConfig, seed: int) -> tuple[bytes, tuple[int, int]]:
        """Return the packed terrain of a seed, and the north-west corner."""
        return _drawn(config, seed), (0, 0)

    def instance_hash(self, was: Cause) -> str:
        """Return SHA-256 (hex) of the shape and the packed bits: the same for two seeds that draw the same terrain."""
        shape = f"{was.config.rows}x{was.config.cols}:".encode()
        return hashlib.sha256(shape + was.terrain).hexdigest()

    def cells(self, was: Cause) -> int:
        """Return how many cells coverage refers to: all, or those that can be discovered."""
        config: EnvConfig = was.config
        return _cells(config, was.terrain, was.start) if config.discoverable_only else config.n

    def record(self, was: Cause, actions: bytes, came_to: Mapping[str, Any]) -> Record:
        """Return the cause of a finished episode, ready to be replayed."""
        derived = {name: value for name, value in came_to.items() if name != "score"}
        return Record(was.config, was.seed, was.terrain, was.start, actions=actions, **derived)

    def replay(self, was: Cause, actions: bytes = b"", ended: bool = False) -> MarsRun:
        """Return the run of a stored episode after its actions; one that had ended without an ending move was abandoned."""
        cause = was.config, was.seed, was.terrain, was.start
        outcome = "abandoned" if ended else "running"
        return self.replay_record(Record(*cause, actions, outcome, 0.0, 0, 0, ""))

    def replay_record(self, record: Record) -> MarsRun:
        """Return the run of a record; ValueError where the core's version is another one."""
        return MarsRun(replay(record))

    def frames(self, record: Record, episode_id: str) -> list[dict[str, Any]]:
        """Return the frames of a finished episode from its start to its end; on large boards only every so many."""
        config = record.config
        stride = max(1, -(-len(record.actions) * config.n // MAX_REPLAY_CELLS))
        run = MarsRun(Episode.again(record))
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


def _questions() -> list[dict[str, Any]]:
    """Return three questions about the rules, as `protocol.Question` has them."""
    return [
        {
            "question": "What ends an episode at once?",
            "choices": [
                "Driving into a rock or off the edge",
                "Waiting for a minute",
                "Crossing my own track",
            ],
            "answer": 0,
            "why": "Not quite: there is no clock, and your own track is free ground. A rock or the edge ends an episode.",
        },
        {
            "question": "When is a terrain complete?",
            "choices": [
                "When the rover has driven over every cell",
                "When {coverage} of all cells have been mapped",
                "When the rover is back where it began",
            ],
            "answer": 1,
            "why": "Not quite: the rover need not drive everywhere; {coverage} seen by its lidar are enough.",
        },
        {
            "question": "Two people complete the same terrain, and know equally many cells. Who scores higher?",
            "choices": [
                "Whoever made more moves",
                "Whoever made fewer moves",
                "Both score the same",
            ],
            "answer": 1,
            "why": "Not quite: every move takes a little off the score, so whoever made fewer scores higher.",
        },
    ]
