"""The seam between the playground and what is played on it: a `Task` begins runs, a `Run` steps, a `View` is what may be seen.

An `Environment` is what a stored episode of a task needs, wherever it is read: to be replayed, checked and measured. A `Task`
is an environment with what a server offers of it.

The playground knows environments by these interfaces alone; `humanplay.tasks` has one package for each. A run is a pure
function of configuration, instance and actions, so that an episode is stored as its cause and replayed from it.
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
"""The largest seed of an instance: every whole number up to it is one in JSON and in JavaScript."""


class Configuration(Protocol):
    """What fixes an environment but for the instance: frozen, comparable, hashable."""

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
    """The policy that is asked for cannot be shown beside an episode; the text says why."""


class PolicyError(ValueError):
    """No policy goes by this name or path, or the file is there and cannot be played; the text says which."""


class TaskFullError(RuntimeError):
    """No further run can begin at the moment; the text says why."""


class NotReadyError(RuntimeError):
    """Something that this needs is being made ready beside the server, once on a machine.

    ready  done when it is, so that the same call succeeds; or with the error that kept it from being made
    """

    def __init__(self, ready: Future[None]) -> None:
        super().__init__(GETTING_READY)
        self.ready = ready

    async def wait(self) -> None:
        """Wait until it is ready; raise what kept it from being made."""
        await asyncio.shield(asyncio.wrap_future(self.ready))


class RunEndedError(Exception):
    """The environment failed at a move: the run has ended with those before it.

    The text says so to the player; `report` says step, action, error and traceback to the author.
    """

    def __init__(self, text: str, report: str = "") -> None:
        super().__init__(text)
        self.report = report


@dataclass(frozen=True)
class Metric:
    """A figure of an ended episode.

    lowest, highest  its bounds, None where it has none
    is_better        which direction is
    """

    name: str
    unit: str
    lowest: float | None
    highest: float | None
    is_better: Literal["higher", "lower"]


@dataclass(frozen=True)
class Words:
    """What reports call the two figures of a finished episode, and how it ended.

    score   the headline metric
    steps   moves of a success, the limit for any other ending
    reached, short  an episode that is a success, and one that is not: "reached 99 %", "short of 99 %"
    definition      of both figures, a sentence or two
    abandoned       how an episode that was given up counts, the end of a sentence
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

    title         what a page calls it
    words         what reports call its figures
    instructions  what players are told to do, if the pages of `assets` do not say it
    labels        what each data-quality label of `Environment.labels` means
    references    what its reports and data sets cite
    columns       TABLE.COLUMN -> what a data set's column means in it, where that is its own
    """

    title: str
    words: Words
    instructions: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    references: tuple[Reference, ...] = ()
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Question:
    """Shows whether the instructions were understood; `why` is read by whoever did not choose `answer`, an index."""

    question: str
    choices: tuple[str, ...]
    answer: int
    why: str


@dataclass(frozen=True)
class Texts:
    """What pages, reports and studies say of a configuration.

    setting       part of a sentence
    observations  a sentence: what people see and what agents are given; "" if unknown
    briefing      what an agent is told to do, with the rules that the pages tell people
    design        what a preregistration says, whole sentences
    minutes       that a person takes for an episode, roughly
    study_title   of a new study; `{name}` in it is the study's
    opening       the first paragraph of its consent text
    things        what that text counts: "terrains"
    questions     of its understanding
    placeholders  what its texts may name in braces, and what that becomes
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
    """A count with its words: "1 person was", "3 people were"; an s makes the plural unless given."""
    return f"{count:,} {one if count == 1 else many or f'{one}s'}"


def beat_text(moves: int, succeeded: bool) -> str:
    """What a challenge asks for: `85 moves. Beat it.`"""
    return f"{counted(moves, 'move')}. Beat it." if succeeded else "Not finished. Finish it."


Allowed = tuple[int, ...] | None
"""The codes of the actions that may be chosen before a move; None: all of them."""


def not_allowed(actions: Sequence[str], allowed: Sequence[int], action: int) -> str:
    """Say that an action cannot be chosen now, and which can."""
    return f"{actions[action]} cannot be chosen now: expected {', '.join(actions[code] for code in allowed)}"


class Cause(Protocol):
    """What fixes a stored episode before its first move, as far as a task must know it; `Trial` is one."""

    @property
    def config(self) -> Configuration:
        """Return the configuration."""

    @property
    def seed(self) -> int | None:
        """Return the seed of the instance, None for a given one."""

    @property
    def terrain(self) -> bytes:
        """Return the instance, packed."""

    @property
    def start(self) -> tuple[int, int]:
        """Return where the episode starts."""

    @property
    def trajectory_hash(self) -> str | None:
        """Return the hash of an episode that has ended."""


class Record(Cause, Protocol):
    """The cause of an episode with what it came to, as `Run.record` returns it; replaying compares it.

    actions     the moves, one byte each
    total       the return, the sum of the rewards
    discovered  the count that is stored with the last move

    The others are what the columns of their names hold.
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
    """What a finished episode came to, as the columns of these names store it."""

    outcome: str
    total: float
    score: float
    steps: int
    discovered: int
    trajectory_hash: str
    core_version: str


class View(Protocol):
    """What may be seen of a run after some of its moves; it stays as it is while the run goes on, and holds no secret."""

    @property
    def steps(self) -> int:
        """Return how many moves have been made."""

    @property
    def ended(self) -> bool:
        """Return whether the episode has an outcome."""

    @property
    def outcome(self) -> str:
        """Return the outcome in words, `running` while there is none."""

    @property
    def discovered(self) -> int:
        """Return the count that is stored with each move."""

    @property
    def actions(self) -> bytes:
        """Return the moves so far, one byte each."""

    @property
    def allowed(self) -> Allowed:
        """The codes that may be chosen next; None: all, or the episode has ended."""

    def observation(self) -> object:
        """Return what a policy is given: a copy of its own."""

    def frame(self, episode_id: str, hides_scores: bool = False) -> str:
        """Return the public frame as JSON text; reward, return and score null where they are hidden."""

    def history(self, episode_id: str, hides_scores: bool = False) -> str:
        """Return the path so far as JSON text, without what scores it would tell where they are hidden."""


class AgentObservation(TypedDict):
    """What an agent may see of a run, ready for JSON; None for what is not there.

    picture      what people see, as a data URL
    text         what people see where that is a text, or the observation in words
    observation  what policies are given
    allowed      the names of the actions that may be chosen; None: all of them
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
        """Make one move and return its reward; RuntimeError once the episode has ended, ValueError for no action.

        RunEndedError where the environment fails at this move, and the run has ended with the moves before it.
        """

    def abandon(self) -> None:
        """Give up: the episode ends as one that was left."""

    def observation(self) -> object:
        """Return what a policy is given of the run as it stands: a copy of its own."""

    def view(self) -> View:
        """Return what may be seen of the run as it stands."""

    def agent_observation(self, picture: bool, observation: bool) -> AgentObservation:
        """Return what an agent may see of the run as it stands; what is not asked for is None."""

    def record(self) -> Record:
        """Return the cause, with what it came to: outcome, return and digest among it."""

    def rewards(self) -> Sequence[float]:
        """Return the reward of each move."""

    def counts(self) -> Sequence[int]:
        """The count at the start and after each move: discovered cells in MarsExplorer."""

    def allowed(self) -> Sequence[Allowed]:
        """What could be chosen before each move, the first one first; empty if it was always everything."""

    def place(self, step: int) -> Mapping[str, float]:
        """What the exported moves' columns of this task hold after so many moves."""


class RunElsewhere(Run, Protocol):
    """A run of a task that has `steps_on`: its moves are made in another process.

    tell  called on the step's thread with (moves replayed, moves to replay) while a lost process is restored
    """

    tell: Callable[[int, int], object]

    async def ask(self, action: int) -> bool:
        """Send a move; return whether `step` has its answer at once.

        Else `step` waits, and is called `on_threads`.
        """


@dataclass(frozen=True)
class Messages:
    """A task's own messages over HTTP, as pydantic models.

    board, episode  what begins a board (`WantedBoard`) and its next episode (`WantedEpisode`), each without a field as well
    frame, history  what `View.frame` and `View.history` return
    course          what `Course.to_dict` returns; None: an episode's frames are its course
    mistake         what is named of moves that cost something; None: moves are not judged
    """

    board: type[WantedBoard]
    episode: type[WantedEpisode]
    frame: type[BaseModel]
    history: type[BaseModel]
    course: type[BaseModel] | None = None
    mistake: type[BaseModel] | None = None


class WantedEpisode(Protocol):
    """What somebody wants to play next, in the task's own words; what is left out stays as it was."""

    @property
    def seed(self) -> int | None:
        """The seed of the instance, None for one that is still to be drawn."""

    @property
    def leaves_terrain(self) -> bool:
        """Whether it names neither a configuration nor an instance."""


class WantedBoard(WantedEpisode, Protocol):
    """What somebody wants to play on a new board.

    player      "human" or a policy
    rival       a policy to play the same instance beside
    replays     the session whose ended episode a policy replays beside it
    challenges  the finished episode whose instance is played once more, against what was done there
    """

    @property
    def player(self) -> str:
        """Return who plays."""

    @property
    def rival(self) -> str | None:
        """Return the policy that plays beside, if any."""

    @property
    def replays(self) -> str | None:
        """Return the id of the session that is replayed, if any."""

    @property
    def challenges(self) -> str | None:
        """Return the id of the episode that is played against, if any."""


@dataclass(frozen=True)
class Choice:
    """What an episode is to begin on: the instance of a seed, of a seed still to be drawn, or a given one.

    is_chosen  whether the instance was named beforehand, so that it never counts
    given      a given instance, the task's own; then `seed` is None
    """

    config: Configuration
    seed: int | None = None
    given: object = None

    @property
    def is_chosen(self) -> bool:
        """Return whether it was named beforehand, so that it never counts."""
        return self.seed is not None or self.given is not None


@dataclass(frozen=True)
class DrawnInstance:
    """The cause (`Cause`) of an episode on the instance of a seed."""

    config: Configuration
    seed: int
    terrain: bytes
    start: tuple[int, int]
    trajectory_hash: None = None


class Lock(Protocol):
    """Whether an episode is the same elsewhere, and what that needs."""

    def current(self) -> dict[str, object]:
        """What must be the same where a study is frozen and where it is served, beside the version."""

    def differences(self, recorded: Mapping[str, object]) -> str:
        """Describe how this machine differs from a recorded lock; empty if it does not."""

    def check_exact(self, config: Configuration) -> str:
        """Play episodes again, and return what was compared; ValueError if they differ."""

    def why_not_replayable(self, record: Record, rewards: Sequence[float]) -> str:
        """Say why an episode of another version cannot be simulated here, and what differs."""


class Environment(Protocol):
    """What a stored episode of a task is read, replayed, checked and measured with: without policies and without a server."""

    @property
    def name(self) -> str:
        """Return the task's name, as the column `task` of its episodes holds it."""

    @property
    def version(self) -> str:
        """Return the version that a recorded episode replays with."""

    @property
    def is_recorded(self) -> bool:
        """Whether replays are recordings, since nothing steps it again to verify them."""

    @property
    def about(self) -> About:
        """What pages, reports and studies say of it."""

    def texts(self, config: Configuration) -> Texts:
        """What they say of a configuration."""

    @property
    def lock(self) -> Lock:
        """What must be the same elsewhere for its episodes to be the same."""

    @property
    def assets(self) -> str:
        """Return the folder of `static/task` that draws it."""

    @property
    def messages(self) -> Messages:
        """Return what begins a board, and what it shows."""

    @property
    def actions(self) -> tuple[str, ...]:
        """Return the names of the actions, by their codes."""

    @property
    def keys(self) -> Mapping[str, tuple[str, ...]]:
        """Return the default keys: each action's (`event.code`), in the order of the actions."""

    @property
    def clock(self) -> int | None:
        """Return the frames a second at which its boards tick; None where they wait for each move."""

    @property
    def noop(self) -> int | None:
        """Return the action of a tick at which no key is held; None: the last action again."""

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """Return the figures of an ended episode, the headline first."""

    @property
    def successes(self) -> frozenset[str]:
        """Return the outcomes that are successes."""

    def configuration(self, values: Mapping[str, object]) -> Configuration:
        """Return the configuration of plain values; ValueError or TypeError where they are none."""

    def gymnasium_env(self, config: Configuration) -> gymnasium.Env[object, object]:
        """Return the Gymnasium environment of a configuration, newly made."""

    def observations(self, record: Record) -> Sequence[object]:
        """Return what was seen before each move and after the last."""

    def own_actions(
        self, config: Configuration, actions: bytes
    ) -> NDArray[np.int64] | NDArray[np.float64]:
        """Return moves as the environment itself takes them: what a policy would have chosen."""

    def returns(self, config: Configuration) -> tuple[float, float] | None:
        """Return the lowest and the highest return that a data set may be scored against; None where they are not known."""

    def given_up_score(self, cause: Cause, outcome: str, total: float, score: float) -> float:
        """The score that an ended episode would have had by giving up; `total` is its return."""

    @property
    def policies(self) -> Policies:
        """Its policies: those on offer, and those of files."""

    @property
    def courses(self) -> Courses | None:
        """Drawn replays and the cost of moves; None where moves cannot be drawn and priced."""

    @property
    def expert(self) -> str | None:
        """The policy that people's moves are compared with; None without one."""

    @property
    def boards(self) -> Boards | None:
        """What the leaderboard and the daily terrain are played on; None for a task without them."""

    @property
    def requirements(self) -> tuple[str, ...]:
        """What pip installs so that its environment is there."""

    def assumed(self, config: Configuration, metric: str) -> Mapping[str, float]:
        """Return the mean and standard deviations that a new study assumes of people, by the protocol's fields; empty where
        nothing is known."""

    def bounds(self, config: Configuration) -> tuple[float, float]:
        """Return the lowest and the highest mean of the headline metric that a player can have."""

    def labels(self, cause: Cause, counts: Sequence[int]) -> tuple[str, ...]:
        """Return the labels that a finished episode's course gives it, by the counts stored with its moves."""

    def check_study(self, config: Configuration) -> None:
        """Raise ValueError, saying what is wanted, where a study cannot be played on a configuration."""

    def run(self, config: Configuration, seed: int, actions: bytes = b"") -> Run:
        """Begin a run on the instance of a seed, and make some moves."""

    def instance(self, config: Configuration, seed: int) -> tuple[bytes, tuple[int, int]]:
        """Draw the packed instance of a seed, and where an episode starts on it."""

    def instance_hash(self, cause: Cause) -> str:
        """Return SHA-256 (hex) of the instance: the same for two seeds that draw the same one."""

    def cells(self, cause: Cause) -> int:
        """Return how many things there are to discover on the instance; 0 where discovering is not what it is about."""

    def record(self, cause: Cause, actions: bytes, ending: Ending) -> Record:
        """Return the cause of a finished episode, ready to be replayed."""

    def replay(self, cause: Cause, actions: bytes = b"", ended: bool = False) -> Run:
        """Return the run of a stored episode after its actions; one that had ended without an ending move was abandoned."""

    def prepare(self) -> None:
        """Make ready what the first run of a process would wait for; ValueError where something is not installed."""

    def replay_record(self, record: Record) -> Run:
        """Return the run of what `record` returned; ValueError where the version is another one."""

    def frames(self, record: Record, episode_id: str) -> list[dict[str, object]]:
        """Return the frames of a finished episode from its start to its end; of large ones only every so many."""


def draw_instance(environment: Environment, config: Configuration, seed: int) -> DrawnInstance:
    """The cause of an episode on the instance of a seed."""
    return DrawnInstance(config, seed, *environment.instance(config, seed))


def describe(environment: Environment) -> dict[str, object]:
    """Return what a page is told of a task: how it is called, drawn, moved and measured."""
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
        """Return its name."""

    def reset(self, seed: int) -> None:
        """Begin an episode."""


@dataclass(frozen=True)
class PolicyOffer:
    """A policy that may be chosen: the name, one line about it, where it comes from, and the only board it plays.

    size        (rows, cols); None for any
    is_shipped  whether it comes with the package, not from a file of the server's operator
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
    """The policies of a task: they are found by name or path, decide on boards, and play alone."""

    @property
    def compared(self) -> tuple[str, ...]:
        """Those that a new study compares people with."""

    @property
    def shown(self) -> str | None:
        """The one that a new study shows its participants at the end."""

    @property
    def sees_frames(self) -> bool:
        """Whether a public frame holds what a policy is given, so that one can take part as people do."""

    @property
    def slow(self) -> tuple[str, ...]:
        """Those that take long over an episode, the slowest last: they are evaluated after the others."""

    @property
    def simulated(self) -> str | None:
        """The one that synthetic participants follow, if frames hold what it is given; None for random moves."""

    def offers(self) -> Sequence[PolicyOffer]:
        """What may be chosen by name."""

    def check(self, name: str, *others: str) -> str:
        """The name, if it is on offer; ValueError naming the choices (and `others`) otherwise."""

    def check_size(self, names: Iterable[str], config: Configuration) -> None:
        """Raise ValueError, naming the policy, unless each of the names plays this configuration."""

    def load(self, source: str, config: Configuration | None = None) -> Policy:
        """A new policy by its name or path; PolicyError if there is none, or none that can be played.

        A policy remembers its episode, so each board needs its own.

        config  one that it must be able to play
        """

    def reset(self, policy: Policy, config: Configuration, seed: int) -> None:
        """Reset a policy for an episode of a configuration."""

    def act(self, policy: Policy, observation: object) -> int:
        """A policy's action after what a run showed of itself."""

    def act_many(
        self, policies: Sequence[Policy], observations: Sequence[object]
    ) -> Sequence[int | Exception]:
        """Every board's action, or what its policy raised: the others are decided all the same."""

    def batch_network(self, policy: Policy) -> object | None:
        """The network that decides for the policy, if it decides several boards at once; else None."""

    def observation_in(self, frame: Mapping[str, object]) -> object:
        """What a policy is given of a public frame, if it `sees_frames`."""

    def is_rule(self, source: str) -> bool:
        """Whether a name stands for code, which has no file."""

    def file_of(self, source: str) -> Path:
        """The path of a policy's file; PolicyError if there is none."""

    def hash_of(self, source: str) -> str | None:
        """SHA-256 (hex) of a policy's file; None for code. PolicyError if it cannot be read."""

    def hash_with_code(self, source: str) -> str | None:
        """SHA-256 (hex) of all that decides; None for code that may change unseen."""

    def find_shipped(self, digest: str) -> Path | None:
        """The shipped file of this SHA-256 (hex), whatever its name is now."""

    def unlisted(self) -> Mapping[str, Path]:
        """Files that come with a checkout, and that no server offers unless it is asked to."""

    def title(self, name: str) -> str:
        """What reports call a policy."""

    def play(self, policy: Policy, config: Configuration, seed: int, policy_seed: int) -> Run:
        """The ended run of a policy, reset with `policy_seed`, on the instance of a seed."""

    def play_all(
        self, sources: Sequence[str], config: Configuration, seeds: Sequence[int]
    ) -> Iterator[tuple[str, int, bytes, str]]:
        """Yield source, seed, actions and trajectory hash of each policy's episode on each instance, in any order.

        PolicyError if a policy cannot be played; nothing is played then.
        """


class Animation(Protocol):
    """Draws a course move by move."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""

    def at(self, step: int, before: int) -> Image:
        """The picture after so many moves; `before` is the step of the picture before it."""


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
        """The end as a PNG; of a challenge what is seen before the first move."""

    def animation(self, others: Sequence[Course], is_large: bool) -> Animation:
        """What draws the course, and others of the task beside it."""


class DrawnReplays(Protocol):
    """Makes the courses of a task's episodes."""

    def course_of(self, name: str, record: Record) -> Course:
        """The course of a finished episode; ValueError if this version cannot replay it."""

    def choices(self, offers: Sequence[PolicyOffer], config: Configuration) -> list[str]:
        """The names of the policies that can be shown beside an episode of a configuration."""

    def preferred(self, driver: str, names: Sequence[str] | None = None) -> str | None:
        """The policy to show beside a driver, of those of these names; None if there is none."""

    def play_ghost(self, source: str, record: Record) -> Course:
        """The course of a policy from the start of an episode; GhostError if it cannot be had."""


class Advice(Protocol):
    """What the expert would do."""

    @property
    def actions(self) -> NDArray[np.int64]:
        """Before each move, and after the last one if the episode still runs then."""


class EpisodeCosts(Protocol):
    """What each move of an episode cost, in moves by which it made the episode longer."""

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
        """The kind of mistake that each move is part of, None outside all mistakes."""

    @property
    def counts(self) -> int:
        """Moves that the episode counts."""

    @property
    def expert_moves(self) -> int:
        """Moves of the expert's own episode."""

    @property
    def total(self) -> int:
        """Moves that the episode counts more than the expert's."""

    @property
    def given_up(self) -> int:
        """Cost of an end without a move."""

    @property
    def gained(self) -> int:
        """Cost of the moves outside all mistakes, at most 0."""

    def by_kind(self) -> Mapping[str, int]:
        """The cost of the mistakes of each kind; an end without a move counts as `Courses.ended_early`."""

    def by_tenth(self) -> NDArray[np.int64]:
        """int64[10]: the cost of the moves made at 0-10 %, 10-20 %, ... of the way to the goal."""


class CostEstimator(Protocol):
    """Works out what moves cost."""

    def costs(self, record: Record) -> EpisodeCosts:
        """The costs of an episode's moves."""


class Courses(DrawnReplays, Protocol):
    """Drawn replays, and the cost of moves beside the policy `Environment.expert`, which plays on from each of them.

    kinds        of mistakes, in the order in which they are shown
    ended_early  the kind of an end without a move
    """

    kinds: tuple[str, ...]
    ended_early: str

    def check_judged(self, config: Configuration) -> None:
        """Raise ValueError, saying why, if no move of a configuration is judged."""

    def estimator(self, source: str, cache: Path | None) -> CostEstimator:
        """What works out costs by a file of the expert, and keeps them in the folder `cache` if there is one."""

    def explain(self, cache: Path, record: Record, source: str) -> dict[str, object]:
        """What a page shows of an episode's costs: seconds, so in a job. ValueError if it cannot be replayed."""

    def explain_without_costs(self, record: Record, reason: str) -> dict[str, object]:
        """What a page shows of an episode of which no move is judged, for this reason."""


class Boards(Protocol):
    """What people come back to: the leaderboard's boards and the daily instance's."""

    @property
    def daily(self) -> Configuration:
        """The configuration of the daily instance."""

    @property
    def offered(self) -> tuple[Configuration, ...]:
        """The configurations of boards that are there even if unplayed."""

    def configuration(self, level: str, size: int | tuple[int, int] | None) -> Configuration:
        """The configuration of a level at a size; ValueError if there is none."""

    def name_of(self, config: Configuration) -> tuple[str, str]:
        """The id of a configuration's board, and its title."""

    def seeds(self, config: Configuration) -> tuple[int, ...]:
        """Those of the instances that policies play on a board."""


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
        """Those of its scripts, as a Content-Security-Policy has them."""


class View3D(Protocol):
    """A 3-D view of a server's boards."""

    @property
    def page(self) -> ViewPage:
        """What a browser opens."""

    async def serve(self, websocket: WebSocket, session: object) -> None:
        """Serve one browser's socket of a board's session until it leaves."""

    def close(self) -> None:
        """End what runs for it."""


class Task(Environment, Protocol):
    """An environment on the playground. What is wanted of it (`wanted`) is in its own words: a message of its own."""

    @property
    def steps_on(self) -> Executor | None:
        """Return the threads on which its runs step; None where a step takes microseconds."""

    def levels(self) -> list[dict[str, object]]:
        """Return the levels on offer, as the API lists them."""

    def maps(self) -> list[dict[str, object]]:
        """Return the given instances on offer, as the API lists them."""

    def first(self, wanted: WantedBoard) -> Choice:
        """Return what a new board is to begin on; ValueError where it is not on offer."""

    def next(self, cause: Cause, wanted: WantedEpisode) -> Choice:
        """Return what a board's next episode is to begin on: what is left out stays as it was."""

    def again(self, cause: Cause) -> Choice:
        """Return what an episode began on, to be played once more."""

    def wanted_again(
        self,
        config: Configuration,
        wanted: WantedEpisode,
        player: str = "human",
        rival: str | None = None,
    ) -> WantedBoard:
        """The message that begins an episode of a configuration on a new board."""

    def describe(self, cause: Cause) -> dict[str, object]:
        """Return what a page is told of the configuration."""

    def begin(self, choice: Choice) -> Run:
        """Return a run at its start; ValueError before a seed is drawn, or where it cannot be made.

        TaskFullError where no further run can begin at the moment. NotReadyError: see `on_threads`.
        """

    def viewer(self) -> View3D | None:
        """A new 3-D view of a server's boards; None if there is none."""

    def is_getting_ready(self) -> bool:
        """Return whether something that a board waits for is being made ready beside the server (`NotReadyError`)."""

    def guards(self) -> str:
        """Return what guards the server from its runs, a sentence; "" where none is needed. ValueError where none can begin."""

    def close(self) -> None:
        """End what runs beside the server for it."""


async def on_threads(task: Task, function: Callable[[*Arguments], T], *arguments: *Arguments) -> T:
    """Return what a function comes to on a task's threads, or on those of the event loop where it has none.

    It is called again when what it lacked is ready, and no thread waits meanwhile.
    """
    loop = asyncio.get_running_loop()
    while True:
        try:
            return await loop.run_in_executor(task.steps_on, function, *arguments)
        except NotReadyError as error:
            await error.wait()
