"""The leaderboard's entries: configurations that people play, and closed studies.

In a closed study people and policies are on the very same terrains. An open one is not shown: a mean that changes with every
episode would reveal hidden scores to its players. `make_board` makes the figures that the package comes with.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import numpy as np

from humanplay.db.reader import Reader
from humanplay.db.series import closed_studies, count_participants
from humanplay.db.trial import Trial
from humanplay.jobs import Jobs, Progress
from humanplay.report.statistics.exclusion_sets import members, people_of
from humanplay.report.statistics.human_level import VolunteerFigure, VolunteerFigures
from humanplay.report.statistics.study_figures import ShownFigure, live_figure
from humanplay.report.statistics.summaries import (
    Curve,
    EpisodeSummary,
    Pictures,
    TrialSummary,
    summarize_groups,
    trial_summaries,
)
from humanplay.results.evaluations import (
    Evaluation,
    ShippedFigure,
    ShippedFigures,
    boards_of,
    file_sha256,
    to_document,
)
from humanplay.study.data import StudyData, load
from humanplay.study.policy_episodes import closed_seeds
from humanplay.study.policy_files import FOLDER, PolicyFiles
from humanplay.task import Configuration, PolicyError, place_of
from humanplay.task.registration import DEFAULT_TASK, environment_of


@dataclass(frozen=True)
class LeaderboardEntry:
    """A configuration and the terrains on which policies are compared with people.

    id        in the page's address
    people    the figure of a study's people with their pictures; None for none
    volunteers  the figure of the playground's; None while nobody has played
    seeds     of the policies' terrains
    study     its name; None for an entry of the playground
    policies  names (or paths); None means everything on offer
    files     of a study's policies
    task      whose configuration it is
    """

    id: str
    title: str
    config: Configuration
    people: StudyPeople | None
    volunteers: VolunteerFigure | None
    seeds: tuple[int, ...]
    study: str | None = None
    policies: tuple[str, ...] | None = None
    files: PolicyFiles | None = None
    task: str = DEFAULT_TASK

    def evaluations(self, sources: dict[str, str]) -> dict[str, Evaluation]:
        """Return what has to be evaluated by the policy's name, quick policies first.

        sources  what `policies.load` takes, by name. A study's policies are played from their own files; where one is lost,
                 its evaluation names the place where it was kept, and fails
        """
        slow = environment_of(self.task).policies.slow
        chosen = list(sources) if self.policies is None else self.policies
        ordered = sorted(chosen, key=lambda name: slow.index(name) + 1 if name in slow else 0)
        policy_sources = {name: self._source(name, sources) for name in ordered}
        return {
            name: Evaluation(source, self.config, self.seeds, self.task)
            for name, source in policy_sources.items()
        }

    def _source(self, name: str, sources: dict[str, str]) -> str:
        if self.files is None or name not in self.files.hashes:
            return sources.get(name, name)
        try:
            return self.files.source(name)
        except PolicyError:
            return str(self.files.place(name))

    def to_dict(self) -> dict[str, object]:
        """Return the entry as the list of the leaderboard shows it."""
        figure, config = self.people or self.volunteers, self.config
        return {
            "id": self.id, "title": self.title, "study": self.study, "place": place_of(environment_of(self.task), config),
            "max_steps": config.limit,
            "config_hash": config.hash, "terrains": len(self.seeds),
            "players": 0 if figure is None else figure["players"],
            "episodes": 0 if figure is None else figure["episodes"],
            "missing": None if self.volunteers is None else self.volunteers["missing"],
        }  # fmt: skip


class BoardPictures(TypedDict):
    """A board's coverage curve, visited cells and trials; None and empty for nobody."""

    curve: Curve | None
    visits: list[list[float]] | None
    trials: list[TrialSummary]


class StudyPeople(ShownFigure, BoardPictures):
    """The figure of a closed study's people, with their pictures."""

    claim: str
    set: str
    everybody: ShownFigure
    completed: float


class ClosedStudies:
    """The closed studies of a database; each is read once, because it never changes.

    studies  the folder of studies, which keeps the files of their policies
    """

    def __init__(self, studies: Path) -> None:
        self._folder = studies
        self._known: dict[tuple[str, int | None, int], tuple[StudyData, StudyPeople | None]] = {}

    def read(self, reader: Reader) -> list[tuple[StudyData, StudyPeople | None]]:
        """Every closed study with its people's figure and pictures.

        None: no figure of it can be shown. A study of a task without boards is left out: there is
        nothing to compare by. The first call takes seconds.
        """
        studies = []
        for study in closed_studies(reader):
            if environment_of(json.loads(study.protocol).get("task", DEFAULT_TASK)).boards is None:
                continue
            # one who is forgotten afterwards is gone from here as well
            key = (study.name, study.closed_ms, count_participants(reader, study.name))
            if key not in self._known:
                data = load(reader, study.name).with_policies_in(self._folder / study.name / FOLDER)
                self._known[key] = (data, _people(reader, data))
            studies.append(self._known[key])
        return studies


def _people(reader: Reader, data: StudyData) -> StudyPeople | None:
    figure = live_figure(data)
    if not figure["everybody"]["players"]:
        return None
    cohort = people_of(data)
    people = members(cohort, data.protocol.per_protocol) or members(cohort, {})
    if not people:  # nothing that may be drawn is attested
        return None
    groups = [[_totals_of(trial) for trial in cohort.ranked[person]] for person in people]
    shares = [np.mean([trial.succeeded for trial in group]) for group in groups]
    pictures = summarize_groups(reader, data, synthetic=False).get("people", Pictures())
    return {
        "claim": figure["claim"],
        "set": figure["set"],
        "players": figure["players"],
        "episodes": figure["episodes"],
        "score": figure["score"],
        "steps": figure["steps"],
        "everybody": figure["everybody"],
        "completed": float(np.mean(shares)),
        "curve": pictures.get("curve"),
        "visits": pictures.get("visits"),
        "trials": trial_summaries(groups),
    }


def _totals_of(trial: Trial) -> EpisodeSummary:
    steps = trial.steps_to_target or 0
    return EpisodeSummary(trial.succeeded, trial.score or 0.0, steps, (), (), 0)


def list_entries(
    reader: Reader,
    studies: ClosedStudies,
    volunteers: VolunteerFigures,
    task: str = DEFAULT_TASK,
) -> list[LeaderboardEntry]:
    """Every entry of the leaderboard, in the order in which it is shown.

    Closed studies come first, then configurations by the number of episodes that ended. Abandoned
    ones do not count, so nobody puts a board first by leaving it. A `task` without boards has
    studies alone.
    """
    of_studies = [_of_study(data, people) for data, people in studies.read(reader)]
    environment = environment_of(task)
    if environment.boards is None:
        return of_studies
    played = {
        config.hash: (0, entry_of(config, task=task)) for config in environment.boards.offered
    }
    for figure in volunteers.human_level(reader)["figures"]:
        if figure["task"] != task:
            continue
        config = environment.configuration(figure["config"])
        ended = figure["episodes"] - figure["abandoned"]
        played[config.hash] = ended, entry_of(config, figure, task)
    in_order = sorted(played.values(), key=lambda pair: -pair[0])
    return [*of_studies, *(entry for _, entry in in_order)]


def _of_study(data: StudyData, people: StudyPeople | None) -> LeaderboardEntry:
    protocol, seeds = data.protocol, tuple(closed_seeds(data).values())
    return LeaderboardEntry(
        f"study-{protocol.name}", protocol.title, protocol.env_config, people, None, seeds,
        protocol.name, protocol.policies, data.policy_files, protocol.task,
    )  # fmt: skip


def entry_of(
    config: Configuration, volunteers: VolunteerFigure | None = None, task: str = DEFAULT_TASK
) -> LeaderboardEntry:
    """The entry of a playground configuration; no volunteers if nobody has played it."""
    boards = boards_of(task)
    name, title = boards.name_of(config)
    return LeaderboardEntry(name, title, config, None, volunteers, boards.seeds(config), task=task)


def offered_boards(task: str = DEFAULT_TASK) -> dict[str, LeaderboardEntry]:
    """The boards on offer by their ids."""
    entries = [entry_of(config, task=task) for config in boards_of(task).offered]
    return {entry.id: entry for entry in entries}


def make_board(
    entry: LeaderboardEntry,
    jobs: Jobs,
    advance: Progress,
    shipped: ShippedFigures | None = None,
    again: Sequence[str] = (),
) -> str:
    """Play a board's policies and return the text of its file.

    shipped  figures that are taken where they still hold, except for the policies in `again`

    `advance` is called with the number of policies that are done and their number.
    """
    command = f"humanplay leaderboard --board {entry.id} --out data/leaderboard"
    every = environment_of(entry.task).policies.offers()
    offers = [offer for offer in every if offer.plays(entry.config)]
    sources = {offer.name: offer.source for offer in offers}
    wanted = list(entry.evaluations(sources).values())
    waiting = []
    for evaluation in reversed(wanted):  # the slowest first
        old = (
            shipped.find(evaluation)
            if shipped is not None and evaluation.policy not in again
            else None
        )
        waiting.append(old or jobs.submit(make_figure, evaluation, command))
    figures = []
    for figure in reversed(waiting):
        figures.append(figure if isinstance(figure, ShippedFigure) else figure.result())
        advance(len(figures), len(wanted))
    return to_document(entry.config, entry.seeds, figures, command, entry.task)


def make_figure(wanted: Evaluation, command: str) -> ShippedFigure:
    """Play an evaluation and return its figure."""
    figure, steps = wanted.play()
    digest = file_sha256(wanted.policy, wanted.task)
    return ShippedFigure(wanted.policy, digest, tuple(steps), figure, command)
