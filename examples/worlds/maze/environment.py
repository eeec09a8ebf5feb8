"""A maze of which players see what lies beside the cells that they have stood on: a world of one's own in two modules."""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal

from pydantic import Field

from humanplay.board.messages import NewBoard, NewEpisode, Sent
from humanplay.task import About, Allowed, Messages, Metric, Texts, Words
from humanplay.tasks.base import BaseEnvironment, CodePolicies, EpisodeRecord, ExactLock

VERSION = "maze 1"
MOVES = {"up": (-1, 0), "right": (0, 1), "down": (1, 0), "left": (0, -1)}
ACTIONS = tuple(MOVES)
KEYS = {name: (f"Arrow{name.capitalize()}",) for name in ACTIONS}
WORDS = Words(
    score="score",
    steps="moves to the goal",
    reached="reached the goal",
    short="short of the goal",
    definition="An episode that ends short of the goal counts max_steps. The score is 1 minus the share of max_steps that the "
    "goal took, and 0 without it.",
)
Cell = tuple[int, int]


@dataclass(frozen=True)
class MazeConfig:
    """The side of the maze in cells, an odd number, and the moves after which an episode ends."""

    side: int = 9
    limit: int = 120
    level = "maze"

    @property
    def size(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.side, self.side

    def __post_init__(self) -> None:
        if not (self.side % 2 and 5 <= self.side <= 41 and 1 <= self.limit <= 10_000):
            raise ValueError(
                f"expected an odd side from 5 to 41 and a limit from 1 to 10,000, got {self}"
            )

    def to_dict(self) -> dict[str, Any]:
        """The values that `MazeEnvironment.configuration` takes."""
        return asdict(self)

    @cached_property
    def hash(self) -> str:
        """SHA-256 (hex) of the canonical JSON."""
        return hashlib.sha256(json.dumps(self.to_dict(), sort_keys=True).encode()).hexdigest()


@lru_cache(maxsize=256)
def drawn(side: int, seed: int) -> frozenset[Cell]:
    """The free cells of a maze: each two are joined by one way (depth-first search)."""
    dice, free, way = random.Random(seed), {(0, 0)}, [(0, 0)]
    while way:
        row, col = way[-1]
        ahead = [(row + 2 * down, col + 2 * right) for down, right in MOVES.values()]
        ahead = [cell for cell in ahead if cell not in free and 0 <= min(cell) <= max(cell) < side]
        if not ahead:
            way.pop()
            continue
        following = dice.choice(ahead)
        free |= {following, ((row + following[0]) // 2, (col + following[1]) // 2)}
        way.append(following)
    return frozenset(free)


class MazeRun:
    """A running episode (`humanplay.task.Run`)."""

    def __init__(self, config: MazeConfig, seed: int) -> None:
        self.config, self.seed, self.outcome = config, seed, "running"
        self._free = drawn(config.side, seed)
        self.actions, self._counts = bytearray(), list[int]()
        self.place_now, self.way = (0, 0), list[Cell]()
        self._seen: set[Cell] = set()
        self._look()

    def _look(self) -> None:
        row, col = self.place_now
        self._seen |= {(row + down, col + right) for down in (-1, 0, 1) for right in (-1, 0, 1)}
        self._counts.append(len(self._seen & self._free))
        self.way.append(self.place_now)

    @property
    def ended(self) -> bool:
        return self.outcome != "running"

    def step(self, action: int) -> float:
        if self.ended:
            raise RuntimeError(f"the episode has ended ({self.outcome}); begin another one")
        if action not in range(len(ACTIONS)):
            raise ValueError(f"expected an action from 0 to {len(ACTIONS) - 1}, got {action}")
        down, right = MOVES[ACTIONS[action]]
        ahead = self.place_now[0] + down, self.place_now[1] + right
        self.actions.append(action)
        if ahead in self._free:
            self.place_now = ahead
        self._look()
        last = self.config.side - 1
        if self.place_now == (last, last):
            self.outcome = "succeeded"
        elif len(self.actions) == self.config.limit:
            self.outcome = "timed_out"
        return self.rewards()[-1]

    def abandon(self) -> None:
        self.outcome = "abandoned"

    @property
    def score(self) -> float:
        return 1 - len(self.actions) / self.config.limit if self.outcome == "succeeded" else 0.0

    def rewards(self) -> Sequence[float]:
        rewards = [0.0] * len(self.actions)
        if self.outcome == "succeeded":
            rewards[-1] = self.score
        return rewards

    def counts(self) -> Sequence[int]:
        return self._counts

    def allowed(self) -> Sequence[Allowed]:
        return ()

    def place(self, step: int) -> Mapping[str, Any]:
        return {}

    def observation(self) -> str:
        """What is seen: `@` the player, `.` free, `#` a wall, `?` not seen yet."""
        side = range(self.config.side)
        return "\n".join("".join(self._shown((row, col)) for col in side) for row in side)

    def _shown(self, cell: Cell) -> str:
        if cell == self.place_now:
            return "@"
        return "?" if cell not in self._seen else "." if cell in self._free else "#"

    def view(self) -> MazeView:
        return MazeView(self)

    def seen(self, picture: bool, observation: bool) -> dict[str, Any]:
        text = self.observation()
        return {
            "picture": None,
            "text": text if picture else None,
            "observation": text if observation else None,
            "allowed": None,
        }

    def record(self) -> EpisodeRecord:
        cause = [self.config.hash, self.seed, list(self.actions), self.outcome]
        digest = hashlib.sha256(json.dumps(cause).encode()).hexdigest()
        return EpisodeRecord(
            self.config, self.seed, bytes(self.actions), self.outcome, sum(self.rewards()),
            self.score, len(self.actions), self._counts[-1], digest, VERSION,
        )  # fmt: skip


class MazeView:
    """What may be seen of a run as it stands (`humanplay.task.View`)."""

    allowed: Allowed = None

    def __init__(self, run: MazeRun) -> None:
        self.steps, self.ended, self.outcome = len(run.actions), run.ended, run.outcome
        self.discovered, self.actions = run.counts()[-1], bytes(run.actions)
        self._text, self._score, self._way = run.observation(), run.score, list(run.way)
        self._reward = (0.0, *run.rewards())[-1]

    def observation(self) -> str:
        return self._text

    def frame(self, episode_id: str, hides_scores: bool = False) -> str:
        told = None if hides_scores else self._score
        frame = {
            "kind": "frame", "episode": episode_id, "step": self.steps, "picture": None, "text": self._text,
            "reward": None if hides_scores else self._reward, "return": told, "score": told,
            "headline": told, "outcome": self.outcome if self.ended else None,
        }  # fmt: skip
        return json.dumps(frame)

    def history(self, episode_id: str, hides_scores: bool = False) -> str:
        headlines = [0.0] * self.steps + [self._score]
        told = [None if hides_scores else value for value in headlines]
        return json.dumps(
            {"kind": "history", "episode": episode_id, "headlines": told, "cells": self._way}
        )


class Frame(Sent):
    """What a board shows; its figures are null where a study hides them."""

    kind: Literal["frame"]
    episode: str
    step: int
    picture: None
    text: str
    reward: float | None
    return_: float | None = Field(alias="return")
    score: float | None
    headline: float | None
    outcome: Literal["succeeded", "timed_out", "abandoned"] | None


class History(Sent):
    """The score and the cell after 0, 1, 2, ... moves."""

    kind: Literal["history"]
    episode: str
    headlines: list[float | None]
    cells: list[Cell]


class FarWall:
    """Goes where it has been least, right and down first."""

    name = "far-wall"

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._visits: dict[Cell, int] = {}

    def act(self, observation: str) -> int:
        """The free neighbour that was visited least."""
        rows = observation.split("\n")
        row = next(number for number, text in enumerate(rows) if "@" in text)
        here = row, rows[row].index("@")
        self._visits[here] = self._visits.get(here, 0) + 1
        free = {
            ACTIONS.index(name): (here[0] + down, here[1] + right)
            for name, (down, right) in MOVES.items()
            if 0 <= here[0] + down < len(rows)
            and 0 <= here[1] + right < len(rows)
            and rows[here[0] + down][here[1] + right] == "."
        }
        return min(
            free, key=lambda action: (self._visits.get(free[action], 0), action not in (1, 2))
        )


class MazeEnvironment(BaseEnvironment):
    """The maze (`humanplay.task.Environment`)."""

    name, version, assets = "maze", VERSION, "maze"
    about = About("Maze", WORDS, "Find the way from the upper left to the lower right corner.")
    lock = ExactLock(VERSION)
    messages = Messages(NewBoard, NewEpisode, Frame, History)
    actions = ACTIONS
    keys = KEYS
    metrics = (Metric("score", "", 0.0, 1.0, "higher"),)
    successes = frozenset({"succeeded"})
    requirements = ("humanplay",)

    @cached_property
    def policies(self) -> CodePolicies:
        """One of its own, which sees what people see."""
        return CodePolicies(self, (FarWall,), lambda frame: frame["text"])

    def configuration(self, values: Mapping[str, Any]) -> MazeConfig:
        return MazeConfig(**values)

    def texts(self, config: MazeConfig) -> Texts:
        cells = f"{config.side} x {config.side}"
        goal = f"A maze of {cells} cells, at most {config.limit} moves."
        return Texts(
            setting=f"a maze of {cells} cells",
            observations="People and policies are given the same: the cells that were seen.",
            briefing=f"{self.about.instructions} {goal}",
            design=goal,
            minutes=0.5,
            study_title="How well do people find their way? ({name})",
            opening="You are invited to take part in a study of how people find their way in mazes.",
            things="mazes",
        )

    def run(self, config: MazeConfig, seed: int, actions: bytes = b"") -> MazeRun:
        run = MazeRun(config, seed)
        for action in actions:
            run.step(action)
        return run

    def gymnasium_env(self, config: MazeConfig) -> Any:
        raise ValueError("the maze is no environment of Gymnasium: leave out the Minari data set")


def environment(variant: str) -> MazeEnvironment:
    """The rules; ValueError if a variant is named, since there is none."""
    if variant:
        raise ValueError(f"the maze has no variants, got {variant!r}")
    return MazeEnvironment()
