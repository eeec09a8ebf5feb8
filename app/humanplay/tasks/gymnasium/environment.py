"""A Gymnasium environment as a task: what its stored episodes need.

It is made by its id. It must have discrete actions, draw a picture or a text, and follow from its
seed and its actions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from functools import cached_property
from importlib.metadata import version as version_of
from typing import ClassVar, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from humanplay.board.messages import NewBoard, NewEpisode, ServerMessage
from humanplay.task import (
    About,
    Cause,
    Configuration,
    Messages,
    Metric,
    Policies,
    Record,
    Run,
    Texts,
)
from humanplay.tasks.base import BaseEnvironment, give_up, seed_of
from humanplay.tasks.gymnasium.about import about, texts_of
from humanplay.tasks.gymnasium.boards import BoardRun, Boards, boards_of, observations
from humanplay.tasks.gymnasium.codes import ActionCodes
from humanplay.tasks.gymnasium.configuration import GymnasiumConfig, own_config
from humanplay.tasks.gymnasium.description import (
    DEFAULT_LIMIT,
    MAX_LIMIT,
    actions_of,
    canonical,
    completed,
    described,
    keys_of,
    spec_of,
)
from humanplay.tasks.gymnasium.in_place import GoneEnvironment, RecordedRun
from humanplay.tasks.gymnasium.lock import GymnasiumLock
from humanplay.tasks.gymnasium.run import GymnasiumRun
from humanplay.tasks.policies import NoPolicies, ProcessPolicies

POLICIES = "humanplay.tasks.gymnasium.policies"
"""The module that plays them."""


class Frame(ServerMessage):
    """What a board shows; its figures are null where a study hides them."""

    kind: Literal["frame"]
    episode: str
    step: int
    picture: str | None = Field(description="a data URL; null where it is shown as text")
    text: str | None
    allowed: tuple[str, ...] | None = Field(
        description="the actions that may be chosen; null: all of them"
    )
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


class History(ServerMessage):
    """The headline metric after 0, 1, 2, ... moves."""

    kind: Literal["history"]
    episode: str
    headlines: list[float | None]


class GymnasiumEnvironment(BaseEnvironment):
    """The environment that a description names (`humanplay.task.Environment`)."""

    assets: ClassVar[str] = "picture"
    courses: ClassVar[None] = None  # no expert judges its moves; a replay shows its frames
    boards: ClassVar[None] = None
    messages: ClassVar[Messages] = Messages(NewBoard, NewEpisode, Frame, History)

    def __init__(self, text: str) -> None:
        self.description = completed(described(text))
        self.level, self._told = self.description.id, described(text).told
        spec_of(self.level)
        self.name = f"gymnasium:{self._told}"

    @property
    def _boards(self) -> Boards:
        """Where it steps."""
        return boards_of(self.name)

    @property
    def version(self) -> str:
        """The version that an episode replays with: those of the packages."""
        return self.description.versions

    @property
    def successes(self) -> frozenset[str]:
        """The outcomes that are successes: without a rule for them, ends by itself."""
        return frozenset({"succeeded" if self.description.success else "ended"})

    @cached_property
    def metrics(self) -> tuple[Metric, ...]:
        """The headline metric."""
        low, high = self.description.bounds
        return (Metric(self.description.score.removeprefix("info."), "", low, high, "higher"),)

    @property
    def actions(self) -> tuple[str, ...]:
        """The names of the actions, by their codes; ValueError if they are not discrete."""
        return tuple(self.keys)

    @cached_property
    def keys(self) -> Mapping[str, tuple[str, ...]]:
        """Action -> its default keys; none for one that cannot be chosen."""
        with closing(self.default.make(0)) as env:
            return keys_of(self.description, env, actions_of(self.description, env))

    @property
    def clock(self) -> int | None:
        """Ticks a second; None if each move is waited for."""
        return None if self.description.clock == "turns" else self.description.clock

    @cached_property
    def noop(self) -> int | None:
        """The action of a tick without a key: the description's `noop`, or one called so."""
        named = self.description.noop or "noop"
        return self.actions.index(named) if named in self.actions else None

    @cached_property
    def limit(self) -> int:
        """Moves after which an episode times out.

        The description's, else the environment's own, else DEFAULT_LIMIT.
        """
        if limit := self.description.max_steps or spec_of(self.level).max_episode_steps:
            return int(limit)
        with closing(self.description.make(self.description.kwargs, MAX_LIMIT, 0)) as env:
            limit = getattr(env.unwrapped, "max_steps", None)
        return limit if isinstance(limit, int) and 0 < limit <= MAX_LIMIT else DEFAULT_LIMIT

    @property
    def default(self) -> GymnasiumConfig:
        """The configuration that is played unless another is asked for."""
        return GymnasiumConfig(self._told, canonical(self.description.kwargs), self.limit)

    def configuration(self, values: Mapping[str, object]) -> GymnasiumConfig:
        """The configuration of `level`, `kwargs` and `max_steps`; none is required.

        Raises:
            ValueError, TypeError: If there is no such configuration.
        """
        fields = {"level": self.level, "kwargs": self.description.kwargs, **values}
        level, kwargs, limit = (fields.pop(name, None) for name in ("level", "kwargs", "max_steps"))
        if fields or level != self.level or not isinstance(kwargs, dict):
            raise ValueError(
                f"expected level {self.level!r}, kwargs and max_steps, got {canonical(dict(values))}"
            )
        limit = limit if "max_steps" in values else self.limit
        if not isinstance(limit, int) or not 0 < limit <= MAX_LIMIT:
            raise ValueError(
                f"max_steps must be a whole number from 1 to {MAX_LIMIT}, got {limit!r}"
            )
        return GymnasiumConfig(self._told, canonical(kwargs), limit)

    def gymnasium_env(self, config: Configuration) -> gymnasium.Env[object, object]:
        """A new environment."""
        return own_config(config).make()

    @cached_property
    def _codes(self) -> ActionCodes:
        """The codes of its actions."""
        with closing(self.default.make(0)) as env:
            return ActionCodes(self.level, env.action_space)

    def own_actions(
        self, config: Configuration, actions: bytes
    ) -> NDArray[np.int64] | NDArray[np.float64]:
        """The environment's own actions of the moves."""
        return np.array([self._codes.own(code) for code in actions])

    def code_of(self, action: object) -> int:
        """The code of the environment's own action; ValueError for none."""
        return self._codes.of_own(action)

    def returns(self, config: Configuration) -> tuple[float, float] | None:
        """The bounds of the score if it is the return and both are known; else None."""
        (low, high), score = self.description.bounds, self.description.score
        return None if low is None or high is None or score != "return" else (low, high)

    @property
    def requirements(self) -> tuple[str, ...]:
        """The packages of the environment, in the versions that are here."""
        return tuple(package.replace(" ", "==") for package in self.version.split(", "))

    @cached_property
    def policies(self) -> Policies:
        """Random actions, functions and files, each in a process of its own."""
        return ProcessPolicies(self.name, POLICIES)

    @cached_property
    def about(self) -> About:
        """What pages, reports and studies say of it."""
        return about(self.description, self.metrics[0].name)

    def texts(self, config: Configuration) -> Texts:
        """What pages, reports and studies say of a configuration."""
        return texts_of(own_config(config), self.about)

    @cached_property
    def lock(self) -> GymnasiumLock:
        """What computes it: packages, Python, system, processor."""
        return GymnasiumLock(self.name, self.description)

    def check_study(self, config: Configuration) -> None:
        """Raise ValueError if the environment cannot be made."""
        own_config(config).make().close()

    def prepare(self) -> None:
        """Start the process in which it steps.

        Raises:
            ValueError: If it cannot be played, or something it needs is not installed.
        """
        self._boards.preparer.guards()

    def run(self, config: Configuration, seed: int, actions: bytes = b"") -> GymnasiumRun:
        """A run after some actions, in a process of its own."""
        return BoardRun(self._boards, own_config(config), seed, actions, is_live=False)

    def observations(self, record: Record) -> Sequence[object]:
        """What was seen before each move and after the last."""
        boards, seed = self._boards, seed_of(record)
        return [*observations(boards, own_config(record.config), seed, record.actions)]


class InPlaceEnvironment(GymnasiumEnvironment):
    """An environment that a program stepped itself: its episodes are recordings."""

    def __init__(self, text: str) -> None:
        self.description = described(text)
        self.level, self._told = self.description.id, self.description.told
        self.name = f"gymnasium:{self._told}"

    @property
    def is_recorded(self) -> bool:
        """True."""
        return True

    @cached_property
    def keys(self) -> Mapping[str, tuple[str, ...]]:
        """The keys of its description, which names all of them."""
        return keys_of(self.description, None, self.description.actions)

    @property
    def limit(self) -> int:
        """Moves after which an episode times out."""
        return self.description.max_steps or DEFAULT_LIMIT

    def gymnasium_env(self, config: Configuration) -> gymnasium.Env[object, object]:
        """Its spaces: nothing can step it."""
        return GoneEnvironment(self.level)

    @cached_property
    def _codes(self) -> ActionCodes:
        return ActionCodes(self.level, GoneEnvironment(self.level).action_space)

    @property
    def requirements(self) -> tuple[str, ...]:
        """Gymnasium and NumPy: the environment itself is gone."""
        return tuple(f"{package}=={version_of(package)}" for package in ("gymnasium", "numpy"))

    @cached_property
    def policies(self) -> Policies:
        """None: no other process has the environment."""
        return NoPolicies()

    def check_study(self, config: Configuration) -> None:
        """Raise ValueError: nobody else could play it."""
        spec_of(self.level)

    def prepare(self) -> None:
        """Do nothing: it does not step."""

    def run(self, config: Configuration, seed: int, actions: bytes = b"") -> GymnasiumRun:
        """An episode as it was recorded; ValueError if it was not."""
        return RecordedRun(own_config(config), seed, actions)

    def replay(self, cause: Cause, actions: bytes = b"", ended: bool = False) -> Run:
        """The run of a stored episode as it was recorded."""
        config, seed = own_config(cause.config), seed_of(cause)
        run = RecordedRun(config, seed, actions, cause.trajectory_hash)
        if ended:
            give_up(cause, run)
        return run

    def observations(self, record: Record) -> Sequence[object]:
        """What was seen before each move and after the last."""
        # from the recording: there is no process to ask
        return BaseEnvironment.observations(self, record)


def environment(text: str) -> GymnasiumEnvironment:
    """The environment of a text that `described` takes; ValueError if there is none."""
    if described(text).is_in_place:
        return InPlaceEnvironment(text)
    return GymnasiumEnvironment(text)
