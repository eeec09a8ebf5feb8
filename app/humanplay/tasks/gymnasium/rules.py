"""A Gymnasium environment's episodes: begun, stepped, replayed and shown as the environment's own picture.

The environment is made by its id. It must have discrete actions, draw `rgb_array` and follow from its seed and its actions.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

import gymnasium
import numpy as np
from pydantic import Field

from humanplay.board.messages import NewBoard, NewEpisode, Sent
from humanplay.board.pictures import jpeg, png
from humanplay.task import Cause, Messages, Metric, Policies, Words, counted
from humanplay.tasks.gymnasium.description import (
    DEFAULT_LIMIT,
    MAX_LIMIT,
    Description,
    actions_of,
    canonical,
    completed,
    described,
    keys_of,
    spec_of,
)
from humanplay.tasks.gymnasium.doctor import examine
from humanplay.tasks.gymnasium.pictures import pixels_of
from humanplay.tasks.gymnasium.values import bytes_of, finite, plain
from humanplay.tasks.lock import differences, lock_of
from humanplay.tasks.policies import ProcessPolicies

MOST_FRAMES = 3000
"""Pictures of a replay, at most."""
POLICIES = "humanplay.tasks.gymnasium.policies"
"""The module that plays them."""
EXAMINED = 200
"""Moves on a seed that are compared before a study is frozen."""
FAILED = "environment_failed"
"""The outcome of an episode whose environment failed twice at the same move; it counts as one that was left there."""


@dataclass(frozen=True)
class GymnasiumConfig:
    """What `gymnasium.make` is given.

    told       what describes the environment (`Description.told`)
    arguments  further ones, as canonical JSON
    limit      moves after which an episode times out
    """

    told: str
    arguments: str
    limit: int

    @property
    def description(self) -> Description:
        """What is known of the environment."""
        return completed(described(self.told))

    @property
    def level(self) -> str:
        """The environment's id."""
        return described(self.told).id

    def to_dict(self) -> dict[str, Any]:
        """Return the values that `GymnasiumRules.configuration` takes."""
        kwargs = json.loads(self.arguments)
        return {"level": self.level, "kwargs": kwargs, "max_steps": self.limit}

    @cached_property
    def hash(self) -> str:
        """SHA-256 (hex) of the canonical JSON, with what describes the environment."""
        return hashlib.sha256(canonical([self.told, self.to_dict()]).encode()).hexdigest()

    def make(self, seed: int | None = None) -> gymnasium.Env[Any, Any]:
        """Return a new environment; ValueError where something it needs is not installed or it refuses its arguments."""
        given = json.loads(self.arguments)
        made: gymnasium.Env[Any, Any] = self.description.make(given, self.limit, seed)
        return made


@dataclass(frozen=True)
class GymnasiumRecord:
    """The cause of an episode with what it came to (`humanplay.task.Record`)."""

    config: GymnasiumConfig
    seed: int
    actions: bytes
    outcome: str
    total: float
    score: float
    steps: int
    discovered: int
    trajectory_hash: str
    core_version: str
    terrain: bytes = b""
    start: tuple[int, int] = (0, 0)


class GymnasiumRun:
    """One running episode (`humanplay.task.Run`) of an environment that is made for it and reset once.

    It has succeeded when it ends by the rule of its description; where there is none, one that ends by itself has `ended`.
    """

    is_live = False
    """Whether somebody waits for its pictures: then they are packed quickly, and larger."""

    def __init__(self, config: GymnasiumConfig, seed: int) -> None:
        self.config, self.seed = config, seed
        self._described = config.description
        self._env = config.make(seed)
        self._observation, self._info = self._env.reset(seed=seed)
        self._hash = hashlib.sha256(f"{config.hash}|{seed}|".encode())
        self._hash.update(bytes_of(self._observation))
        self.actions, self._rewards, self._scores = bytearray(), list[float](), list[float]()
        self.outcome, self.total = "running", 0.0
        self._scores.append(self._score(0.0))

    def step(self, action: int) -> float:
        """Make one move and return its reward; RuntimeError once the episode has ended.

        ValueError for no action, and where the environment tells a reward or a score that is not finite.
        """
        if self.outcome != "running":
            raise RuntimeError(f"the episode has ended ({self.outcome}); begin another one")
        if not self._env.action_space.contains(np.int64(action)):
            raise ValueError(f"expected an action of {self._env.action_space}, got {action}")
        self._observation, given, terminated, truncated, self._info = self._env.step(action)
        reward = float(given)
        self.total = finite("return", self.total + reward)
        self.actions.append(action)
        self._rewards.append(reward)
        self._scores.append(self._score(self._scores[-1]))
        if terminated or truncated or len(self.actions) >= self.config.limit:
            self.outcome = self._ending(bool(terminated))
        self._hash.update(f"|{action},{reward!r},{self.outcome}|".encode())
        self._hash.update(bytes_of(self._observation))
        return reward

    def _ending(self, terminated: bool) -> str:
        rule = self._described.success
        if rule.startswith("info."):
            is_success = bool(self._info.get(rule[5:]))
        elif rule:
            _, sign, bound = rule.split()
            is_success = self.total > float(bound) or (sign == ">=" and self.total == float(bound))
        else:
            is_success = False
        if is_success:
            return "succeeded"
        return ("failed" if rule else "ended") if terminated else "timed_out"

    def _score(self, before: float) -> float:
        """Return the headline so far: of a value in `info` the last that was told, 0 before the first."""
        name = self._described.score
        return self.total if name == "return" else finite(name, self._info.get(name[5:], before))

    def scores(self) -> Sequence[float]:
        """Return the headline metric after 0, 1, 2, ... moves."""
        return self._scores

    def abandon(self) -> None:
        """Give up: the episode ends as one that was left, with the score so far."""
        self.outcome = "abandoned"

    @property
    def ended(self) -> bool:
        """Whether the episode has an outcome."""
        return self.outcome != "running"

    def decide(self, choose: Callable[[Any, Mapping[str, Any]], int]) -> int:
        """Return what is chosen by what the environment shows a policy; ValueError where that is no action."""
        action = choose(self.observation(), self._info)
        if not self._env.action_space.contains(np.int64(action)):
            raise ValueError(f"expected an action of {self._env.action_space}, got {action}")
        return action

    @property
    def action_count(self) -> int:
        """How many actions there are."""
        return int(getattr(self._env.action_space, "n", 0))

    def observation(self) -> Any:
        """Return a copy of what the environment shows a policy."""
        return deepcopy(self._observation)

    def view(self) -> GymnasiumView:
        """Return what may be seen of the run as it stands."""
        shown = self._env.render()
        if isinstance(shown, str):
            return GymnasiumView(self, None, re.sub(r"\x1b\[[0-9;]*m", "", shown))
        pixels = pixels_of(shown)
        packed = jpeg(pixels) if self._described.codec == "jpeg" else png(pixels, self.is_live)
        return GymnasiumView(self, packed, None)

    def seen(self, picture: bool, observation: bool) -> dict[str, Any]:
        """Return picture or text, and the observation as numbers, texts, lists and objects."""
        shown = self.view() if picture else None
        given = plain(self._observation) if observation else None
        return {
            "picture": shown and shown.picture,
            "text": shown and shown.text,
            "observation": given,
        }

    @property
    def digest(self) -> str:
        """SHA-256 (hex) over configuration, seed, moves, rewards and observations."""
        return self._hash.hexdigest()

    def record(self) -> GymnasiumRecord:
        """Return the cause, with what it came to."""
        return GymnasiumRecord(
            self.config, self.seed, bytes(self.actions), self.outcome, self.total, self._scores[-1], len(self.actions),
            0, self.digest, self._described.versions,
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
    """What is seen of a run after some of its moves (`humanplay.task.View`): its picture as it was then.

    picture  a data URL, None for an environment that is shown as text
    """

    def __init__(self, run: GymnasiumRun, picture: str | None, text: str | None) -> None:
        rewards = run.rewards()
        self.steps, self.outcome, self.discovered = len(run.actions), run.outcome, 0
        self.ended, self.actions = run.outcome != "running", bytes(run.actions)
        self._reward, self._total = rewards[-1] if rewards else 0.0, run.total
        self._config, self._seed, self.picture, self.text = run.config, run.seed, picture, text
        self._scores = run.scores()  # which only grows
        self._score = self._scores[-1]

    def observation(self) -> tuple[GymnasiumConfig, int, bytes]:
        """Return what a policy's process is told (`policies`): the cause of the episode so far."""
        return self._config, self._seed, self.actions

    def frame(self, episode_id: str, hides_scores: bool = False) -> str:
        """Return the frame as JSON text, with the picture as a data URL; its figures are null where they are hidden."""
        score = None if hides_scores else self._score
        frame = {
            "kind": "frame",
            "episode": episode_id,
            "step": self.steps,
            "picture": self.picture,
            "text": self.text,
            "reward": None if hides_scores else self._reward,
            "return": None if hides_scores else self._total,
            "score": score,
            "headline": score,
            "outcome": self.outcome if self.ended else None,
        }
        return json.dumps(frame, separators=(",", ":"))

    def history(self, episode_id: str, hides_scores: bool = False) -> str:
        """Return the headline after 0, 1, 2, ... moves, null where hidden, as JSON text: a picture has no path."""
        count = self.steps + 1
        told = [None] * count if hides_scores else self._scores[:count]
        history = {"kind": "history", "episode": episode_id, "headlines": told}
        return json.dumps(history, separators=(",", ":"))


class Frame(Sent):
    """What a board shows; its figures are null where a study hides them."""

    kind: Literal["frame"]
    episode: str
    step: int
    picture: str | None = Field(description="a data URL; null where it is shown as text")
    text: str | None
    reward: float | None = Field(description="of the last move")
    return_: float | None = Field(alias="return", description="sum of the rewards")
    score: float | None = Field(
        description="what the description calls it: the return, or a value of info"
    )
    headline: float | None
    outcome: (
        Literal["succeeded", "failed", "ended", "timed_out", "abandoned", "environment_failed"]
        | None
    )


class History(Sent):
    """The headline metric after 0, 1, 2, ... moves."""

    kind: Literal["history"]
    episode: str
    headlines: list[float | None]


class GymnasiumRules:
    """The rules of the environment that a description tells of (`humanplay.task.Rules`)."""

    assets: ClassVar[str] = "picture"
    messages: ClassVar[Messages] = Messages(NewBoard, NewEpisode, Frame, History)

    def __init__(self, told: str) -> None:
        self.description = completed(described(told))
        self.level, self._told = self.description.id, described(told).told
        spec_of(self.level)
        self.name = f"gymnasium:{self._told}"
        self.title = self.description.title or self.level.rpartition(":")[2]
        self.instructions = self.description.instructions

    @property
    def version(self) -> str:
        """The version that an episode replays with: those of the packages."""
        return self.description.versions

    @property
    def successes(self) -> frozenset[str]:
        """The outcomes after which the moves count: successes, and where none is named, the ends that came by themselves."""
        return frozenset({"succeeded" if self.description.success else "ended"})

    @cached_property
    def metrics(self) -> tuple[Metric, ...]:
        """The headline metric."""
        low, high = self.description.bounds
        return (Metric(self.description.score.removeprefix("info."), "", low, high, "higher"),)

    @property
    def actions(self) -> tuple[str, ...]:
        """The names of the actions, by their codes; ValueError where they are not discrete."""
        return tuple(self.keys)

    @cached_property
    def keys(self) -> Mapping[str, tuple[str, ...]]:
        """The default keys: each action's, none for one that cannot be chosen."""
        with closing(self.default.make(0)) as env:
            return keys_of(self.description, env, actions_of(self.description, env))

    @property
    def clock(self) -> int | None:
        """Frames a second, None where each move is waited for."""
        return None if self.description.clock == "turns" else self.description.clock

    @cached_property
    def noop(self) -> int | None:
        """The action of a tick at which no key is held: `noop` of the description, else the one called so."""
        named = self.description.noop or "noop"
        return self.actions.index(named) if named in self.actions else None

    @cached_property
    def limit(self) -> int:
        """Moves after which an episode times out: the description's, the environment's own, else a thousand."""
        if said := self.description.max_steps or spec_of(self.level).max_episode_steps:
            return int(said)
        with closing(self.description.make(self.description.kwargs, MAX_LIMIT, 0)) as env:
            own = getattr(env.unwrapped, "max_steps", None)
        return own if isinstance(own, int) and 0 < own <= MAX_LIMIT else DEFAULT_LIMIT

    @property
    def default(self) -> GymnasiumConfig:
        """What is played where nothing else is asked for."""
        return GymnasiumConfig(self._told, canonical(self.description.kwargs), self.limit)

    def configuration(self, values: Mapping[str, Any]) -> GymnasiumConfig:
        """Return the configuration of `level`, `kwargs` and `max_steps`; ValueError or TypeError where they are none."""
        given = {"level": self.level, "kwargs": self.description.kwargs, **values}
        level, kwargs, limit = (given.pop(name, None) for name in ("level", "kwargs", "max_steps"))
        if given or level != self.level or not isinstance(kwargs, dict):
            said = f"expected level {self.level!r}, kwargs and max_steps"
            raise ValueError(f"{said}, got {canonical(dict(values))}")
        limit = limit if "max_steps" in values else self.limit
        if not isinstance(limit, int) or not 0 < limit <= MAX_LIMIT:
            said = f"max_steps must be a whole number from 1 to {MAX_LIMIT}"
            raise ValueError(f"{said}, got {limit!r}")
        return GymnasiumConfig(self._told, canonical(kwargs), limit)

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
        """Return the bounds of the score, where both are known and it is the return; else None."""
        (low, high), score = self.description.bounds, self.description.score
        return None if low is None or high is None or score != "return" else (low, high)

    boards: ClassVar[None] = None

    @property
    def requirements(self) -> tuple[str, ...]:
        """The packages of the environment, in the versions that are here."""
        return tuple(package.replace(" ", "==") for package in self.version.split(", "))

    @cached_property
    def policies(self) -> Policies:
        """Random actions, and policies of functions and files, each in a process of its own."""
        return ProcessPolicies(self.name, POLICIES)

    @property
    def words(self) -> Words:
        """What reports call its figures."""
        score, success = self.metrics[0].name, self.description.success
        what = "the sum of all rewards"
        if score != "return":
            what = f"the last {score!r} that the environment told"
        counts = "does not succeed" if success else "does not end by itself"
        definition = (
            f"An episode that {counts} counts max_steps. The score is the {score}, {what}. "
            "Where the environment itself failed, the episode counts as left at that move."
        )
        if success:
            definition += f" A success is {success}."
            return Words(score, "moves to success", "succeeded", "short of success", definition)
        return Words(score, "moves to the end", "ended by itself", "without an end", definition)

    courses: ClassVar[None] = None
    assumptions_in_words: ClassVar[str] = (
        "shares of the range of values, for want of anything better"
    )
    label_texts: ClassVar[Mapping[str, str]] = {}

    def study(self, config: GymnasiumConfig) -> Mapping[str, Any]:
        """Return texts of a new study, and that it compares with random actions."""
        return {
            "title": f"How well do people play {self.title}? ({{name}})",
            "things": "rounds",
            "opening": f"You are invited to take part in a study of how well people play {self.title}. You play it with the "
            "keyboard or by touch, in your browser.",
            "questions": (),
            "policies": ("random",),
            "debrief_policy": None,
        }

    def assumed(self, config: GymnasiumConfig, metric: str) -> Mapping[str, float]:
        """Half, a tenth, a tenth and a fifth of the range, for want of anything better; nothing without a range."""
        low, high = (0.0, float(config.limit)) if metric == "steps" else self.bounds(config)
        if not math.isfinite(high - low):
            return {}
        return {
            "assumed_mean": (low + high) / 2,
            "assumed_player_sd": (high - low) / 10,
            "assumed_terrain_sd": (high - low) / 10,
            "assumed_episode_sd": (high - low) / 5,
        }

    def placeholders(self, config: GymnasiumConfig) -> Mapping[str, Any]:
        """Return what texts may name of the environment."""
        return {"title": self.title}

    def setting(self, config: GymnasiumConfig) -> str:
        """Return the environment's id, with its arguments where there are some."""
        return config.level if config.arguments == "{}" else f"{config.level} {config.arguments}"

    def observations_in_words(self, config: GymnasiumConfig) -> str:
        """Return what people and agents see, where the description says it of these arguments."""
        seen, given = self.description.people_see, self.description.agents_see
        if not (seen or given) or config.arguments != canonical(self.description.kwargs):
            return ""
        people, agents = seen or "its picture", given or "its observation"
        same = "the same" if people == agents else agents
        return f"People see {people}; agents are given {same}."

    def briefing(self, config: GymnasiumConfig) -> str:
        """Return the description's instructions, or what is played and how it is scored."""
        return self.instructions or f"{self.setting(config)}. {self.words.definition}"

    def design(self, config: GymnasiumConfig) -> str:
        """Return id, arguments, versions, limit, and what people and agents see of it where that is said."""
        sees = f" {said}" if (said := self.observations_in_words(config)) else ""
        described = "" if self._told == self.level else f" It is described by `{self._told}`."
        time = f" Time runs at {self.clock} frames a second." if self.clock else ""
        most = counted(config.limit, "move")
        return f"`{self.setting(config)}` with {self.version}, at most {most} an episode.{time}{sees}{described}"

    def minutes(self, config: GymnasiumConfig) -> float:
        """Return how long a person takes for an episode: half a second a move, or a frame, and never more than two minutes."""
        return min(2.0, config.limit / (60 * self.clock if self.clock else 120))

    def bounds(self, config: GymnasiumConfig) -> tuple[float, float]:
        """Return the bounds of a mean score, infinite where none are known."""
        low, high = self.description.bounds
        return (-math.inf if low is None else low, math.inf if high is None else high)

    def given_up_score(self, cause: Cause, outcome: str, total: float, score: float) -> float:
        """The lowest score, if that is known; else the episode's own: giving up costs nothing more."""
        lowest, _ = self.bounds(cause.config)
        return min(score, lowest) if math.isfinite(lowest) else score

    def labels(self, was: Cause, counts: Sequence[int]) -> tuple[str, ...]:
        """Return nothing: what no effort looks like is not known."""
        return ()

    def check_study(self, config: GymnasiumConfig) -> None:
        """Raise ValueError where the environment cannot be made."""
        config.make().close()

    def lock(self) -> dict[str, Any]:
        """Return Gymnasium's own description of the environment, and what this machine computes it with."""
        try:
            spec = json.loads(spec_of(self.level).to_json())
        except (TypeError, ValueError, AttributeError):  # of an entry point that is no text
            spec = str(spec_of(self.level))
        lock = lock_of(tuple(self.description.packages))
        own = {
            name: {"version": hash[:12], "record": hash}
            for name, hash in self.description.sources.items()
        }
        return {"spec": canonical(spec), **lock, "packages": {**lock["packages"], **own}}

    def lock_differences(self, lock: Mapping[str, Any]) -> str:
        """Return what is here instead of what was there."""
        return ", ".join(differences(lock, self.lock()))

    def why_not_replayable(self, record: GymnasiumRecord, rewards: Sequence[float]) -> str:
        """Return how another version's episode, with its rewards, differs when it is played with what is here."""
        played = dict(each.rsplit(" ", 1) for each in record.core_version.split(", "))
        here = dict(each.rsplit(" ", 1) for each in self.version.split(", "))
        said = f"cannot be simulated here: {', '.join(differences(played, here))}"
        run = GymnasiumRun(record.config, record.seed)
        for step, (action, reward) in enumerate(zip(record.actions, rewards, strict=True), 1):
            if run.ended or run.step(action) != reward:
                return f"{said}; first difference at step {step}"
        run = self._given_up(record, run)
        is_same = (run.outcome, run.digest) == (record.outcome, record.trajectory_hash)
        return f"{said}; {'no difference' if is_same else 'other observations'} in {counted(len(rewards), 'step')}"

    def examine(self, config: GymnasiumConfig) -> None:
        """Raise ValueError where fresh processes play episodes of `EXAMINED` moves on each of five seeds differently."""
        found = examine(self.name, steps=EXAMINED, config=config.to_dict())
        if found.differences:
            way = "mend the environment or name a wrapper that does; `humanplay doctor` says more"
            raise ValueError(f"{found.verdict}; {way}")

    def prepare(self) -> None:
        """Make the environment and draw it once; ValueError where it has other actions, or what it needs is not installed."""
        _ = self.actions
        try:
            GymnasiumRun(self.default, 0).view()
        except gymnasium.error.DependencyNotInstalled as error:
            # the error names the line that suits the installed Gymnasium
            raise ValueError(f"{self.level} cannot be drawn: {error}") from error

    def instance(self, config: GymnasiumConfig, seed: int) -> tuple[bytes, tuple[int, int]]:
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
        run = self.run(was.config, self._seed_of(was), actions)
        return self._given_up(was, run) if ended else run

    def run(self, config: GymnasiumConfig, seed: int, actions: bytes = b"") -> GymnasiumRun:
        """Return a run after some actions."""
        run = GymnasiumRun(config, seed)
        for action in actions:
            run.step(action)
        return run

    def _given_up(self, was: Cause, run: GymnasiumRun) -> GymnasiumRun:
        """Return the run of an episode that is over, ended as the episode was where no move ended it."""
        if run.outcome == "running":
            run.abandon()
            if getattr(was, "outcome", None) == FAILED:
                run.outcome = FAILED
        return run

    def replay_record(self, record: GymnasiumRecord) -> GymnasiumRun:
        """Return the run of a record; ValueError where the version is another one."""
        if (then := record.core_version) != self.version:
            raise ValueError(f"the episode was played under {then}, this is {self.version}")
        return self.replay(record, record.actions, True)

    def frames(self, record: GymnasiumRecord, episode_id: str) -> list[dict[str, Any]]:
        """Return the frames of a finished episode from its start to its end; of a long one only every so many."""
        run = self.run(record.config, record.seed)
        views, every = [run.view()], 1 + len(record.actions) // MOST_FRAMES
        for step, action in enumerate(record.actions, 1):
            run.step(action)
            if step % every == 0 or step == len(record.actions):
                views.append(run.view())
        if run.outcome == "running":
            views.append(self._given_up(record, run).view())
        return [json.loads(view.frame(episode_id)) for view in views]


def rules(told: str) -> GymnasiumRules:
    """Return the rules of an environment by what describes it; ValueError where there is none."""
    return GymnasiumRules(told)
