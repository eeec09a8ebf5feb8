"""A board's people, by how many moves more than Expert they need.

The terrains are ranked ones.

All ranked terrains of a period count that Expert finishes, so nobody picks their best. A terrain
counts MOST_BEHIND at most, and so does one that was not finished. People are ranked by the worse
end of their mean's interval, so that a few lucky terrains count for little.
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypedDict

import numpy as np

from humanplay.db.names import OwnName, own, shown_names
from humanplay.db.reader import Reader
from humanplay.db.volunteers import RankedRun, ranked_runs, state_of
from humanplay.jobs import Jobs, JobsFullError
from humanplay.report.statistics.intervals import interval
from humanplay.report.statistics.summaries import summary_of
from humanplay.results.evaluations import OWNER, boards_of, policy_hash
from humanplay.task import Configuration
from humanplay.task.registration import DEFAULT_TASK, environment_of
from marsexplorer.intervals import FEWEST

MOST_BEHIND = 100
"""Moves that a terrain counts at most; one that was not finished counts as many."""
SHOWN = 100
"""People in the table."""
WEEK_MS = 7 * 24 * 3_600_000
BATCH = 20
"""Terrains that a job plays."""
LIMIT_S = 600.0
"""Seconds of a job."""

_log = logging.getLogger(__name__)


class Standing(NamedTuple):
    """A person's mean over their terrains.

    `worse` is the worse end of its 95 % interval; None below FEWEST terrains.
    """

    player_id: str
    terrains: int
    behind: float
    worse: float | None


class PersonRow(TypedDict):
    """A row of the table; without a name where none was chosen."""

    place: int
    name: str | None
    behind: float
    worse: float
    terrains: int
    you: bool


class OwnStanding(OwnName):
    """Where whoever asks stands.

    missing    terrains that count before they have a place
    comparing  theirs on which Expert has not driven yet
    """

    place: int | None
    behind: float | None
    worse: float | None
    terrains: int
    missing: int
    comparing: int


class PeopleTable(TypedDict):
    """The board.

    title      of the board's terrains
    ranked       how many people have a place
    comparing    terrains on which Expert has not driven yet
    fewest       terrains from which on somebody has a place
    most_behind  moves that a terrain counts at most
    """

    title: str
    people: list[PersonRow]
    ranked: int
    comparing: int
    fewest: int
    most_behind: int
    you: OwnStanding | None


def standings(runs: Iterable[RankedRun], expert: Mapping[int, int | None]) -> list[Standing]:
    """Everybody's standing: the ranked ones first, by the worse end of their interval.

    Args:
        runs: Ranked episodes, left out where Expert has not driven yet or did not finish.
        expert: Expert's moves by a terrain's seed; None where it did not finish.
    """
    behind: dict[str, list[float]] = {}
    for run in runs:
        if (moves := expert.get(run.seed)) is None:
            continue
        gap = MOST_BEHIND if run.moves is None else min(MOST_BEHIND, run.moves - moves)
        behind.setdefault(run.player_id, []).append(gap)
    people = list(behind.items())
    worse = _worse_ends([gaps for _, gaps in people])
    everybody = [
        Standing(player, len(gaps), float(np.mean(gaps)), end)
        for (player, gaps), end in zip(people, worse, strict=True)
    ]
    unranked = float("inf")
    return sorted(
        everybody, key=lambda one: (unranked if one.worse is None else one.worse, one.behind)
    )


def _worse_ends(people: Sequence[Sequence[float]]) -> list[float | None]:
    """The worse end of each person's interval; all of one number of terrains at once."""
    ends: list[float | None] = [None] * len(people)
    for count in {len(moves) for moves in people if len(moves) >= FEWEST}:
        places = [place for place, moves in enumerate(people) if len(moves) == count]
        table = np.array([people[place] for place in places], dtype=np.float64)[:, :, None]
        _, high = interval(table, float(MOST_BEHIND), terrains_drawn=False)
        for place, end in zip(places, high, strict=True):
            ends[place] = min(float(MOST_BEHIND), float(end))
    return ends


def expert_moves(task: str, config: Configuration, seeds: Sequence[int]) -> list[int | None]:
    """Moves that Expert needs on terrains, None where it does not finish; a job."""
    environment = environment_of(task)
    assert environment.expert is not None
    policy = environment.policies.load(environment.expert, config)
    runs = (environment.policies.play(policy, config, seed, seed) for seed in seeds)
    episodes = [summary_of(environment, run) for run in runs]
    return [episode.steps if episode.succeeded else None for episode in episodes]


class ExpertRuns:
    """Expert's moves on ranked terrains, each run once by a job, kept in a file.

    path  JSON lines: what the moves depend on, the seed, the moves (null where it did not finish)
    """

    def __init__(self, path: Path, jobs: Jobs, config: Configuration, task: str) -> None:
        self._path, self._jobs, self._config, self._task = path, jobs, config, task
        self._lock = threading.Lock()
        self._running: Future[list[int | None]] | None = None
        self._batch = BATCH
        self._key = ""
        self._moves: dict[int, int | None] = {}

    def moves(self) -> dict[int, int | None]:
        """Expert's moves by the seed of what it has played; None where it did not finish."""
        with self._lock:
            if not self._key:
                self._key = self._depends_on()
                self._moves = self._read_stored()
            return dict(self._moves)

    def play(self, seeds: Sequence[int]) -> None:
        """Have some of the terrains played that were not yet."""
        with self._lock:
            missing = [seed for seed in seeds if seed not in self._moves]
            if not missing or self._running is not None:
                return
            batch = tuple(missing[: self._batch])
            call = partial(expert_moves, self._task, self._config, batch)
            key = ("expert", self._key, batch)
            try:
                running = self._jobs.submit(call, owner=OWNER, key=key, limit_s=LIMIT_S)
            except JobsFullError:
                return
            self._running = running
        running.add_done_callback(partial(self._keep, batch))

    def _depends_on(self) -> str:
        environment = environment_of(self._task)
        source = environment.expert or ""
        digest = policy_hash(source, self._task)
        return "|".join((environment.version, source, digest, self._config.hash))

    def _read_stored(self) -> dict[int, int | None]:
        stored: dict[int, int | None] = {}
        for line in self._path.read_text().splitlines() if self._path.exists() else ():
            try:
                key, seed, moves = json.loads(line)
            except ValueError:
                continue  # the server ended while it was written
            if key == self._key:
                stored[seed] = moves
        return stored

    def _keep(self, seeds: Sequence[int], played: Future[list[int | None]]) -> None:
        with self._lock:
            self._running = None
            if played.cancelled():
                return
            if (error := played.exception()) is not None:
                _log.warning("Expert's runs for the people's board failed: %s", error)
                if len(seeds) == 1:  # left out until the server starts again
                    self._moves[seeds[0]] = None
                self._batch = 1  # so that one terrain stops no other
                return
            with self._path.open("a") as file:
                for seed, moves in zip(seeds, played.result(), strict=True):
                    self._moves[seed] = moves
                    file.write(json.dumps([self._key, seed, moves]) + "\n")


class PeopleBoard:
    """The people's board of a server, read again when an episode has ended since."""

    def __init__(self, database: Path, jobs: Jobs, task: str = DEFAULT_TASK) -> None:
        self._database = database
        boards = boards_of(task)
        self._config = boards.daily
        _, self._title = boards.name_of(self._config)
        path = database.with_name(database.name + "-expert.jsonl")
        self._expert = ExpertRuns(path, jobs, self._config, task)
        self._successes = environment_of(task).successes
        self._reading = threading.Lock()
        self._state: str | None = None
        self._runs: list[RankedRun] = []
        self._standings: dict[bool, tuple[object, list[Standing]]] = {}

    @property
    def config_hash(self) -> str:
        """The hash of the configuration that it is played on."""
        return str(self._config.hash)

    def expert_moves(self, seeds: Sequence[int]) -> dict[int, int | None]:
        """Expert's moves by the seed, where it has driven; it drives on the others soon.

        None where it did not finish.
        """
        moves = self._expert.moves()
        self._expert.play(seeds)
        return {seed: moves[seed] for seed in seeds if seed in moves}

    def table(self, player_id: str | None, since_ms: int) -> PeopleTable:
        """The board of the ranked episodes that ended since a time; call it in a thread."""
        with self._reading, closing(Reader.open(self._database, public=True)) as reader:
            state = state_of(reader, self._config.hash)
            if state != self._state:
                self._runs = ranked_runs(reader, self._config.hash, self._successes)
                self._state = state
            names = shown_names(reader)
            name = None if player_id is None else own(reader, player_id)
            expert = self._expert.moves()
            runs = [run for run in self._runs if run.ended_ms >= since_ms]
            everybody = self._rank(runs, expert, is_whole=since_ms == 0)
        waiting = [run for run in runs if run.seed not in expert]
        self._expert.play([run.seed for run in waiting])
        ranked = [one for one in everybody if one.worse is not None]
        mine = next((one for one in everybody if one.player_id == player_id), None)
        own_waiting = sum(run.player_id == player_id for run in waiting)
        place = ranked.index(mine) + 1 if mine in ranked and mine is not None else None
        return {
            "title": self._title,
            "people": [
                _row(number, one, names.get(one.player_id), one.player_id == player_id)
                for number, one in enumerate(ranked[:SHOWN], 1)
            ],
            "ranked": len(ranked),
            "comparing": len(waiting),
            "fewest": FEWEST,
            "most_behind": MOST_BEHIND,
            "you": None if name is None else _own(name, mine, place, own_waiting),
        }

    def _rank(
        self, runs: Sequence[RankedRun], expert: Mapping[int, int | None], is_whole: bool
    ) -> list[Standing]:
        """The standings; recomputed only after new episodes or new runs of Expert."""
        state = (self._state, len(runs), len(expert))
        known_state, everybody = self._standings.get(is_whole, (None, []))
        if known_state != state:
            everybody = standings(runs, expert)
            self._standings[is_whole] = state, everybody
        return everybody


def _row(place: int, one: Standing, name: str | None, is_you: bool) -> PersonRow:
    assert one.worse is not None
    return {
        "place": place,
        "name": name,
        "behind": one.behind,
        "worse": one.worse,
        "terrains": one.terrains,
        "you": is_you,
    }


def _own(name: OwnName, mine: Standing | None, place: int | None, comparing: int) -> OwnStanding:
    terrains = 0 if mine is None else mine.terrains
    return {
        **name,
        "place": place,
        "behind": None if mine is None else mine.behind,
        "worse": None if mine is None else mine.worse,
        "terrains": terrains,
        "missing": max(0, FEWEST - terrains),
        "comparing": comparing,
    }
