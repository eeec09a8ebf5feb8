"""A server's leaderboard: people from the database, policies from background jobs."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

from humanplay.db.file import studies_beside
from humanplay.db.reader import Reader
from humanplay.db.trial import Trial
from humanplay.jobs import Jobs
from humanplay.report.statistics.human_level import (
    LEAST_EPISODES,
    Counts,
    VolunteerFigure,
    VolunteerFigures,
)
from humanplay.report.statistics.study_figures import MeanInterval
from humanplay.report.statistics.summaries import (
    EpisodeSummary,
    curve_and_visits,
    summary_of_record,
    trial_summaries,
)
from humanplay.results.entries import (
    BoardPictures,
    ClosedStudies,
    LeaderboardEntry,
    StudyPeople,
    list_entries,
)
from humanplay.results.evaluations import PolicyEvaluations, ShippedFigures
from humanplay.task import Configuration, PolicyOffer
from humanplay.task.registration import DEFAULT_TASK


class UnknownEntryError(LookupError):
    """The leaderboard has no entry with this id."""


class Leaderboard:
    """Reads people from the database and has the policies on offer evaluated.

    There is one reading at a time, and all who ask while one is under way share the next.

    volunteers  their figures, which other requests read as well
    """

    def __init__(
        self,
        database: Path,
        offers: Sequence[PolicyOffer],
        jobs: Jobs,
        task: str = DEFAULT_TASK,
    ) -> None:
        self._database, self._offers, self._task = database, offers, task
        figures = database.with_name(database.name + "-figures.json")
        shipped = ShippedFigures()
        self._evaluations = PolicyEvaluations(figures, jobs, shipped, task)
        self.volunteers = VolunteerFigures()
        self._people = HumanSummaries()
        self._studies = ClosedStudies(studies_beside(database))
        self._reading = threading.Lock()
        self._turn = asyncio.Lock()
        self._next: asyncio.Task[list[LeaderboardEntry]] | None = None

    def entries(self) -> list[LeaderboardEntry]:
        """Return every entry; one thread at a time reads what has not been read before."""
        with self._reading, closing(Reader.open(self._database, public=True)) as reader:
            entries = list_entries(reader, self._studies, self.volunteers, self._task)
            played = [entry for entry in entries if entry.study is None]
            self._people.drop_all_but((entry.config.hash, entry.volunteers) for entry in played)
        return entries

    async def newest_entries(self) -> list[LeaderboardEntry]:
        """Return every entry as the database has it now, whoever else asks."""
        if self._next is None:
            self._next = asyncio.create_task(self._read_in_turn(), name="leaderboard")
        return await asyncio.shield(self._next)

    async def _read_in_turn(self) -> list[LeaderboardEntry]:
        async with self._turn:
            self._next = None  # this reading may miss what is written from now on
            return await asyncio.to_thread(self.entries)

    async def detail(self, entry_id: str, evaluates: bool) -> dict[str, object]:
        """Return everything about one entry; UnknownEntryError when there is none.

        evaluates  begin the evaluations that are missing
        """
        entries = await self.newest_entries()
        entry = next((entry for entry in entries if entry.id == entry_id), None)
        if entry is None:
            raise UnknownEntryError(
                f"no board {entry_id!r} on the leaderboard; GET api/leaderboard lists them"
            )
        async with self._turn:
            people = await asyncio.to_thread(self._people_of, entry)
        sources = {offer.name: offer.source for offer in self._offers if offer.plays(entry.config)}
        wanted = entry.evaluations(sources)
        summaries = {offer.source: offer.summary for offer in self._offers}
        states = self._evaluations.request(list(wanted.values()), evaluates)
        policies = [
            {"name": name, "summary": summaries.get(evaluation.policy, ""), **state}
            for (name, evaluation), state in zip(wanted.items(), states, strict=True)
        ]
        return {"board": entry.to_dict(), "people": people, "policies": policies}

    def _people_of(self, entry: LeaderboardEntry) -> StudyPeople | VolunteerPeople | None:
        volunteers = entry.volunteers
        if volunteers is None or volunteers["missing"]:
            return entry.people
        with self._reading, closing(Reader.open(self._database, public=True)) as reader:
            pictures = self._people.pictures(reader, entry.config, volunteers)
        return {
            **volunteers["entering"],
            "score": volunteers["score"],
            "steps": volunteers["steps"],
            "completed": volunteers["completed"],
            **pictures,
        }


MAX_EPISODES = 1000
"""Episodes behind the pictures of a board: the newest so many."""

MAX_MOVES = 2_000_000
"""Moves of all episodes whose replays are kept, 8 bytes each; an episode counts OVERHEAD moves more."""
OVERHEAD = 64

Course = tuple[str, str, str]
"""What decides how an episode went: the hash of its trajectory, its outcome, and the version of the rules."""
Replays = dict[Course, EpisodeSummary | None]
"""Replayed episodes; None where another version of the rules made one."""


class VolunteerPeople(Counts, BoardPictures):
    """The people of a board on offer: their figures and their pictures."""

    score: MeanInterval | None
    steps: MeanInterval | None
    completed: float | None


class HumanSummaries:
    """Curves and visit maps for each configuration, kept until its figure is another.

    Then the episodes that have come are replayed, and the other ones' replays are used again. They are kept under the hashes of
    their trajectories, those of the latest boards that fit into MAX_MOVES; what has left a board is dropped when it is read.
    """

    def __init__(self) -> None:
        self._made: dict[str, tuple[str, BoardPictures]] = {}
        self._replays: dict[str, Replays] = {}

    def pictures(
        self, reader: Reader, config: Configuration, figure: VolunteerFigure
    ) -> BoardPictures:
        """The pictures of the people behind a figure of `human_level`.

        It takes seconds: call it in a thread.
        """
        state = json.dumps(figure)
        if self._made.get(config.hash, ("",))[0] != state:
            now: Replays = {}
            pictures = _pictures(reader, config, self._replays.pop(config.hash, {}), now)
            self._made[config.hash] = state, pictures
            self._keep(config.hash, now)
        return self._made[config.hash][1]

    def drop_all_but(self, figures: Iterable[tuple[str, VolunteerFigure | None]]) -> None:
        """Drop outdated pictures, and replays of configurations without a figure.

        figures  (hash of the configuration, figure or None) of every board
        """
        states = {config: json.dumps(figure) for config, figure in figures if figure is not None}
        self._made = {
            config: (state, pictures)
            for config, (state, pictures) in self._made.items()
            if states.get(config) == state
        }
        self._replays = {
            config: replays for config, replays in self._replays.items() if config in states
        }

    def _keep(self, config: str, replays: Replays) -> None:
        """Keep a board's replays, and as many of earlier boards as there is room for."""
        self._replays[config] = replays
        sizes = {
            board: sum(map(_size, board_replays.values()))
            for board, board_replays in self._replays.items()
        }
        for oldest in list(self._replays)[:-1]:
            if sum(sizes.values()) > MAX_MOVES:
                del self._replays[oldest], sizes[oldest]
        while sizes[config] > MAX_MOVES:
            sizes[config] -= _size(replays.popitem()[1])


def _size(summary: EpisodeSummary | None) -> int:
    return OVERHEAD + (len(summary.path) if summary is not None else 0)


def _pictures(
    reader: Reader, config: Configuration, earlier: Replays, now: Replays
) -> BoardPictures:
    """Return a board's pictures; `now` gets its replays, from `earlier` if there."""
    people: dict[str, list[EpisodeSummary]] = {}
    for trial in reader.newest_counted(config.hash, MAX_EPISODES):
        course = (trial.trajectory_hash or "", trial.outcome or "", trial.core_version)
        if course not in now:
            now[course] = earlier[course] if course in earlier else _replay_summary(reader, trial)
        if (summary := now[course]) is not None:
            people.setdefault(trial.owner_id or "", []).append(summary)
    groups = [episodes for episodes in people.values() if len(episodes) >= LEAST_EPISODES]
    if not groups:
        return {"curve": None, "visits": None, "trials": []}
    drawn, trials = curve_and_visits(config, groups), trial_summaries(groups)
    return {"curve": drawn.get("curve"), "visits": drawn.get("visits"), "trials": trials}


def _replay_summary(reader: Reader, trial: Trial) -> EpisodeSummary | None:
    """Return an episode's summary; None if this version's rules cannot replay it."""
    try:
        return summary_of_record(trial.environment, trial.record(reader.steps(trial.id)))
    except ValueError:
        return None
