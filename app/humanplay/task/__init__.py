"""The seam between the playground and what is played on it.

A `Task` begins runs, a `Run` steps, and a `View` is what may be seen of a run. An `Environment` is
what a stored episode needs wherever it is read: to be replayed, checked and measured. A `Task` is an
environment with what a server offers of it.

The playground knows environments by these interfaces alone; `humanplay.tasks` has one package for
each. A run is a pure function of configuration, instance and actions, so an episode is stored as its
cause and replayed from it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol, TypedDict, TypeVar, TypeVarTuple

if TYPE_CHECKING:
    import gymnasium
    import numpy as np
    from numpy.typing import NDArray
    from PIL.Image import Image
    from pydantic import BaseModel
    from starlette.websockets import WebSocket

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")

MAX_SEED = 2**53 - 1
"""The largest seed of an instance: JSON and JavaScript hold every whole number up to it."""


class Configuration(Protocol):
    """What fixes an environment except the instance; frozen and hashable."""

    # A task's own class has more than this, and the task narrows to it at its door (`own_config`).
    # With a type parameter instead, everything that holds an episode would need one too.

    @property
    def level(self) -> str:
        """Its kind in a word or two."""

    @property
    def size(self) -> tuple[int, int] | None:
        """(rows, cols) of its grid; None without one."""

    @property
    def limit(self) -> int:
        """Moves after which an episode times out."""

    @property
    def hash(self) -> str:
        """SHA-256 (hex) of its canonical JSON."""

    def to_dict(self) -> dict[str, object]:
        """The values that `Environment.configuration` takes."""


# static/common/game_state.js knows a message that says it by its first two words: isGettingReady
GETTING_READY = "getting ready: this is compiled for this machine once, which takes some seconds"


class GhostError(ValueError):
    """A policy cannot be shown beside an episode; the text says why."""


class PolicyError(ValueError):
    """There is no such policy, or it cannot be played; the text says which."""


class TaskFullError(RuntimeError):
    """No further run can begin at the moment; the text says why."""


class NotReadyError(RuntimeError):
    """Something that this needs is being prepared, once on a machine.

    Attributes:
        ready: Done when the same call would succeed; or it has the error of the preparation.
    """

    def __init__(self, ready: Future[None]) -> None:
        super().__init__(GETTING_READY)
        self.ready = ready

    async def wait(self) -> None:
        """Wait until it is ready; raise the error of the preparation."""
        await asyncio.shield(asyncio.wrap_future(self.ready))


class RunEndedError(Exception):
    """The environment failed at a move: the run has ended before it.

    Attributes:
        report: For the author: step, action, error and traceback. The text is for the player.
    """

    def __init__(self, text: str, report: str = "") -> None:
        super().__init__(text)
        self.report = report


@dataclass(frozen=True)
class Metric:
    """A figure of an ended episode.

    Attributes:
        lowest, highest: Its bounds; None if it has none.
        is_better: Which direction is better.
    """

    name: str
    unit: str
    lowest: float | None
    highest: float | None
    is_better: Literal["higher", "lower"]


@dataclass(frozen=True)
class Words:
    """What reports call the two figures of a finished episode, and its end.

    Attributes:
        score: The headline metric.
        steps: Moves of a success; of any other ending the limit.
        reached, short: An episode that is a success, and one that is not: "reached 99 %", "short of
            99 %".
        definition: Of both figures, a sentence or two.
        abandoned: How an abandoned episode counts, as the end of a sentence.
    """

    score: str
    steps: str
    reached: str
    short: str
    definition: str
    abandoned: str


@dataclass(frozen=True)
class Reference:
    """A publication; `authors` are pairs of family and given names."""

    authors: tuple[tuple[str, str], ...]
    title: str
    year: int
    url: str


@dataclass(frozen=True)
class About:
    """What pages, reports and studies say of a task.

    Attributes:
        title: What a page calls it.
        words: What reports call its figures.
        instructions: What players are to do, if the pages of `assets` do not say it.
        labels: Data-quality label of `Environment.labels` -> its meaning.
        references: What its reports and data sets cite.
        columns: TABLE.COLUMN of a data set -> its meaning in this task, if that is special.
    """

    title: str
    words: Words
    instructions: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    references: tuple[Reference, ...] = ()
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Question:
    """Shows whether somebody understood the instructions.

    Attributes:
        answer: Index of the right choice.
        why: What somebody reads after a wrong choice.
    """

    question: str
    choices: tuple[str, ...]
    answer: int
    why: str


@dataclass(frozen=True)
class Texts:
    """What pages, reports and studies say of a configuration.

    Attributes:
        setting: Part of a sentence.
        observations: A sentence: what people see and what agents observe; "" if unknown.
        briefing: What an agent is to do, with the rules that the pages tell people.
        design: What a preregistration says, in whole sentences.
        minutes: That a person takes for an episode, roughly.
        study_title: Of a new study; `{name}` in it is the study's.
        opening: The first paragraph of its consent text.
        things: What that text counts: "terrains".
        questions: On the instructions.
        placeholders: What the texts may name in braces -> what that becomes.
    """

    setting: str
    observations: str
    briefing: str
    design: str
    minutes: float
    study_title: str
    opening: str
    things: str
    questions: tuple[Question, ...] = ()
    placeholders: Mapping[str, object] = field(default_factory=dict)


def counted(count: int, one: str, many: str | None = None) -> str:
    """A count with its word: "1 person", "3 people". Without `many`, an s is added."""
    return f"{count:,} {one if count == 1 else many or f'{one}s'}"


def beat_text(moves: int, succeeded: bool) -> str:
    """What a challenge asks for: `85 moves. Beat it.`"""
    return f"{counted(moves, 'move')}. Beat it." if succeeded else "Not finished. Finish it."


Allowed = tuple[int, ...] | None
"""The codes of the actions that may be chosen before a move; None: all of them."""


def not_allowed(actions: Sequence[str], allowed: Sequence[int], action: int) -> str:
    """Say that an action cannot be chosen now, and which can."""
    choices = ", ".join(actions[code] for code in allowed)
    return f"{actions[action]} cannot be chosen now: expected {choices}"


class Cause(Protocol):
    """What fixes a stored episode before its first move; a `Trial` is one."""

    @property
    def config(self) -> Configuration:
        """The configuration."""

    @property
    def seed(self) -> int | None:
        """The seed of the instance; None for an instance without one, such as a map."""

    @property
    def terrain(self) -> bytes:
        """The instance, packed."""

    @property
    def start(self) -> tuple[int, int]:
        """Where the episode starts."""

    @property
    def trajectory_hash(self) -> str | None:
        """The hash of the trajectory; None before the episode has ended."""


class Record(Cause, Protocol):
    """The cause of an episode with its actions and its result.

    Replaying the actions must give the same record.

    Attributes:
        actions: The moves, one byte each.
        total: The return: the sum of the rewards.
        discovered: The count that is stored with the last move.

    The other properties are the columns of their names.
    """

    @property
    def actions(self) -> bytes: ...
    @property
    def outcome(self) -> str: ...
    @property
    def total(self) -> float: ...
    @property
    def score(self) -> float: ...
    @property
    def steps(self) -> int: ...
    @property
    def discovered(self) -> int: ...
    @property
    def trajectory_hash(self) -> str: ...
    @property
    def core_version(self) -> str: ...


class Ending(TypedDict):
    """The result of a finished episode, as the columns of these names store it."""

    outcome: str
    total: float
    score: float
    steps: int
    discovered: int
    trajectory_hash: str
    core_version: str


class View(Protocol):
    """What may be seen of a run after some of its moves.

    It does not change while the run goes on, and holds no secret.
    """

    @property
    def steps(self) -> int:
        """How many moves have been made."""

    @property
    def ended(self) -> bool:
        """Whether the episode has an outcome."""

    @property
    def outcome(self) -> str:
        """The outcome in words; `running` if there is none yet."""

    @property
    def discovered(self) -> int:
        """The count that is stored with each move."""

    @property
    def actions(self) -> bytes:
        """The moves so far, one byte each."""

    @property
    def allowed(self) -> Allowed:
        """The codes that may be chosen next; None: all, or the episode has ended."""

    def observation(self) -> object:
        """What a policy observes, as a new copy."""

    def frame(self, episode_id: str, hides_scores: bool = False) -> str:
        """The public frame as JSON text; hidden scores are null."""

    def history(self, episode_id: str, hides_scores: bool = False) -> str:
        """The path so far as JSON text, without scores if they are hidden."""


class AgentObservation(TypedDict):
    """What an agent may see of a run, ready for JSON; None for what is not there.

    Attributes:
        picture: What people see, as a data URL.
        text: What people see if that is a text; else the observation in words.
        observation: What policies observe.
        allowed: The names of the actions that may be chosen; None: all of them.
    """

    picture: str | None
    text: str | None
    observation: object
    allowed: Sequence[str] | None


class Run(Protocol):
    """One running episode."""

    @property
    def ended(self) -> bool:
        """Whether the episode has an outcome."""

    def step(self, action: int) -> float:
        """Make one move and return its reward.

        Raises:
            RuntimeError: If the episode has ended.
            ValueError: If there is no such action.
            RunEndedError: If the environment fails; the run has ended before this move.
        """

    def abandon(self) -> None:
        """End the episode as an abandoned one."""

    def observation(self) -> object:
        """What a policy observes of the run now, as a new copy."""

    def view(self) -> View:
        """What may be seen of the run now."""

    def agent_observation(self, picture: bool, observation: bool) -> AgentObservation:
        """What an agent may see of the run now; what is not asked for is None."""

    def record(self) -> Record:
        """The cause with actions and result."""

    def rewards(self) -> Sequence[float]:
        """The reward of each move."""

    def counts(self) -> Sequence[int]:
        """The count at the start and after each move: discovered cells in MarsExplorer."""

    def allowed(self) -> Sequence[Allowed]:
        """What could be chosen before each move; empty if it was always everything."""

    def place(self, step: int) -> Mapping[str, float]:
        """The task's own columns of an exported move, after so many moves."""


class RunElsewhere(Run, Protocol):
    """A run of a task that has `steps_on`: its moves are made in another process.

    Attributes:
        tell: Called on the step's thread with (moves replayed, moves to replay) while a lost process
            is restored.
    """

    tell: Callable[[int, int], object]

    async def ask(self, action: int) -> bool:
        """Send a move; return whether `step` has its answer at once.

        Else `step` waits, and is called `on_threads`.
        """


@dataclass(frozen=True)
class Messages:
    """A task's own messages over HTTP, as pydantic models.

    Attributes:
        board: Begins a board (`WantedBoard`); no field of it is required.
        episode: Begins a board's next episode (`WantedEpisode`); no field of it is required.
        frame, history: What `View.frame` and `View.history` return.
        course: What `Course.to_dict` returns; None: an episode's frames are its course.
        mistake: What a page shows of moves that cost something; None: moves are not judged.
    """

    board: type[WantedBoard]
    episode: type[WantedEpisode]
    frame: type[BaseModel]
    history: type[BaseModel]
    course: type[BaseModel] | None = None
    mistake: type[BaseModel] | None = None


class WantedEpisode(Protocol):
    """What somebody wants to play next; what it leaves out stays as it was."""

    @property
    def seed(self) -> int | None:
        """The seed of the instance; None if one is still to be drawn."""

    @property
    def leaves_terrain(self) -> bool:
        """Whether it names neither a configuration nor an instance."""


class WantedBoard(WantedEpisode, Protocol):
    """What somebody wants to play on a new board."""

    @property
    def player(self) -> str:
        """Who plays: "human" or a policy."""

    @property
    def rival(self) -> str | None:
        """A policy that plays the same instance beside the player, if any."""

    @property
    def replays(self) -> str | None:
        """The session whose ended episode is shown beside a policy's, if any."""

    @property
    def challenges(self) -> str | None:
        """The finished episode whose instance and result are played against, if any."""


@dataclass(frozen=True)
class Choice:
    """What an episode begins on.

    Attributes:
        seed: Of the instance; None if it is still to be drawn, or if there is a `given` instance.
        given: An instance without a seed, such as a map, in the task's own type.
    """

    config: Configuration
    seed: int | None = None
    given: object = None

    @property
    def is_chosen(self) -> bool:
        """Whether the instance was named beforehand: then the episode never counts."""
        return self.seed is not None or self.given is not None


@dataclass(frozen=True)
class DrawnInstance:
    """The `Cause` of an episode on the instance of a seed."""

    config: Configuration
    seed: int
    terrain: bytes
    start: tuple[int, int]
    trajectory_hash: None = None


class Lock(Protocol):
    """Whether an episode is the same elsewhere, and what that needs."""

    def current(self) -> dict[str, object]:
        """What must be the same where a study is frozen and served, besides the version."""

    def differences(self, recorded: Mapping[str, object]) -> str:
        """Describe how this machine differs from a recorded lock; empty if it does not."""

    def check_exact(self, config: Configuration) -> str:
        """Play episodes again and say what was compared; ValueError if they differ."""

    def why_not_replayable(self, record: Record, rewards: Sequence[float]) -> str:
        """Why an episode of another version cannot be simulated here, and what differs."""


class Environment(Protocol):
    """What a stored episode of a task is replayed, checked and measured with.

    It needs no server.
    """

    @property
    def name(self) -> str:
        """The task's name, as in the column `task` of its episodes."""

    @property
    def version(self) -> str:
        """The version that a recorded episode replays with."""

    @property
    def is_recorded(self) -> bool:
        """Whether replays are recordings: nothing can step it again to verify them."""

    @property
    def about(self) -> About:
        """What pages, reports and studies say of it."""

    def texts(self, config: Configuration) -> Texts:
        """What pages, reports and studies say of a configuration."""

    @property
    def lock(self) -> Lock:
        """What must be the same elsewhere for its episodes to be the same."""

    @property
    def assets(self) -> str:
        """The folder of `static/task` that draws it."""

    @property
    def messages(self) -> Messages:
        """Its messages over HTTP."""

    @property
    def actions(self) -> tuple[str, ...]:
        """The names of the actions, by their codes."""

    @property
    def keys(self) -> Mapping[str, tuple[str, ...]]:
        """Action -> its default keys (`event.code`), in the order of the actions."""

    @property
    def clock(self) -> int | None:
        """Ticks a second of its boards; None if they wait for each move."""

    @property
    def noop(self) -> int | None:
        """The action of a tick without a key; None: the last action again."""

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The figures of an ended episode, the headline metric first."""

    @property
    def successes(self) -> frozenset[str]:
        """The outcomes that are successes."""

    def configuration(self, values: Mapping[str, object]) -> Configuration:
        """The configuration of plain values.

        Raises:
            ValueError, TypeError: If there is no such configuration.
        """

    def gymnasium_env(self, config: Configuration) -> gymnasium.Env[object, object]:
        """A new Gymnasium environment of a configuration."""

    def observations(self, record: Record) -> Sequence[object]:
        """What a policy observed before each move and after the last."""

    def own_actions(
        self, config: Configuration, actions: bytes
    ) -> NDArray[np.int64] | NDArray[np.float64]:
        """Moves as the environment itself takes them."""

    def returns(self, config: Configuration) -> tuple[float, float] | None:
        """The lowest and highest return, for normalised scores of a data set.

        None if they are unknown.
        """

    def given_up_score(self, cause: Cause, outcome: str, total: float, score: float) -> float:
        """The score of an ended episode if it had been abandoned instead.

        Args:
            total: Its return.
        """

    @property
    def policies(self) -> Policies:
        """Its policies: those on offer, and those of files."""

    @property
    def courses(self) -> Courses | None:
        """Drawn replays and the cost of moves, if there are any."""

    @property
    def expert(self) -> str | None:
        """The policy that people's moves are compared with; None without one."""

    @property
    def boards(self) -> Boards | None:
        """The leaderboard's boards and the daily instance, if there are any."""

    @property
    def requirements(self) -> tuple[str, ...]:
        """What pip must install for the environment."""

    def assumed(self, config: Configuration, metric: str) -> Mapping[str, float]:
        """Field of the protocol -> what a new study assumes of people.

        Empty if nothing is known.
        """

    def bounds(self, config: Configuration) -> tuple[float, float]:
        """The lowest and the highest mean of the headline metric that is possible."""

    def labels(self, cause: Cause, counts: Sequence[int]) -> tuple[str, ...]:
        """The data-quality labels of a finished episode.

        Args:
            counts: Those stored with its moves.
        """

    def check_study(self, config: Configuration) -> None:
        """Raise ValueError if no study can be played on a configuration."""

    def run(self, config: Configuration, seed: int, actions: bytes = b"") -> Run:
        """Begin a run on the instance of a seed, and make some moves."""

    def instance(self, config: Configuration, seed: int) -> tuple[bytes, tuple[int, int]]:
        """Draw the packed instance of a seed, and where an episode starts on it."""

    def instance_hash(self, cause: Cause) -> str:
        """SHA-256 (hex) of the instance: equal for two seeds that draw the same one."""

    def cells(self, cause: Cause) -> int:
        """How many things can be discovered on the instance; 0 if that is not the aim."""

    def record(self, cause: Cause, actions: bytes, ending: Ending) -> Record:
        """The record of a finished episode, ready to be replayed."""

    def replay(self, cause: Cause, actions: bytes = b"", ended: bool = False) -> Run:
        """The run of a stored episode after its actions.

        Args:
            ended: Whether it had ended. If no action ended it, it was abandoned.
        """

    def prepare(self) -> None:
        """Prepare what the first run of a process would wait for.

        Raises:
            ValueError: If something is not installed.
        """

    def replay_record(self, record: Record) -> Run:
        """The run of what `record` returned; ValueError if its version is another one."""

    def frames(self, record: Record, episode_id: str) -> list[dict[str, object]]:
        """The frames of a finished episode; of a long one only some of them."""


def draw_instance(environment: Environment, config: Configuration, seed: int) -> DrawnInstance:
    """The cause of an episode on the instance of a seed."""
    return DrawnInstance(config, seed, *environment.instance(config, seed))


def describe(environment: Environment) -> dict[str, object]:
    """What a page must know of a task: its title, how it is drawn, moved and measured."""
    return {
        "name": environment.name.partition(":")[0],
        "title": environment.about.title,
        "instructions": environment.about.instructions,
        "assets": environment.assets,
        "actions": list(environment.actions),
        "keys": {action: list(keys) for action, keys in environment.keys.items()},
        "clock": environment.clock,
        "metrics": [asdict(metric) for metric in environment.metrics],
        "successes": sorted(environment.successes),
        "expert": environment.expert,
        "has_boards": environment.boards is not None,
    }


def place_of(environment: Environment, config: Configuration) -> str:
    """Where episodes of a configuration are played, in words."""
    boards = environment.boards
    return environment.texts(config).setting if boards is None else boards.name_of(config)[1]


class Policy(Protocol):
    """Decides from observations alone, and remembers its episode; `Policies` ask it."""

    @property
    def name(self) -> str:
        """Its name."""

    def reset(self, seed: int) -> None:
        """Begin an episode."""


@dataclass(frozen=True)
class PolicyOffer:
    """A policy that may be chosen.

    Attributes:
        summary: One line about it.
        source: Where it comes from.
        size: (rows, cols) of the only boards that it plays; None for any.
        is_shipped: Whether it comes with the package, not from a file of the server's operator.
    """

    name: str
    summary: str
    source: str
    size: tuple[int, int] | None
    is_shipped: bool

    def plays(self, config: Configuration) -> bool:
        """Whether it plays boards of a configuration."""
        return self.size in (None, config.size)


class Policies(Protocol):
    """The policies of a task, by name or path: they decide on boards and play alone."""

    @property
    def compared(self) -> tuple[str, ...]:
        """Those that a new study compares people with."""

    @property
    def shown(self) -> str | None:
        """The one that a new study shows its participants at the end."""

    @property
    def sees_frames(self) -> bool:
        """Whether a public frame holds what a policy observes.

        Then a policy can take part as people do.
        """

    @property
    def slow(self) -> tuple[str, ...]:
        """Those that are evaluated after the others; the slowest is the last one."""

    @property
    def simulated(self) -> str | None:
        """The one that synthetic participants follow; None for random moves."""

    def offers(self) -> Sequence[PolicyOffer]:
        """What may be chosen by name."""

    def check(self, name: str, *others: str) -> str:
        """The name, if it is on offer.

        Raises:
            ValueError: If it is not; the text names the choices and `others`.
        """

    def check_size(self, names: Iterable[str], config: Configuration) -> None:
        """Raise ValueError for the first policy that does not play a configuration."""

    def load(self, source: str, config: Configuration | None = None) -> Policy:
        """A new policy by its name or path. It remembers its episode: one for each board.

        Args:
            config: One that it must be able to play.

        Raises:
            PolicyError: If there is none, or it cannot be played.
        """

    def reset(self, policy: Policy, config: Configuration, seed: int) -> None:
        """Reset a policy for an episode of a configuration."""

    def act(self, policy: Policy, observation: object) -> int:
        """A policy's action on what a run shows."""

    def act_many(
        self, policies: Sequence[Policy], observations: Sequence[object]
    ) -> Sequence[int | Exception]:
        """Each board's action, or its policy's error, which affects no other board."""

    def batch_network(self, policy: Policy) -> object | None:
        """The network of a policy that can decide several boards at once, if there is one."""

    def observation_in(self, frame: Mapping[str, object]) -> object:
        """What a policy observes, read from a public frame; only if it `sees_frames`."""

    def is_rule(self, source: str) -> bool:
        """Whether a name stands for code, which has no file."""

    def file_of(self, source: str) -> Path:
        """The path of a policy's file; PolicyError if there is none."""

    def hash_of(self, source: str) -> str | None:
        """SHA-256 (hex) of a policy's file; None for code.

        Raises:
            PolicyError: If the file cannot be read.
        """

    def hash_with_code(self, source: str) -> str | None:
        """SHA-256 (hex) of all that decides; None for code that may change unseen."""

    def find_shipped(self, digest: str) -> Path | None:
        """The shipped file of this SHA-256 (hex), whatever its name is now."""

    def unlisted(self) -> Mapping[str, Path]:
        """Files of a checkout that a server offers only if it is asked to."""

    def title(self, name: str) -> str:
        """What reports call a policy."""

    def play(self, policy: Policy, config: Configuration, seed: int, policy_seed: int) -> Run:
        """Play an episode on the instance of a seed; `policy_seed` resets the policy."""

    def play_all(
        self, sources: Sequence[str], config: Configuration, seeds: Sequence[int]
    ) -> Iterator[tuple[str, int, bytes, str]]:
        """Play an episode of each policy on each instance, in any order.

        Yields:
            Source, seed, actions and trajectory hash.

        Raises:
            PolicyError: Before anything is played, if a policy cannot be played.
        """


class Animation(Protocol):
    """Draws a course move by move."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""

    def at(self, step: int, before: int) -> Image:
        """The picture after so many moves; `before` is the previous picture's step."""


class Course(Protocol):
    """An episode as a replay draws it."""

    @property
    def name(self) -> str:
        """Who drove."""

    @property
    def task(self) -> str:
        """The name of what was played."""

    @property
    def config(self) -> Configuration:
        """Its configuration."""

    @property
    def moves(self) -> int:
        """Moves in all."""

    @property
    def headline(self) -> str:
        """Who did what, in words."""

    @property
    def is_large(self) -> bool:
        """Whether a move changes much of a large picture."""

    @property
    def challenge(self) -> str:
        """What is to be beaten, in words: `beat_text`."""

    def with_name(self, name: str) -> Course:
        """The same course under another name."""

    def to_dict(self) -> dict[str, object]:
        """The course as the page reads it."""

    def preview(self, is_challenge: bool = False) -> bytes:
        """The end as a PNG; for a challenge, the start."""

    def animation(self, others: Sequence[Course], is_large: bool) -> Animation:
        """Draws the course, and others of the task beside it."""


class DrawnReplays(Protocol):
    """Makes the courses of a task's episodes."""

    def course_of(self, name: str, record: Record) -> Course:
        """The course of a finished episode; ValueError if this version cannot replay it."""

    def choices(self, offers: Sequence[PolicyOffer], config: Configuration) -> list[str]:
        """Policies that can be shown beside an episode of a configuration."""

    def preferred(self, driver: str, names: Sequence[str] | None = None) -> str | None:
        """The policy among `names` to show beside a driver; None if there is none."""

    def play_ghost(self, source: str, record: Record) -> Course:
        """A policy's course from the start of an episode; GhostError if there is none."""


class Advice(Protocol):
    """What the expert would do."""

    @property
    def actions(self) -> NDArray[np.int64]:
        """Before each move, and after the last one if the episode still runs then."""


class EpisodeCosts(Protocol):
    """By how many moves each move made an episode longer."""

    @property
    def actions(self) -> NDArray[np.int64]:
        """The moves made."""

    @property
    def costs(self) -> NDArray[np.int64]:
        """Of each move, below 0 where it gained."""

    @property
    def advice(self) -> Advice:
        """What the expert would have done."""

    @property
    def kinds(self) -> Sequence[str | None]:
        """The kind of mistake that each move is part of; None outside all mistakes."""

    @property
    def counts(self) -> int:
        """Moves that the episode counts."""

    @property
    def expert_moves(self) -> int:
        """Moves of the expert's own episode."""

    @property
    def total(self) -> int:
        """Moves by which the episode is longer than the expert's."""

    @property
    def without_move(self) -> int:
        """Cost of an end without a move."""

    @property
    def gained(self) -> int:
        """Cost of the moves outside all mistakes, at most 0."""

    def by_kind(self) -> Mapping[str, int]:
        """Kind -> the cost of its mistakes.

        An end without a move is of the kind `Courses.ended_early`.
        """

    def by_tenth(self) -> NDArray[np.int64]:
        """int64[10]: the cost of the moves at 0-10 %, 10-20 %, ... of the way to the goal."""


class CostEstimator(Protocol):
    """Computes what moves cost."""

    def costs(self, record: Record) -> EpisodeCosts:
        """The costs of an episode's moves."""


class Courses(DrawnReplays, Protocol):
    """Drawn replays, and the cost of moves.

    A move's cost is how much longer the episode becomes if `Environment.expert` plays on after it.

    Attributes:
        kinds: Kinds of mistakes, in the order in which they are shown.
        ended_early: The kind of an end without a move.
    """

    kinds: tuple[str, ...]
    ended_early: str

    def check_judged(self, config: Configuration) -> None:
        """Raise ValueError if no move of a configuration is judged."""

    def estimator(self, source: str, cache: Path | None) -> CostEstimator:
        """What computes costs by a file of the expert.

        Args:
            cache: Folder where costs are stored, if any.
        """

    def explain(self, cache: Path, record: Record, source: str) -> dict[str, object]:
        """What a page shows of an episode's costs. It takes seconds, so call it in a job.

        Raises:
            ValueError: If the episode cannot be replayed.
        """

    def explain_without_costs(self, record: Record, reason: str) -> dict[str, object]:
        """What a page shows of an episode whose moves are not judged, with the reason."""


class Boards(Protocol):
    """The leaderboard's boards and the daily instance's."""

    @property
    def daily(self) -> Configuration:
        """The configuration of the daily instance."""

    @property
    def offered(self) -> tuple[Configuration, ...]:
        """The configurations of boards that are listed even if nobody has played them."""

    def configuration(self, level: str, size: int | tuple[int, int] | None) -> Configuration:
        """The configuration of a level at a size; ValueError if there is none."""

    def name_of(self, config: Configuration) -> tuple[str, str]:
        """The id of a configuration's board, and its title."""

    def seeds(self, config: Configuration) -> tuple[int, ...]:
        """The seeds of the instances that policies play on a board."""


class ViewPage(Protocol):
    """The page of a 3-D view."""

    @property
    def version(self) -> str:
        """Its version, in its address."""

    @property
    def etag(self) -> str:
        """The version as an ETag."""

    @property
    def html(self) -> bytes:
        """The content."""

    @property
    def zipped(self) -> bytes:
        """The content, gzipped."""

    @property
    def script_hashes(self) -> tuple[str, ...]:
        """The hashes of its scripts, as a Content-Security-Policy has them."""


class View3D(Protocol):
    """A 3-D view of a server's boards."""

    @property
    def page(self) -> ViewPage:
        """What a browser opens."""

    async def serve(self, websocket: WebSocket, session: object) -> None:
        """Serve a browser's socket of a board's session until it leaves."""

    def close(self) -> None:
        """End what runs for it."""


class Task(Environment, Protocol):
    """An environment that a server offers.

    `wanted` is always a message of the task's own (`Messages`).
    """

    @property
    def steps_on(self) -> Executor | None:
        """The threads on which its runs step; None if a step takes microseconds."""

    def levels(self) -> list[dict[str, object]]:
        """The levels on offer, as the API lists them."""

    def maps(self) -> list[dict[str, object]]:
        """The maps on offer, as the API lists them."""

    def first(self, wanted: WantedBoard) -> Choice:
        """What a new board begins on; ValueError if that is not on offer."""

    def next(self, cause: Cause, wanted: WantedEpisode) -> Choice:
        """What a board's next episode begins on: what is left out stays as it was."""

    def again(self, cause: Cause) -> Choice:
        """What an episode began on, to be played once more."""

    def wanted_again(
        self,
        config: Configuration,
        wanted: WantedEpisode,
        player: str = "human",
        rival: str | None = None,
    ) -> WantedBoard:
        """The message that begins an episode of a configuration on a new board."""

    def describe(self, cause: Cause) -> dict[str, object]:
        """What a page must know of the configuration."""

    def begin(self, choice: Choice) -> Run:
        """A run at its start.

        Raises:
            ValueError: If no seed is drawn yet, or the run cannot be made.
            TaskFullError: If no further run can begin at the moment.
            NotReadyError: If something must be prepared first; `on_threads` waits for it.
        """

    def viewer(self) -> View3D | None:
        """A new 3-D view of a server's boards; None if there is none."""

    def is_getting_ready(self) -> bool:
        """Whether a board waits for a preparation (`NotReadyError`)."""

    def guards(self) -> str:
        """What guards the server from its runs, in a sentence; "" if nothing must.

        Raises:
            ValueError: If no run can begin.
        """

    def close(self) -> None:
        """End what runs beside the server for it."""


async def on_threads(task: Task, function: Callable[[*Arguments], T], *arguments: *Arguments) -> T:
    """Call a function on a task's threads, or on the event loop's if it has none.

    After a NotReadyError the function is called again once it can succeed. No thread waits meanwhile.
    """
    loop = asyncio.get_running_loop()
    while True:
        try:
            return await loop.run_in_executor(task.steps_on, function, *arguments)
        except NotReadyError as error:
            await error.wait()
