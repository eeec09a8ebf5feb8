"""A Gymnasium environment's episodes: begun, stepped, replayed and shown as the environment's own picture.

The environment is made by its id. It must have discrete actions, draw `rgb_array` and follow from its seed and its actions.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version as version_of
from itertools import accumulate
from typing import Any, ClassVar, Literal

import gymnasium
import numpy as np
from pydantic import BaseModel, Field

from app.board.messages import NewBoard, NewEpisode
from app.task import Cause, Messages, Metric, Words

CHOICES: Mapping[str, tuple[str, ...]] = {
    "FrozenLake-v1": ("left", "down", "right", "up"),
    "FrozenLake8x8-v1": ("left", "down", "right", "up"),
}
"""The names of an environment's actions, by their codes; those of others are numbers."""
KEYS: Mapping[str, tuple[str, ...]] = {
    "left": ("ArrowLeft", "KeyA"),
    "down": ("ArrowDown", "KeyS"),
    "right": ("ArrowRight", "KeyD"),
    "up": ("ArrowUp", "KeyW"),
}
WORDS = Words(
    score="return",
    steps="moves to success",
    reached="succeeded",
    short="short of success",
    definition="An episode that does not succeed counts max_steps. The score is the return, the sum of all rewards.",
)
DEFAULT_LIMIT = 1000
"""Moves after which an episode times out where the environment sets no limit."""


@dataclass(frozen=True)
class GymnasiumConfig:
    """What `gymnasium.make` is given.

    level      the environment's id
    arguments  further ones, as canonical JSON
    limit      moves after which an episode times out
    """

    level: str
    arguments: str
    limit: int

    def to_dict(self) -> dict[str, Any]:
        """Return the values that `GymnasiumRules.configuration` takes."""
        kwargs = json.loads(self.arguments)
        return {"level": self.level, "kwargs": kwargs, "max_steps": self.limit}

    @cached_property
    def hash(self) -> str:
        """SHA-256 (hex) of the canonical JSON."""
        return hashlib.sha256(_canonical(self.to_dict()).encode()).hexdigest()

    def make(self) -> gymnasium.Env[Any, Any]:
        """Return a new environment; ValueError where something it needs is not installed or it refuses its arguments."""
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # pygame would look for a screen
        try:
            given = json.loads(self.arguments)
            return gymnasium.make(
                self.level, max_episode_steps=self.limit, render_mode="rgb_array", **given
            )
        except (gymnasium.error.Error, TypeError, ImportError) as error:
            raise ValueError(f"{self.level} cannot be made: {error}") from error


@dataclass(frozen=True)
class GymnasiumRecord:
    """The cause of an episode with what it came to (`app.task.Record`)."""

    config: GymnasiumConfig
    seed: int
    actions: bytes
    outcome: str
    total: float
    steps: int
    discovered: int
    trajectory_hash: str
    core_version: str
    terrain: bytes = b""
    start: tuple[int, int] = (0, 0)

    @property
    def score(self) -> float:
        """The return."""
        return self.total


class GymnasiumRun:
    """One running episode (`app.task.Run`).

    It has succeeded when it ends by itself with a reward above 0 and above all before: a pole that falls pays no more.
    """

    def __init__(self, config: GymnasiumConfig, seed: int) -> None:
        self.config, self.seed = config, seed
        self._env = config.make()
        self._observation, _ = self._env.reset(seed=seed)
        self._hash = hashlib.sha256(f"{config.hash}|{seed}|".encode())
        self._hash.update(_bytes(self._observation))
        self.actions, self._rewards = bytearray(), list[float]()
        self.outcome, self.total, self._most = "running", 0.0, 0.0

    def step(self, action: int) -> float:
        """Make one move and return its reward; RuntimeError once the episode has ended, ValueError for no action."""
        if self.outcome != "running":
            raise RuntimeError(f"the episode has ended ({self.outcome}); begin another one")
        if not self._env.action_space.contains(np.int64(action)):
            raise ValueError(f"expected an action of {self._env.action_space}, got {action}")
        self._observation, given, terminated, truncated, _ = self._env.step(action)
        reward = float(given)
        self.actions.append(action)
        self._rewards.append(reward)
        self.total += reward
        if terminated:
            self.outcome = "succeeded" if reward > self._most else "failed"
        elif truncated:
            self.outcome = "timed_out"
        self._most = max(self._most, reward)
        self._hash.update(f"|{action},{reward!r},{self.outcome}|".encode())
        self._hash.update(_bytes(self._observation))
        return reward

    def abandon(self) -> None:
        """Give up: the episode ends as one that was left, with the return so far."""
        self.outcome = "abandoned"

    def observation(self) -> Any:
        """Return a copy of what the environment shows a policy."""
        return np.copy(self._observation)

    def view(self) -> GymnasiumView:
        """Return what may be seen of the run as it stands."""
        return GymnasiumView(self, _picture(self._env.render()))

    def record(self) -> GymnasiumRecord:
        """Return the cause, with what it came to."""
        return GymnasiumRecord(
            self.config, self.seed, bytes(self.actions), self.outcome, self.total, len(self.actions),
            0, self._hash.hexdigest(), version(),
        )  # fmt: skip

    def rewards(self) -> Sequence[float]:
        """Return the reward of each move."""
        return self._rewards

    def counts(self) -> Sequence[int]:
        """Return zeros: nothing is discovered."""
        return [0] * (len(self._rewards) + 1)

    def place(self, step: int) -> Mapping[str, Any]:
        """Return nothing: an environment need not be a place."""
        return {}


class GymnasiumView:
    """What is seen of a run after some of its moves (`app.task.View`): its picture as it was then."""

    def __init__(self, run: GymnasiumRun, picture: str) -> None:
        rewards = run.rewards()
        self.steps, self.outcome, self.discovered = len(run.actions), run.outcome, 0
        self.ended, self.actions = run.outcome != "running", bytes(run.actions)
        self._reward, self._total = rewards[-1] if rewards else 0.0, run.total
        self._observation, self._picture = run.observation(), picture
        self._totals = [0.0, *accumulate(rewards)]

    def observation(self) -> Any:
        """Return a copy of what the environment shows a policy."""
        return np.copy(self._observation)

    def frame(self, episode_id: str, hides_scores: bool = False) -> str:
        """Return the frame as JSON text, with the picture as a data URL; its figures are null where they are hidden."""
        total = None if hides_scores else self._total
        frame = {
            "kind": "frame",
            "episode": episode_id,
            "step": self.steps,
            "picture": self._picture,
            "text": None,
            "reward": None if hides_scores else self._reward,
            "return": total,
            "score": total,
            "headline": total,
            "outcome": self.outcome if self.ended else None,
        }
        return json.dumps(frame, separators=(",", ":"))

    def history(self, episode_id: str) -> str:
        """Return the return after 0, 1, 2, ... moves, as JSON text: a picture has no path."""
        history = {"kind": "history", "episode": episode_id, "headlines": self._totals}
        return json.dumps(history, separators=(",", ":"))

    def expected(self, episode_id: str) -> str:
        """Return that nothing is expected to be discovered, as JSON text."""
        expected = {"kind": "expected", "episode": episode_id, "step": self.steps, "cells": []}
        return json.dumps(expected, separators=(",", ":"))


class Frame(BaseModel):
    """What a board shows; its figures are null where a study hides them."""

    kind: Literal["frame"]
    episode: str
    step: int
    picture: str = Field(description="a PNG as a data URL")
    text: str | None
    reward: float | None = Field(description="of the last move")
    return_: float | None = Field(alias="return", description="sum of the rewards")
    score: float | None
    headline: float | None
    outcome: Literal["succeeded", "failed", "timed_out", "abandoned"] | None


class History(BaseModel):
    """The return after 0, 1, 2, ... moves."""

    kind: Literal["history"]
    episode: str
    headlines: list[float]


class GymnasiumRules:
    """The rules of the environment with an id (`app.task.Rules`)."""

    successes: ClassVar[frozenset[str]] = frozenset({"succeeded"})
    assets: ClassVar[str] = "picture"
    messages: ClassVar[Messages] = Messages(NewBoard, NewEpisode, Frame, History)

    def __init__(self, level: str) -> None:
        try:
            spec = gymnasium.spec(level)
        except (gymnasium.error.Error, ImportError) as error:
            raise ValueError(f"Gymnasium knows no environment {level!r}: {error}") from error
        self.level, self._limit = level, spec.max_episode_steps or DEFAULT_LIMIT
        low, high = self.returns(self.default) or (None, None)
        self.metrics = (Metric("return", "", low, high, "higher"),)
        self.name, self.title, self.version = f"gymnasium:{level}", level, version()

    @cached_property
    def actions(self) -> tuple[str, ...]:
        """The names of the actions, by their codes; ValueError where they are not at most 10 from 0 on."""
        if self.level in CHOICES:
            return CHOICES[self.level]
        space = self.default.make().action_space
        if not isinstance(space, gymnasium.spaces.Discrete) or space.start != 0 or space.n > 10:
            raise ValueError(
                f"expected an environment with at most 10 discrete actions from 0 on, {self.level} has {space}: "
                "name another one as --task"
            )
        return tuple(str(code) for code in range(int(space.n)))

    @property
    def keys(self) -> Mapping[str, tuple[str, ...]]:
        """The default keys: arrows for directions, digits for numbers."""
        return {name: KEYS.get(name, (f"Digit{name}",)) for name in self.actions}

    @property
    def default(self) -> GymnasiumConfig:
        """What is played where nothing else is asked for."""
        return GymnasiumConfig(self.level, "{}", self._limit)

    def configuration(self, values: Mapping[str, Any]) -> GymnasiumConfig:
        """Return the configuration of `level`, `kwargs` and `max_steps`; ValueError or TypeError where they are none."""
        given = {"level": self.level, "kwargs": {}, "max_steps": self._limit, **values}
        if given["level"] != self.level or len(given) > 3 or not isinstance(given["kwargs"], dict):
            raise ValueError(
                f"expected level {self.level!r}, kwargs and max_steps, got {_canonical(dict(values))}"
            )
        limit = given["max_steps"]
        if not isinstance(limit, int) or not 0 < limit <= 100_000:
            raise ValueError(f"max_steps must be a whole number from 1 to 100000, got {limit!r}")
        return GymnasiumConfig(self.level, _canonical(given["kwargs"]), limit)

    def environment(self, config: GymnasiumConfig) -> Any:
        """Return a new environment."""
        return config.make()

    def observations(self, record: GymnasiumRecord) -> list[Any]:
        """Return what was seen before each move and after the last."""
        run = GymnasiumRun(record.config, record.seed)
        found = [run.observation()]
        for action in record.actions:
            run.step(action)
            found.append(run.observation())
        return found

    def returns(self, config: GymnasiumConfig) -> tuple[float, float] | None:
        """Return 0 and 1 where the environment pays a success alone, else None."""
        return (0.0, 1.0) if self.level in CHOICES else None

    words: ClassVar[Words] = WORDS
    courses: ClassVar[None] = None
    players: ClassVar[None] = None
    spread: ClassVar[str] = "a tenth and a fifth of the limit of moves, for want of anything better"
    own_labels: ClassVar[Mapping[str, str]] = {}

    def study(self, config: GymnasiumConfig) -> Mapping[str, Any]:
        """Return texts of a new study, and that it compares with no policy."""
        return {
            "title": f"How well do people play {self.title}? ({{name}})",
            "opening": f"You are invited to take part in a study of how well people play {self.title}. You play it with the "
            "keyboard or by touch, in your browser.",
            "questions": (),
            "policies": (),
            "debrief_policy": None,
            "assumed_player_sd": config.limit / 10,
            "assumed_episode_sd": config.limit / 5,
        }

    def placeholders(self, config: GymnasiumConfig) -> Mapping[str, Any]:
        """Return what texts may name of the environment."""
        return {"title": self.title}

    def where(self, config: GymnasiumConfig) -> str:
        """Return the environment's id, with its arguments where there are some."""
        return config.level if config.arguments == "{}" else f"{config.level} {config.arguments}"

    def design(self, config: GymnasiumConfig) -> str:
        """Return id, arguments and limit."""
        return f"`{self.where(config)}` of {self.version}, at most {config.limit} moves an episode."

    def minutes(self, config: GymnasiumConfig) -> float:
        """Return how long a person takes for an episode: half a second a move, and never more than two minutes."""
        return min(2.0, config.limit / 120)

    def bounds(self, config: GymnasiumConfig) -> tuple[float, float]:
        """Return the bounds of a mean return: 0 and 1 where the environment pays a success alone, else none."""
        return (0.0, 1.0) if self.level in CHOICES else (-math.inf, math.inf)

    def forfeited_score(self, was: Cause, outcome: str, total: float) -> float:
        """Return the lowest return that there is where that is known, else the return: giving up costs nothing more."""
        return min(total, lowest) if math.isfinite(lowest := self.bounds(was.config)[0]) else total

    def labels(self, was: Cause, counts: Sequence[int]) -> tuple[str, ...]:
        """Return nothing: what no effort looks like is not known."""
        return ()

    def check_study(self, config: GymnasiumConfig) -> None:
        """Raise ValueError where the environment cannot be made."""
        config.make().close()

    def prepare(self) -> None:
        """Make the environment and draw it once; ValueError where it has other actions, or what it needs is not installed."""
        _ = self.actions
        try:
            GymnasiumRun(self.default, 0).view()
        except gymnasium.error.DependencyNotInstalled as error:
            needs = "pip install 'marsexplorer-playground[gymnasium]'"
            said = f"{self.level} cannot be drawn: {error}; install it with: {needs}"
            raise ValueError(said) from error

    def drawn(self, config: GymnasiumConfig, seed: int) -> tuple[bytes, tuple[int, int]]:
        """Return no bytes: the instance is whatever the environment makes of the seed."""
        return b"", (0, 0)

    def instance_hash(self, was: Cause) -> str:
        """Return SHA-256 (hex) of configuration and seed."""
        return hashlib.sha256(f"{was.config.hash}:{was.seed}".encode()).hexdigest()

    def cells(self, was: Cause) -> int:
        """Return 0: nothing is discovered."""
        return 0

    def record(self, was: Cause, actions: bytes, came_to: Mapping[str, Any]) -> GymnasiumRecord:
        """Return the cause of a finished episode, ready to be replayed; ValueError for one without a seed."""
        return GymnasiumRecord(was.config, self._seed_of(was), actions, **came_to)

    def _seed_of(self, was: Cause) -> int:
        if was.seed is None:
            raise ValueError(f"an episode of {self.name} follows from its seed, and this has none")
        return was.seed

    def replay(self, was: Cause, actions: bytes = b"", ended: bool = False) -> GymnasiumRun:
        """Return the run of a stored episode after its actions; one that had ended without an ending move was abandoned."""
        run = GymnasiumRun(was.config, self._seed_of(was))
        for action in actions:
            run.step(action)
        if ended and run.outcome == "running":
            run.abandon()
        return run

    def replay_record(self, record: GymnasiumRecord) -> GymnasiumRun:
        """Return the run of a record; ValueError where the version is another one."""
        if record.core_version != self.version:
            raise ValueError(
                f"the episode was played under {record.core_version}, this is {self.version}"
            )
        return self.replay(record, record.actions, record.outcome == "abandoned")

    def frames(self, record: GymnasiumRecord, episode_id: str) -> list[dict[str, Any]]:
        """Return the frames of a finished episode from its start to its end."""
        run = GymnasiumRun(record.config, record.seed)
        views = [run.view()]
        for action in record.actions:
            run.step(action)
            views.append(run.view())
        if record.outcome == "abandoned":
            run.abandon()
            views.append(run.view())
        return [json.loads(view.frame(episode_id)) for view in views]


def rules(level: str) -> GymnasiumRules:
    """Return the rules of the environment with an id; ValueError where Gymnasium knows none."""
    return GymnasiumRules(level)


def version() -> str:
    """Return the version under which an episode replays: Gymnasium's."""
    return f"gymnasium {version_of('gymnasium')}"


def _canonical(value: Any) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def _bytes(observation: Any) -> bytes:
    """Return an observation as bytes that say its type and shape too."""
    if isinstance(observation, Mapping):
        return b"".join(str(key).encode() + _bytes(observation[key]) for key in sorted(observation))
    if isinstance(observation, tuple):
        return b"".join(map(_bytes, observation))
    if isinstance(observation, str):
        return observation.encode()
    array = np.asarray(observation)
    return f"{array.dtype.str}{array.shape}".encode() + array.tobytes()


def _picture(pixels: Any) -> str:
    """Return uint8[height, width, 3] as the data URL of a PNG."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels)).save(out, "PNG")
    return f"data:image/png;base64,{base64.b64encode(out.getvalue()).decode()}"
