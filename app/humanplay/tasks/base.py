"""What a task has unless it says otherwise.

A task is two classes: one of `BaseEnvironment` that has `run` and what else `humanplay.task.Environment` asks
for, and one of that and `BaseTask`.
"""

from __future__ import annotations

import hashlib
import json
import math
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from humanplay.board.messages import NewBoard
from humanplay.task import (
    Boards,
    Cause,
    Choice,
    Configuration,
    Courses,
    Ending,
    Environment,
    Policy,
    PolicyError,
    PolicyOffer,
    Record,
    Run,
    View,
    View3D,
    WantedBoard,
    WantedEpisode,
)
from humanplay.tasks.courses import FrameCourses

FAILED = "environment_failed"
"""The outcome of an episode whose environment failed twice at the same move; it counts as one that was left there."""
MOST_FRAMES = 3000
"""Frames of a replay, at most."""
FIRST_SEED = 1_000_000_000
"""Policies play the instances of this seed and the next ones on a board."""
INSTANCES = 100
"""Instances that policies play on a board."""


@dataclass(frozen=True)
class EpisodeRecord:
    """The record of an episode that follows from its seed (`humanplay.task.Record`)."""

    config: Configuration
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


def frame_text(
    view: View,
    episode_id: str,
    shown: Mapping[str, object],
    figures: tuple[float, float, float],
    hides_scores: bool,
) -> str:
    """A frame of a picture or a text as JSON text, its figures null where hidden.

    Args:
        shown: The picture or the text, and what may be chosen.
        figures: The reward of the last move, the sum of all, and the score.
    """
    reward, total, score = (None, None, None) if hides_scores else figures
    frame = {
        "kind": "frame",
        "episode": episode_id,
        "step": view.steps,
        **shown,
        "reward": reward,
        "return": total,
        "score": score,
        "headline": score,
        "outcome": view.outcome if view.ended else None,
    }
    return json.dumps(frame, separators=(",", ":"))


class BaseEnvironment:
    """Episodes that follow from seed and actions (`humanplay.task.Environment`)."""

    @property
    def is_recorded(self) -> bool:
        """False: an episode is played again from its seed."""
        return False

    @property
    def clock(self) -> int | None:
        """None: boards wait for each move."""
        return None

    @property
    def noop(self) -> int | None:
        """None: no clock ticks."""
        return None

    @property
    def expert(self: Environment) -> str | None:
        """The policy that is shown to participants."""
        return self.policies.shown

    @property
    def courses(self: Environment) -> Courses | None:
        """Replays are frames, and moves cost what the expert then needs more."""
        return FrameCourses(self)

    @property
    def boards(self: Environment) -> Boards | None:
        """One board: the default configuration, on new instances every day."""
        return DefaultBoards(self)

    def own_actions(
        self, config: Configuration, actions: bytes
    ) -> NDArray[np.int64] | NDArray[np.float64]:
        """The codes of the moves."""
        return np.frombuffer(actions, np.uint8).astype(np.int64)

    def returns(self, config: Configuration) -> tuple[float, float] | None:
        """None: the bounds of the return are not known."""
        return None

    def bounds(self: Environment, config: Configuration) -> tuple[float, float]:
        """The bounds of the headline metric, infinite if they are not known."""
        low, high = self.metrics[0].lowest, self.metrics[0].highest
        return (-math.inf if low is None else low, math.inf if high is None else high)

    def assumed(self: Environment, config: Configuration, metric: str) -> Mapping[str, float]:
        """Half, a tenth, a tenth and a fifth of the range; nothing without a range."""
        low, high = (0.0, float(config.limit)) if metric == "steps" else self.bounds(config)
        if not math.isfinite(high - low):
            return {}
        return {
            "assumed_mean": (low + high) / 2,
            "assumed_player_sd": (high - low) / 10,
            "assumed_terrain_sd": (high - low) / 10,
            "assumed_episode_sd": (high - low) / 5,
        }

    def given_up_score(
        self: Environment, cause: Cause, outcome: str, total: float, score: float
    ) -> float:
        """The lowest score if it is known; else the episode's own score."""
        lowest, _ = self.bounds(cause.config)
        return min(score, lowest) if math.isfinite(lowest) else score

    def labels(self, cause: Cause, counts: Sequence[int]) -> tuple[str, ...]:
        """None: what no effort looks like is not known."""
        return ()

    def check_study(self, config: Configuration) -> None:
        """Do nothing: a study can be played on every configuration."""

    def prepare(self) -> None:
        """Do nothing: a first run waits for nothing."""

    def instance(self, config: Configuration, seed: int) -> tuple[bytes, tuple[int, int]]:
        """No bytes: the instance is whatever a run makes of the seed."""
        return b"", (0, 0)

    def instance_hash(self, cause: Cause) -> str:
        """SHA-256 (hex) of configuration and seed."""
        return hashlib.sha256(f"{cause.config.hash}:{cause.seed}".encode()).hexdigest()

    def cells(self, cause: Cause) -> int:
        """0: nothing is discovered."""
        return 0

    def observations(self: Environment, record: Record) -> Sequence[object]:
        """What was seen before each move and after the last."""
        run = self.replay(record)
        seen = [run.observation()]
        for action in record.actions:
            run.step(action)
            seen.append(run.observation())
        return seen

    def record(self: Environment, cause: Cause, actions: bytes, ending: Ending) -> Record:
        """The record of a finished episode; ValueError if it has no seed."""
        return EpisodeRecord(cause.config, seed_of(cause), actions, **ending)

    def replay(self: Environment, cause: Cause, actions: bytes = b"", ended: bool = False) -> Run:
        """The run of a stored episode; abandoned if it had ended and no action ended it."""
        run = self.run(cause.config, seed_of(cause), actions)
        if ended:
            give_up(cause, run)
        return run

    def replay_record(self: Environment, record: Record) -> Run:
        """The run of a record; ValueError if the version is another one."""
        if record.core_version != self.version:
            raise ValueError(
                f"the episode was played under {record.core_version}, this is {self.version}"
            )
        return self.replay(record, record.actions, True)

    def frames(self: Environment, record: Record, episode_id: str) -> list[dict[str, object]]:
        """The frames of a finished episode; of a long one only some of them."""
        run = self.replay(record)
        views, every = [run.view()], 1 + len(record.actions) // MOST_FRAMES
        for step, action in enumerate(record.actions, 1):
            run.step(action)
            if step % every == 0 or step == len(record.actions):
                views.append(run.view())
        if not run.ended:
            give_up(record, run)
            views.append(run.view())
        return [json.loads(view.frame(episode_id)) for view in views]


class BaseTask:
    """A task of one configuration whose boards begin on seeds (`humanplay.task.Task`).

    steps_on  threads on which its runs step; None if a step takes microseconds
    """

    steps_on: Executor | None = None

    def levels(self) -> list[dict[str, object]]:
        """None: the environment is one."""
        return []

    def maps(self) -> list[dict[str, object]]:
        """None: instances are drawn."""
        return []

    def first(self: Environment, wanted: WantedBoard) -> Choice:
        """What a new board is to begin on."""
        return Choice(self.configuration({}), wanted.seed)

    def next(self, cause: Cause, wanted: WantedEpisode) -> Choice:
        """What a board's next episode is to begin on."""
        return Choice(cause.config, wanted.seed)

    def again(self, cause: Cause) -> Choice:
        """What an episode began on, to be played once more."""
        return Choice(cause.config, cause.seed)

    def wanted_again(
        self,
        config: Configuration,
        wanted: WantedEpisode,
        player: str = "human",
        rival: str | None = None,
    ) -> NewBoard:
        """What begins an episode that is wanted on a board of its own."""
        return NewBoard(seed=wanted.seed, player=player, rival=rival)

    def describe(self, cause: Cause) -> dict[str, object]:
        """Level, map and size as a page knows them of every task: the level alone."""
        return {"level": cause.config.level, "map": None, "size": None}

    def begin(self: Environment, choice: Choice) -> Run:
        """A run at its start; ValueError before a seed is drawn."""
        if choice.seed is None:
            raise ValueError("an episode begins on a seed")
        return self.run(choice.config, choice.seed)

    def viewer(self) -> View3D | None:
        """None: pages draw the frames."""
        return None

    def is_getting_ready(self) -> bool:
        """False: nothing is compiled."""
        return False

    def guards(self) -> str:
        """Nothing: its runs are the server's own."""
        return ""

    def close(self) -> None:
        """Do nothing: all runs in the server."""


@runtime_checkable
class OutcomeHolder(Protocol):
    """A run, or a record of one, whose outcome can be set."""

    outcome: str


def give_up(cause: object, run: Run) -> None:
    """End the run of an episode that is over as the episode was, if no move ended it."""
    if not run.ended:
        run.abandon()
        if getattr(cause, "outcome", None) == FAILED and isinstance(run, OutcomeHolder):
            run.outcome = FAILED


def seed_of(cause: Cause) -> int:
    """The seed of an episode; ValueError if its instance was given."""
    if cause.seed is None:
        raise ValueError("the episode follows from its seed, and has none")
    return cause.seed


class ExactLock:
    """The lock of rules that use whole numbers alone, so are the same everywhere."""

    def __init__(self, version: str) -> None:
        self._version = version

    def current(self) -> dict[str, object]:
        """Nothing: the version says it all."""
        return {}

    def differences(self, recorded: Mapping[str, object]) -> str:
        """None."""
        return ""

    def check_exact(self, config: Configuration) -> str:
        """Nothing is compared: the task's own tests have examined it."""
        return ""

    def why_not_replayable(self, record: Record, rewards: Sequence[float]) -> str:
        """Another version's episode needs that version."""
        return f"{self._version} here: only the release that made it can simulate it"


class DefaultBoards:
    """One board, on which the daily instance is played too (`humanplay.task.Boards`)."""

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        self.daily = environment.configuration({})
        self.offered = (self.daily,)

    def configuration(self, level: str, size: int | tuple[int, int] | None) -> Configuration:
        """The default configuration; ValueError for another level or size."""
        only = self.daily
        sides = (size, size) if isinstance(size, int) else size
        if level != only.level or sides != only.size:
            raise ValueError(
                f"{self._environment.about.title} is played on {self.name_of(only)[1]} alone: "
                "leave level and size out"
            )
        return only

    def name_of(self, config: Configuration) -> tuple[str, str]:
        """The level, and of other settings than the default ones a part of their hash."""
        title = self._environment.about.title
        if config.size is not None:
            title += f" {config.size[0]} × {config.size[1]}"
        if config == self.daily:
            return config.level, title
        return f"{config.level}-{config.hash[:8]}", f"{title} (settings {config.hash[:8]})"

    def seeds(self, config: Configuration) -> tuple[int, ...]:
        """Those of `INSTANCES`."""
        return tuple(range(FIRST_SEED, FIRST_SEED + INSTANCES))


class DecidingPolicy(Policy, Protocol):
    """A policy that decides by itself, whatever its observations are."""

    def act(self, observation: object) -> int:
        """The action."""


def decides(policy: Policy) -> TypeGuard[DecidingPolicy]:
    """Whether a policy decides by itself."""
    return callable(getattr(policy, "act", None))  # isinstance would take longer than many policies


class BasePolicies:
    """Policies that decide one by one on boards of any size; none is shipped."""

    compared: tuple[str, ...] = ("random",)
    shown: str | None = None
    slow: tuple[str, ...] = ("random",)
    simulated: str | None = None
    sees_frames: bool = False

    def offers(self) -> Sequence[PolicyOffer]:
        """What may be chosen by name."""
        return ()

    def check(self, name: str, *others: str) -> str:
        """The name, if it is on offer; else ValueError with the choices and `others`."""
        names = [offer.name for offer in self.offers()]
        if name not in names:
            raise ValueError(f"no policy {name!r}; choose one of: {', '.join((*others, *names))}")
        return name

    def check_size(self, names: Iterable[str], config: Configuration) -> None:
        """Do nothing: they play boards of any size."""

    def reset(self, policy: Policy, config: Configuration, seed: int) -> None:
        """Reset a policy for an episode."""
        policy.reset(seed)

    def act(self, policy: Policy, observation: object) -> int:
        """A policy's action; TypeError for one that does not decide by itself."""
        if not decides(policy):
            raise TypeError(f"expected a policy with a method act, got a {type(policy).__name__}")
        return policy.act(observation)

    def act_many(
        self, policies: Sequence[Policy], observations: Sequence[object]
    ) -> Sequence[int | Exception]:
        """Each one's action, or why it has none."""
        actions: list[int | Exception] = []
        for policy, observation in zip(policies, observations, strict=True):
            try:
                actions.append(self.act(policy, observation))
            except PolicyError as error:
                actions.append(error)
        return actions

    def batch_network(self, policy: Policy) -> object | None:
        """None: each decides by itself."""
        return None

    def observation_in(self, frame: Mapping[str, object]) -> object:
        """Raise PolicyError: a frame is a picture, and no observation."""
        raise PolicyError("a frame does not hold what a policy is given")

    def hash_of(self, source: str) -> str | None:
        """None: all of them are code."""
        return None

    def hash_with_code(self, source: str) -> str | None:
        """SHA-256 (hex) of its file; None for code, which may have changed unseen."""
        return self.hash_of(source)

    def find_shipped(self, digest: str) -> Path | None:
        """None: no file is shipped."""
        return None

    def unlisted(self) -> Mapping[str, Path]:
        """No files."""
        return {}

    def title(self, name: str) -> str:
        """The policy's name."""
        return name


class RandomPolicy:
    """Any action at random."""

    name = "random"

    def __init__(self, actions: int) -> None:
        self._actions, self._dice = actions, random.Random()

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._dice = random.Random(seed)

    def act(self, observation: object) -> int:
        """One of the actions."""
        return self._dice.randrange(self._actions)


class CodePolicies(BasePolicies):
    """Policies that are classes with a `name` and a docstring, and `random`.

    The first is the expert, is shown to participants, and is what synthetic ones follow.

    environment  whose policies they are
    classes      of them, made anew for each board
    observation  what they are given of a public frame
    """

    sees_frames = True

    def __init__(
        self,
        environment: Environment,
        classes: Sequence[Callable[[], Policy]],
        observation: Callable[[Mapping[str, object]], object],
    ) -> None:
        self._run, self._observation = environment.run, observation
        makers: tuple[Callable[[], Policy], ...] = (
            *classes,
            partial(RandomPolicy, len(environment.actions)),
        )
        self._classes = {make().name: make for make in makers}
        self.compared = tuple(self._classes)
        self.shown = self.simulated = next((make().name for make in classes), None)

    def offers(self) -> list[PolicyOffer]:
        """Each, with its docstring's first line."""
        return [
            PolicyOffer(name, (type(make()).__doc__ or "").partition("\n")[0], name, None, True)
            for name, make in self._classes.items()
        ]

    def load(self, source: str, config: Configuration | None = None) -> Policy:
        """A new policy; PolicyError if none has this name."""
        if source not in self._classes:
            names = ", ".join(self._classes)
            raise PolicyError(f"no policy {source!r}; choose one of: {names}")
        return self._classes[source]()

    def observation_in(self, frame: Mapping[str, object]) -> object:
        """What a policy is given of a public frame."""
        return self._observation(frame)

    def is_rule(self, source: str) -> bool:
        """True: each is code."""
        return True

    def file_of(self, source: str) -> Path:
        """Raise PolicyError: there are no files."""
        raise PolicyError(f"the policy {source!r} is code, and has no file")

    def play(self, policy: Policy, config: Configuration, seed: int, policy_seed: int) -> Run:
        """The ended run of a policy, reset with `policy_seed`, on the instance of a seed."""
        policy.reset(policy_seed)
        run = self._run(config, seed)
        while not run.ended:
            run.step(self.act(policy, run.observation()))
        return run

    def play_all(
        self, sources: Sequence[str], config: Configuration, seeds: Sequence[int]
    ) -> Iterator[tuple[str, int, bytes, str]]:
        """Yield source, seed, actions and hash of each policy's episode on each instance."""
        for source, policy in [(source, self.load(source)) for source in sources]:
            for seed in seeds:
                record = self.play(policy, config, seed, seed).record()
                yield source, seed, record.actions, record.trajectory_hash
