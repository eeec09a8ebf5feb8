"""Policies' figures: shipped with the package, or computed on the first request.

A computed figure is kept in a file.

A figure belongs to (core version, policy with its file, configuration, seeds); when one of these changes, it is made again. No
figure is ever guessed: until it is ready, its progress is shown.
"""

from __future__ import annotations

import hashlib
import json
import logging
import threading
from collections.abc import Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Literal, TypedDict

from humanplay import SHIPPED_DATA
from humanplay.jobs import Jobs, JobsFullError, Progress
from humanplay.report.statistics.summaries import (
    EpisodesFigure,
    EpisodeSummary,
    summarize_episodes,
    summary_of,
)
from humanplay.task import Boards, Configuration, PolicyError
from humanplay.task.registration import DEFAULT_TASK, environment_of
from marsexplorer.files import write_whole

OWNER = "policies"
"""Whose jobs evaluations are: they take turns with what people ask for."""
LIMIT_S = 2 * 3600.0
"""Seconds for a policy's episodes; `lookahead` takes minutes on large boards."""
FOLDER = SHIPPED_DATA / "leaderboard"
FORMAT = 1

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Evaluation:
    """A policy on the terrains of some seeds, and everything its figure depends on.

    `policy` is its name or path.
    """

    policy: str
    config: Configuration
    seeds: tuple[int, ...]
    task: str = DEFAULT_TASK

    @property
    def key(self) -> str:
        """Everything that the figure depends on, as one string."""
        digest = policy_hash(self.policy, self.task)
        parts = (self.policy, digest, self.config.hash, _digest(self.seeds))
        return "|".join((environment_of(self.task).version, *parts))

    def play(self, progress: Progress | None = None) -> tuple[EpisodesFigure, list[int]]:
        """Return the figure, and the counted moves on each terrain.

        `progress` is called with (episodes played, episodes in all).
        """
        environment = environment_of(self.task)
        policy = environment.policies.load(self.policy, self.config)
        played: list[EpisodeSummary] = []
        for seed in self.seeds:
            run = environment.policies.play(policy, self.config, seed, seed)
            played.append(summary_of(environment, run))
            if progress:
                progress(len(played), len(self.seeds))
        figure = summarize_episodes(self.config, [[episode] for episode in played])
        return figure, [episode.steps for episode in played]


def boards_of(task: str) -> Boards:
    """The boards of a task; ValueError if it has none."""
    if (boards := environment_of(task).boards) is None:
        raise ValueError(f"{environment_of(task).about.title} has no leaderboard")
    return boards


@lru_cache(64)
def policy_hash(source: str, task: str = DEFAULT_TASK) -> str:
    """SHA-256 (hex) of all that decides; "" for code that may change unseen."""
    return environment_of(task).policies.hash_with_code(source) or ""


@dataclass(frozen=True)
class ShippedFigure:
    """A policy's figure.

    command  made its file
    steps    moves of a success on each terrain, else the limit, in the order of the seeds
    figure  as `humanplay.report.statistics.summaries.summarize_episodes` returns it
    """

    policy: str
    file_sha256: str | None
    steps: tuple[int, ...]
    figure: EpisodesFigure
    command: str


class ShippedFigures:
    """The figures in the package, so that a new server's leaderboard is full at once.

    `humanplay leaderboard --out data/leaderboard` makes them: a file for each configuration on offer, a line in it for each
    policy. A figure is shown only where everything that it depends on is the same here: the core version, the configuration,
    the terrains, and the policy's own file. Whether the code of the rules still plays alike is tested by playing again.
    """

    def __init__(self, folder: Path = FOLDER) -> None:
        self._folder = folder
        self._read: dict[str, list[ShippedFigure]] = {}

    def find(self, wanted: Evaluation) -> ShippedFigure | None:
        """Return the shipped figure of an evaluation; None if none holds on this version."""
        key = f"{wanted.config.hash}|{_digest(wanted.seeds)}"
        if key not in self._read:
            path = self._folder / file_name(wanted.config, wanted.task)
            self._read[key] = _read_shipped(path, key, wanted.task)
        policy = wanted.policy, file_sha256(wanted.policy, wanted.task)
        figures = self._read[key]
        return next((row for row in figures if (row.policy, row.file_sha256) == policy), None)


def file_name(config: Configuration, task: str = DEFAULT_TASK) -> str:
    """The name of a configuration's file of shipped figures."""
    return f"{boards_of(task).name_of(config)[0]}.json"


@cache
def file_sha256(policy: str, task: str = DEFAULT_TASK) -> str | None:
    """SHA-256 (hex) of a policy's file; None for code, and if the file is lost."""
    try:
        return environment_of(task).policies.hash_of(policy)
    except PolicyError:
        return None


def to_document(
    config: Configuration,
    seeds: Iterable[int],
    figures: Iterable[ShippedFigure],
    command: str,
    task: str = DEFAULT_TASK,
) -> str:
    """Return the shipped figures' file as JSON text, one line for each policy."""
    head = {
        "format": FORMAT, "core_version": environment_of(task).version, "command": command, "config": config.to_dict(),
        "depends_on": f"{config.hash}|{_digest(seeds)}",
    }  # fmt: skip
    rows = [{**vars(figure)} for figure in figures]
    for row in rows:
        del row["command"]
    lines = ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)
    return json.dumps(head)[:-1] + f', "policies": [\n{lines}\n]}}\n'


State = Literal["ready", "missing", "waiting", "computing", "failed"]


class FigureOrigin(TypedDict):
    """The command that made a figure which came with the package."""

    command: str


class FigureState(TypedDict):
    """The state of a figure: how many episodes are done; `shipped` if packaged."""

    state: State
    done: int
    of: int
    figure: EpisodesFigure | None
    shipped: FigureOrigin | None
    error: str | None


class PolicyEvaluations:
    """Returns ready figures and computes missing ones in the order of requests.

    path  the file that keeps them
    """

    def __init__(
        self,
        path: Path,
        jobs: Jobs,
        shipped: ShippedFigures | None = None,
        task: str = DEFAULT_TASK,
    ) -> None:
        self.path = path
        self._jobs, self._shipped = jobs, shipped
        self._done = _read_kept(path, task)
        self._making: dict[str, Future[tuple[EpisodesFigure, list[int]]]] = {}
        self._progress: dict[str, int] = {}
        self._writing = threading.Lock()

    def request(self, wanted: Sequence[Evaluation], begins: bool = True) -> list[FigureState]:
        """Return how far each figure is; if `begins`, what is missing is begun.

        What failed is tried again after some minutes.
        """
        return [self._state(evaluation, evaluation.key, begins) for evaluation in wanted]

    def _state(self, wanted: Evaluation, key: str, begins: bool) -> FigureState:
        came = self._shipped.find(wanted) if self._shipped and key not in self._done else None
        figure = came.figure if came else self._done.get(key)
        state, error = ("ready", None) if figure else self._begun(wanted, key, begins)
        count = len(wanted.seeds)
        return {
            "state": state,
            "done": count if figure else self._progress.get(key, 0),
            "of": count,
            "figure": figure,
            "shipped": {"command": came.command} if came else None,
            "error": error,
        }

    def _begun(self, wanted: Evaluation, key: str, begins: bool) -> tuple[State, str | None]:
        """Begin the missing figure if `begins`; return its state and its error."""

        def note(done: int, _: int) -> None:
            self._progress[key] = done

        future = self._making.get(key)
        if future is None:
            if not begins:
                return "missing", None
            try:
                future = self._jobs.submit(
                    wanted.play, owner=OWNER, key=key, limit_s=LIMIT_S, on_progress=note
                )
            except JobsFullError:
                return "waiting", None
            if future.done() and (error := future.exception()) is not None:
                return "failed", str(error) or type(error).__name__
            self._making[key] = future
            future.add_done_callback(lambda done: self._keep(key, done))
        return ("computing" if future.running() else "waiting"), None

    def _keep(self, key: str, future: Future[tuple[EpisodesFigure, list[int]]]) -> None:
        """Write a figure to the file; if the disk is full, warn.

        The next server then computes it again.
        """
        with self._writing:
            if not future.cancelled() and future.exception() is None:
                self._done[key] = future.result()[0]
                try:
                    with write_whole(self.path) as file:
                        file.write(json.dumps(self._done, separators=(",", ":")).encode())
                except OSError as error:
                    _log.warning("figures were not kept in %s: %s", self.path, error.strerror)
            self._progress.pop(key, None)
            del self._making[key]


def _read_kept(path: Path, task: str) -> dict[str, EpisodesFigure]:
    """Return this core version's figures in a file; none if it is absent or broken."""
    try:
        figures, version = json.loads(path.read_bytes()), f"{environment_of(task).version}|"
        return {key: figure for key, figure in figures.items() if key.startswith(version)}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}


def _read_shipped(path: Path, key: str, task: str) -> list[ShippedFigure]:
    """Return a file's figures; none if absent, or of other terrains or rules."""
    try:
        document = json.loads(path.read_bytes())
    except OSError:
        return []
    names = ("format", "core_version", "depends_on")
    if [document[name] for name in names] != [FORMAT, environment_of(task).version, key]:
        return []
    return [
        ShippedFigure(row["policy"], row["file_sha256"], tuple(row["steps"]), row["figure"], document["command"])
        for row in document["policies"]
    ]  # fmt: skip


def _digest(seeds: Iterable[int]) -> str:
    return hashlib.sha256(",".join(map(str, seeds)).encode()).hexdigest()
