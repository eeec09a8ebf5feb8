"""The seam between the playground and what is played on it: a `Task` begins runs, a `Run` steps, a `View` is what may be seen.

`Rules` are what a stored episode of a task needs, wherever it is read: to be replayed, checked and measured. A `Task` is its
rules with what a server offers of it.

The playground knows environments by these interfaces alone; `humanplay.tasks` has one package for each. A run is a pure
function of configuration, instance and actions, so that an episode is stored as its cause and replayed from it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any, Literal, Protocol, TypeVar, cast

T = TypeVar("T")

MAX_SEED = 2**53 - 1
"""The largest seed of an instance: every whole number up to it is one in JSON and in JavaScript."""

Configuration = Any
"""What fixes an environment but for the instance: frozen, comparable, hashable; the task's own type.

level      its kind in a word or two
limit      moves after which an episode times out
hash       SHA-256 (hex) of its canonical JSON
to_dict()  the values that `Rules.configuration` takes
"""

Record = Any
"""The cause of an episode with what it came to, as `Run.record` returns it; the task's own type.

config, seed, terrain, start, actions  as in a `Cause`, and the moves, one byte each
outcome, total, score, steps, discovered, trajectory_hash, core_version  as the columns of those names
"""


Course = Any
"""An episode as a replay draws it, where a task's episodes have courses; the task's own type.

name, moves, is_large  who drove, how many moves, whether one changes much of a large picture
headline, place      who did what, and where, in words
about(), to_dict()   what the page reads: of where it was played, and of the course
preview()            the end as a PNG
animation(others, is_large)  draws the course, and others beside it: `size` in pixels, `at(step, before)` a picture
"""


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
    """The environment failed at a move, and the run has ended with the moves before it; the text says so to the player."""


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
    """

    score: str
    steps: str
    reached: str
    short: str
    definition: str


def counted(count: int, one: str, many: str | None = None) -> str:
    """A count with its words: "1 person was", "3 people were"; an s makes the plural unless given."""
    return f"{count:,} {one if count == 1 else many or f'{one}s'}"


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

    def observation(self) -> Any:
        """Return what a policy is given: a copy of its own."""

    def frame(self, episode_id: str, hides_scores: bool = False) -> str:
        """Return the public frame as JSON text; reward, return and score null where they are hidden."""

    def history(self, episode_id: str, hides_scores: bool = False) -> str:
        """Return the path so far as JSON text, without what scores it would tell where they are hidden."""


class Run(Protocol):
    """One running episode."""

    def step(self, action: int) -> float:
        """Make one move and return its reward; RuntimeError once the episode has ended, ValueError for no action.

        RunEndedError where the environment fails at this move, and the run has ended with the moves before it.
        """

    def abandon(self) -> None:
        """Give up: the episode ends as one that was left."""

    def observation(self) -> Any:
        """Return what a policy is given of the run as it stands: a copy of its own."""

    def view(self) -> View:
        """Return what may be seen of the run as it stands."""

    def seen(self, picture: bool, observation: bool) -> dict[str, Any]:
        """Return what an agent may see of the run as it stands, ready for JSON; None for what is not asked for or not there.

        `picture` (a data URL) is what people see, `observation` what policies are given; `text` says in words what
        people see where that is a text, or what is in the observation.
        """

    def record(self) -> Record:
        """Return the cause, with what it came to: outcome, return and digest among it."""

    def rewards(self) -> Sequence[float]:
        """Return the reward of each move."""

    def counts(self) -> Sequence[int]:
        """Return the count that is stored with each move, that of the start first."""

    def place(self, step: int) -> Mapping[str, Any]:
        """Return where the run stood after so many moves, by the task's own columns of the exported moves."""


class RunElsewhere(Run, Protocol):
    """A run of a task that has `steps_on`: its moves are made in another process.

    tell  called on the thread of a step, where that process was lost: how many of the moves before were made again, of how many
    """

    tell: Callable[[int, int], object]

    async def ask(self, action: int) -> bool:
        """Begin a move, and return whether `step` then makes it at once; else it goes `on_threads`."""


@dataclass(frozen=True)
class Messages:
    """A task's own messages over HTTP, as pydantic models.

    board, episode  what begins a board (`WantedBoard`) and its next episode (`WantedEpisode`), each without a field as well
    frame, history  what `View.frame` and `View.history` return
    """

    board: type[Any]
    episode: type[Any]
    frame: type[Any]
    history: type[Any]


class WantedEpisode(Protocol):
    """What somebody wants to play next, in the task's own words; what is left out stays as it was."""

    @property
    def leaves_terrain(self) -> bool:
        """Return whether nothing is said of configuration and instance."""


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
    given: Any = None

    @property
    def is_chosen(self) -> bool:
        """Return whether it was named beforehand, so that it never counts."""
        return self.seed is not None or self.given is not None


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


class Rules(Protocol):
    """What a stored episode of a task is read, replayed, checked and measured with: without policies and without a server."""

    @property
    def name(self) -> str:
        """Return the task's name, as the column `task` of its episodes holds it."""

    @property
    def version(self) -> str:
        """Return the version that a recorded episode replays with."""

    @property
    def title(self) -> str:
        """Return what a page calls it."""

    @property
    def instructions(self) -> str:
        """Return what players are told to do where the pages of `assets` do not say it; "" otherwise."""

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

    def configuration(self, values: Mapping[str, Any]) -> Configuration:
        """Return the configuration of plain values; ValueError or TypeError where they are none."""

    def environment(self, config: Configuration) -> Any:
        """Return the Gymnasium environment of a configuration, newly made."""

    def observations(self, record: Record) -> Sequence[Any]:
        """Return what was seen before each move and after the last."""

    def returns(self, config: Configuration) -> tuple[float, float] | None:
        """Return the lowest and the highest return that a data set may be scored against; None where they are not known."""

    @property
    def words(self) -> Words:
        """Return what reports call its figures."""

    def given_up_score(self, cause: Cause, outcome: str, total: float, score: float) -> float:
        """The score that an ended episode would have had by giving up; `total` is its return."""

    @property
    def courses(self) -> Any | None:
        """Return what makes `Course`s: `course_of(name, record)`, `play_ghost(source, record)`, `choices(offers, config)`
        and `preferred(driver, names)`; None where moves cannot be drawn, priced and compared with policies'."""

    @property
    def players(self) -> Any | None:
        """Return what finds the files of policies, lets them play away from boards, and compares moves with theirs
        (`humanplay.tasks.mars.players`); None where there are no policies."""

    @property
    def assumptions_in_words(self) -> str:
        """Where the standard deviations that a new study assumes come from."""

    @property
    def label_texts(self) -> Mapping[str, str]:
        """What each data-quality label of `labels` means."""

    def study(self, config: Configuration) -> Mapping[str, Any]:
        """Return the fields of a new protocol that the task knows: title, questions, policies,
        and of the consent text the first paragraph (`opening`) and what it counts (`things`)."""

    def assumed(self, config: Configuration, metric: str) -> Mapping[str, float]:
        """Return the mean and standard deviations that a new study assumes of people, by the protocol's fields; empty where
        nothing is known."""

    def placeholders(self, config: Configuration) -> Mapping[str, Any]:
        """Return what a study's texts may name in braces of a configuration: name -> what it becomes."""

    def setting(self, config: Configuration) -> str:
        """Describe a configuration in part of a sentence."""

    def observations_in_words(self, config: Configuration) -> str:
        """Say in a sentence what people see and what agents are given; empty if unknown."""

    def briefing(self, config: Configuration) -> str:
        """Return what an agent is told to do, with the rules that the pages tell people."""

    def design(self, config: Configuration) -> str:
        """Return what a preregistration says of a configuration, whole sentences."""

    def minutes(self, config: Configuration) -> float:
        """Return how long a person takes for an episode, roughly."""

    def bounds(self, config: Configuration) -> tuple[float, float]:
        """Return the lowest and the highest mean of the headline metric that a player can have."""

    def labels(self, was: Cause, counts: Sequence[int]) -> tuple[str, ...]:
        """Return the labels that a finished episode's course gives it, by the counts stored with its moves."""

    def check_study(self, config: Configuration) -> None:
        """Raise ValueError, saying what is wanted, where a study cannot be played on a configuration."""

    def lock(self) -> dict[str, Any]:
        """Return what must be the same where a study is frozen and where it is served, beside the version."""

    def lock_differences(self, lock: Mapping[str, Any]) -> str:
        """Describe how this machine differs from a recorded lock; empty if it does not."""

    def why_not_replayable(self, record: Record, rewards: Sequence[float]) -> str:
        """Say why an episode of another version cannot be simulated here, and what differs."""

    def examine(self, config: Configuration) -> None:
        """Raise ValueError, saying what differs and why, where episodes do not follow from seed and actions."""

    def instance(self, config: Configuration, seed: int) -> tuple[bytes, tuple[int, int]]:
        """Draw the packed instance of a seed, and where an episode starts on it."""

    def instance_hash(self, was: Cause) -> str:
        """Return SHA-256 (hex) of the instance: the same for two seeds that draw the same one."""

    def cells(self, was: Cause) -> int:
        """Return how many things there are to discover on the instance; 0 where discovering is not what it is about."""

    def record(self, was: Cause, actions: bytes, came_to: Mapping[str, Any]) -> Record:
        """Return the cause of a finished episode, ready to be replayed.

        came_to  outcome, total, score, steps, discovered, trajectory_hash and core_version as they are stored
        """

    def replay(self, was: Cause, actions: bytes = b"", ended: bool = False) -> Run:
        """Return the run of a stored episode after its actions; one that had ended without an ending move was abandoned."""

    def prepare(self) -> None:
        """Make ready what the first run of a process would wait for; ValueError where something is not installed."""

    def replay_record(self, record: Record) -> Run:
        """Return the run of what `record` returned; ValueError where the version is another one."""

    def frames(self, record: Record, episode_id: str) -> list[dict[str, Any]]:
        """Return the frames of a finished episode from its start to its end; of large ones only every so many."""


def describe(rules: Rules) -> dict[str, Any]:
    """Return what a page is told of a task: how it is called, drawn, moved and measured."""
    return {
        "name": rules.name.partition(":")[0],
        "title": rules.title,
        "instructions": rules.instructions,
        "assets": rules.assets,
        "actions": list(rules.actions),
        "keys": {action: list(keys) for action, keys in rules.keys.items()},
        "clock": rules.clock,
        "metrics": [asdict(metric) for metric in rules.metrics],
    }


@lru_cache(maxsize=64)
def rules_of(task: str) -> Rules:
    """Return the rules of a task by its name, like `mars` or `gymnasium:FrozenLake-v1`; ValueError for none of ours."""
    package, _, rest = task.partition(":")
    if package not in PACKAGES:
        raise ValueError(f"expected a task of {', '.join(PACKAGES)}, got {task!r}")
    return cast(Rules, import_module(f"humanplay.tasks.{package}.rules").rules(rest))


MARS = "mars"
"""The task that a server plays where none is named: MarsExplorer."""
PACKAGES = (MARS, "gymnasium")
"""Packages of `humanplay.tasks`: the module `rules` of each has a function `rules` of what follows a task's colon."""


class Policy(Protocol):
    """Decides from observations alone, and remembers its episode."""

    @property
    def name(self) -> str:
        """Return its name."""

    def reset(self, seed: int) -> None:
        """Begin an episode."""

    def act(self, observation: Any) -> int:
        """Return the action."""


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


class Policies(Protocol):
    """The policies of a task."""

    def offers(self) -> Sequence[PolicyOffer]:
        """Return what may be chosen."""

    def check(self, name: str, *others: str) -> str:
        """Return the name when it is on offer; ValueError naming the choices (and `others`) otherwise."""

    def check_size(self, names: Iterable[str], config: Configuration) -> None:
        """Raise ValueError, naming the policy, unless every policy among the names plays this configuration."""

    def load(self, name: str) -> Policy:
        """Return a new policy object: a policy remembers its episode, so each board needs its own."""

    def reset(self, policy: Any, config: Configuration, seed: int) -> None:
        """Reset a policy for an episode of a configuration."""


class Decides(Protocol):
    """How policies of a task are asked together."""

    def act_many(
        self, policies: Sequence[Any], observations: Sequence[Any]
    ) -> Sequence[int | Exception]:
        """Return every board's action, or what its policy raised: the others are decided all the same."""

    def shared_net(self, policy: Any) -> object | None:
        """Return what decides for the policy when it can decide for several at once, else None."""


class Task(Rules, Protocol):
    """An environment on the playground. What is wanted of it (`wanted`) is in its own words: a message of its own."""

    @property
    def steps_on(self) -> Executor | None:
        """Return the threads on which its runs step; None where a step takes microseconds."""

    @property
    def daily(self) -> Configuration:
        """Return what the daily instance is played on."""

    @property
    def policies(self) -> Policies:
        """Return the policies on offer."""

    @property
    def decides(self) -> Decides:
        """Return how its policies are asked together, on a thread."""

    def levels(self) -> list[dict[str, Any]]:
        """Return the levels on offer, as the API lists them."""

    def maps(self) -> list[dict[str, Any]]:
        """Return the given instances on offer, as the API lists them."""

    def first(self, wanted: Any) -> Choice:
        """Return what a new board is to begin on; ValueError where it is not on offer."""

    def next(self, was: Cause, wanted: Any) -> Choice:
        """Return what a board's next episode is to begin on: what is left out stays as it was."""

    def again(self, was: Cause) -> Choice:
        """Return what an episode began on, to be played once more."""

    def wanted_again(self, config: Configuration, wanted: Any, **rest: Any) -> WantedBoard:
        """Return what begins an episode that is wanted, of a configuration, on a board of its own."""

    def describe(self, was: Cause) -> dict[str, Any]:
        """Return what a page is told of the configuration."""

    def begin(self, choice: Choice) -> Run:
        """Return a run at its start; ValueError before a seed is drawn, or where it cannot be made.

        TaskFullError where no further run can begin at the moment. NotReadyError: see `on_threads`.
        """

    def viewer(self) -> Any:
        """Return the 3-D view of a server's boards (`Services.viewer`); None where there is none."""

    def is_getting_ready(self) -> bool:
        """Return whether something that a board waits for is being made ready beside the server (`NotReadyError`)."""

    def guards(self) -> str:
        """Return what guards the server from its runs, a sentence; "" where none is needed. ValueError where none can begin."""

    def close(self) -> None:
        """End what runs beside the server for it."""


async def on_threads(task: Task, function: Callable[..., T], *arguments: Any) -> T:
    """Return what a function comes to on a task's threads, or on those of the event loop where it has none.

    It is called again when what it lacked is ready, and no thread waits meanwhile.
    """
    loop = asyncio.get_running_loop()
    while True:
        try:
            return await loop.run_in_executor(task.steps_on, function, *arguments)
        except NotReadyError as error:
            await error.wait()
