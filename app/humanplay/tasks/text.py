"""Configuration, run, view, messages and environment of a world shown as a text.

The world adds what a move does and what is seen of it: `examples/worlds/maze` is one.
"""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import ClassVar, Literal, NoReturn

from pydantic import Field

from humanplay.board.messages import NewBoard, NewEpisode, ServerMessage
from humanplay.task import (
    About,
    AgentObservation,
    Allowed,
    Configuration,
    Lock,
    Messages,
    Metric,
    Policy,
    Texts,
)
from humanplay.tasks.base import BaseEnvironment, CodePolicies, EpisodeRecord, frame_text

Cell = tuple[int, int]
"""Row and column."""


@dataclass(frozen=True)
class TextConfig:
    """A configuration whose fields are its settings (`humanplay.task.Configuration`).

    level  its kind in a word
    limit  moves after which an episode times out, a field
    size   (rows, cols); None without a grid
    """

    level: ClassVar[str]
    size: ClassVar[Cell | None] = None
    limit: int

    def to_dict(self) -> dict[str, object]:
        """The values that `configuration` takes."""
        return asdict(self)

    @cached_property
    def hash(self) -> str:
        """SHA-256 (hex) of the canonical JSON."""
        return hashlib.sha256(json.dumps(self.to_dict(), sort_keys=True).encode()).hexdigest()


class TextRun(ABC):
    """A running episode (`humanplay.task.Run`); a world defines moves and views.

    config, seed  its cause; `actions` are the moves so far, one byte each
    outcome       "running" until the world or the limit ends it
    score         the headline so far
    discovered    the count that is stored with each move; 0 if nothing is discovered
    cell          where the player stands
    """

    names: ClassVar[tuple[str, ...]]
    """The actions."""
    version: ClassVar[str]
    """What recorded episodes replay with."""
    outcome, score, discovered, cell = "running", 0.0, 0, (0, 0)

    def __init__(self, config: TextConfig, seed: int) -> None:
        self.config, self.seed = config, seed
        self.actions, self._rewards = bytearray(), list[float]()
        self.begin()
        self._counts, self.way, self._scores = [self.discovered], [self.cell], [self.score]

    @abstractmethod
    def begin(self) -> None:
        """Set up what the world keeps, before the first move."""

    @abstractmethod
    def move(self, action: int) -> float:
        """Make a move and return its reward; `outcome` is set if it ends the episode."""

    @abstractmethod
    def observation(self) -> str:
        """What people and policies see."""

    @property
    def ended(self) -> bool:
        """Whether the episode has an outcome."""
        return self.outcome != "running"

    def step(self, action: int) -> float:
        """Make one move; RuntimeError after the end, ValueError for an unknown action."""
        if self.ended:
            raise RuntimeError(f"the episode has ended ({self.outcome}); begin another one")
        if action not in range(len(self.names)):
            raise ValueError(f"expected an action from 0 to {len(self.names) - 1}, got {action}")
        self.actions.append(action)
        self._rewards.append(self.move(action))
        if not self.ended and len(self.actions) == self.config.limit:
            self.outcome = "timed_out"
        self._counts.append(self.discovered)
        self.way.append(self.cell)
        self._scores.append(self.score)
        return self._rewards[-1]

    def abandon(self) -> None:
        """Give up; a world may lower its score here."""
        self.outcome = "abandoned"

    def rewards(self) -> Sequence[float]:
        """The reward of each move."""
        return self._rewards

    def headlines(self) -> Sequence[float]:
        """The score after 0, 1, 2, ... moves; the last one as it stands."""
        return [*self._scores[:-1], self.score]

    def counts(self) -> Sequence[int]:
        """What was discovered after 0, 1, 2, ... moves."""
        return self._counts

    def allowed(self) -> Sequence[Allowed]:
        """Nothing: every action may always be chosen."""
        return ()

    def place(self, step: int) -> Mapping[str, float]:
        """Nothing: the exported moves have no further columns."""
        return {}

    def view(self) -> TextView:
        """What may be seen of the run as it stands."""
        return TextView(self)

    def agent_observation(self, picture: bool, observation: bool) -> AgentObservation:
        """What an agent may see: the text."""
        text = self.observation()
        return {
            "picture": None,
            "text": text if picture else None,
            "observation": text if observation else None,
            "allowed": None,
        }

    def record(self) -> EpisodeRecord:
        """The cause with what it came to."""
        cause = [self.config.hash, self.seed, list(self.actions), self.outcome]
        return EpisodeRecord(
            self.config,
            self.seed,
            bytes(self.actions),
            self.outcome,
            total=sum(self._rewards),
            score=self.score,
            steps=len(self.actions),
            discovered=self.discovered,
            trajectory_hash=hashlib.sha256(json.dumps(cause).encode()).hexdigest(),
            core_version=self.version,
        )


class TextView:
    """What may be seen of a run as it stood (`humanplay.task.View`)."""

    allowed: Allowed = None

    def __init__(self, run: TextRun) -> None:
        self.steps, self.ended, self.outcome = len(run.actions), run.ended, run.outcome
        self.discovered, self.actions = run.discovered, bytes(run.actions)
        self._text, self._way = run.observation(), tuple(run.way)
        self._rewards, self._scores = tuple(run.rewards()), tuple(run.headlines())

    def observation(self) -> str:
        """The text."""
        return self._text

    def frame(self, episode_id: str, hides_scores: bool = False) -> str:
        """The text with its figures, which are null where they are hidden."""
        shown = {"picture": None, "text": self._text}
        figures = (0.0, *self._rewards)[-1], sum(self._rewards), self._scores[-1]
        return frame_text(self, episode_id, shown, figures, hides_scores)

    def history(self, episode_id: str, hides_scores: bool = False) -> str:
        """The way so far."""
        headlines = [None for _ in self._scores] if hides_scores else self._scores
        history = {"kind": "history", "episode": episode_id, "headlines": headlines}
        return json.dumps({**history, "cells": self._way}, separators=(",", ":"))


class Frame(ServerMessage):
    """What a board shows; its figures are null where a study hides them."""

    kind: Literal["frame"]
    episode: str
    step: int
    picture: None
    text: str
    reward: float | None = Field(description="of the last move")
    return_: float | None = Field(alias="return", description="sum of the rewards")
    score: float | None
    headline: float | None
    outcome: str | None


class History(ServerMessage):
    """The score and the cell after 0, 1, 2, ... moves."""

    kind: Literal["history"]
    episode: str
    headlines: list[float | None]
    cells: list[Cell]


class TextEnvironment(BaseEnvironment, ABC):
    """An environment shown as a text (`humanplay.task.Environment`).

    name            of the task; `assets` is the folder that draws it
    run_of          its kind of `TextRun`
    policy_classes  its policies, which see what people see, the expert first
    """

    name: ClassVar[str]
    assets: ClassVar[str]
    about: ClassVar[About]
    lock: ClassVar[Lock]
    keys: ClassVar[Mapping[str, tuple[str, ...]]]
    metrics: ClassVar[tuple[Metric, ...]]
    run_of: ClassVar[type[TextRun]]
    policy_classes: ClassVar[tuple[Callable[[], Policy], ...]]
    messages = Messages(NewBoard, NewEpisode, Frame, History)
    successes = frozenset({"succeeded"})
    requirements = ("humanplay",)

    @abstractmethod
    def configuration(self, values: Mapping[str, object]) -> TextConfig:
        """A configuration of some settings; ValueError for others."""

    @abstractmethod
    def texts(self, config: Configuration) -> Texts:
        """What pages, reports and studies say of a configuration."""

    @property
    def version(self) -> str:
        """What recorded episodes replay with."""
        return self.run_of.version

    @property
    def actions(self) -> tuple[str, ...]:
        """Their names, by their codes."""
        return self.run_of.names

    @cached_property
    def policies(self) -> CodePolicies:
        """Its own, and `random`."""
        return CodePolicies(self, self.policy_classes, lambda frame: frame["text"])

    def run(self, config: Configuration, seed: int, actions: bytes = b"") -> TextRun:
        """A run after some moves."""
        if not isinstance(config, TextConfig):
            raise TypeError(f"expected settings of {self.name}, got a {type(config).__name__}")
        run = self.run_of(config, seed)
        for action in actions:
            run.step(action)
        return run

    def gymnasium_env(self, config: Configuration) -> NoReturn:
        """Raise ValueError: it is no environment of Gymnasium."""
        raise ValueError("this is no environment of Gymnasium: leave out the Minari data set")
