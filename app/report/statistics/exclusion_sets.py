"""Who enters a figure: the exclusion sets, and the tables players x terrains and players x trials they give.

"all" is everybody with a finished ranked episode; the protocol names the others. An episode of a person's enters as it was
played when its attestation reaches the level that the protocol requires and no move was a script's; one that was spoilt enters
as abandoned. A script's table is made by the same rules, its own moves allowed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any, Literal

import numpy as np

from app.board.attestation import level_reaches
from app.db.trial import Trial
from app.report.statistics.formatting import percent
from app.series.data import Person, StudyData
from marsexplorer.intervals import Floats

MetricName = Literal["score", "steps"]
METRICS: tuple[MetricName, ...] = ("score", "steps")
ALL = "all"


@dataclass(frozen=True)
class Cohort:
    """The participants of one kind, and their finished ranked and warm-up episodes by participant, in the order played."""

    name: str
    kind: str
    people: tuple[Person, ...]
    ranked: Mapping[str, tuple[Trial, ...]]
    warm_up: Mapping[str, tuple[Trial, ...]]
    terrains: int
    practice: int

    def table(
        self, ids: Sequence[str], metric: MetricName, by: Literal["terrain", "trial"] = "terrain"
    ) -> Floats:
        """Return float64[players, ranked terrains or trials], NaN where not finished."""
        column = "terrain_index" if by == "terrain" else "trial"
        own = [self.ranked[person] for person in ids]
        return _filled(own, self.terrains, attrgetter(column), partial(metric_value, metric=metric))

    def warm_up_table(self, ids: Sequence[str], metric: MetricName) -> Floats:
        """Return float64[players, warm-up trials], NaN where not finished."""
        own = [self.warm_up[person] for person in ids]
        value = partial(metric_value, metric=metric)
        return _filled(own, self.practice, attrgetter("trial"), value)


def _filled(
    trials: Sequence[Sequence[Trial]],
    columns: int,
    column: Callable[[Trial], int],
    value: Callable[[Trial], float],
) -> Floats:
    """Return a table with a row for each player's trials, NaN where there is none."""
    found = np.full((len(trials), columns), np.nan)
    for row, own in zip(found, trials, strict=True):
        for each in own:
            if 0 <= column(each) < columns:
                row[column(each)] = value(each)
    return found


def metric_value(trial: Trial, metric: MetricName) -> float:
    """Return a finished trial's normalized score or its steps to 99 %."""
    found = trial.score if metric == "score" else trial.steps_to_target
    assert found is not None
    return float(found)


def ended_ranked(data: StudyData, people: Iterable[Person]) -> list[Trial]:
    """Return the ranked episodes that some participants ended, whoever drove them."""
    ids = {person.id for person in people}
    ended = [each for each in data.trials if each.phase == "ranked" and each.ended_ms is not None]
    return [each for each in ended if each.participant in ids]


def people_of(data: StudyData, as_played: bool = False) -> Cohort:
    """Return the people of a study, with the episodes that may be seen of it now.

    as_played  True leaves spoilt episodes as they were played; they count as abandoned otherwise
    """
    shown = data.shown()
    people = [person for person in shown.people if person.kind == "human"]
    return _cohort(shown, "people", "human", people, as_played)


def scripts_of(data: StudyData) -> list[Cohort]:
    """Return a study's scripts, one cohort for each kind of script."""
    scripts: dict[str, list[Person]] = {}
    for person in data.people:
        if person.kind == "script":
            scripts.setdefault(person.script or "script", []).append(person)
    return [_cohort(data, name, "script", own) for name, own in sorted(scripts.items())]


def _cohort(
    data: StudyData, name: str, kind: str, people: list[Person], as_played: bool = False
) -> Cohort:
    protocol = data.protocol
    played = partial(_finished, data, people, kind, as_played=as_played)
    ranked, warm_up = played("ranked"), played("warm_up")
    return Cohort(name, kind, tuple(people), ranked, warm_up, protocol.ranked, protocol.warm_up)


def _finished(
    data: StudyData, people: list[Person], kind: str, phase: str, as_played: bool
) -> dict[str, tuple[Trial, ...]]:
    """Return each one's finished episodes of a phase that they drove themselves, a person's at the required level or spoilt."""
    found: dict[str, list[Trial]] = {person.id: [] for person in people}
    required = data.protocol.required_attestation
    for trial in data.trials:
        if trial.participant not in found or trial.phase != phase or trial.ended_ms is None:
            continue
        if trial.driver == kind and (kind != "human" or level_reaches(trial.attestation, required)):
            found[trial.participant].append(trial.as_left())
        elif trial.attestation == "spoilt":
            found[trial.participant].append(trial.as_left() if as_played else trial.forfeited())
    return {id: tuple(sorted(own, key=attrgetter("trial"))) for id, own in found.items()}


def unspoilt(trials: Iterable[Trial]) -> list[Trial]:
    """Return those that were not spoilt, for what follows from moves: in the others some may be a script's."""
    return [trial for trial in trials if trial.attestation != "spoilt"]


def members(cohort: Cohort, rules: Mapping[Any, Any]) -> list[str]:
    """Return the ids of those whom a set's rules let in, in the order of what they played.

    That order says nothing of who joined when, and it is the same under other ids: sums, draws and the report's own pseudonyms
    come out the same from an imported release, whose ids are pseudonyms.
    """
    people = [person for person in cohort.people if cohort.ranked[person.id]]
    inside = [person.id for person in people if _enters(cohort, person, rules)]
    return sorted(inside, key=lambda id: (_played(cohort.ranked[id]), _played(cohort.warm_up[id])))


def _played(trials: Sequence[Trial]) -> list[tuple[int, int, float, float, str]]:
    """Return terrain, trial, score, steps to 99 % and the hash of the trajectory of some trials, terrain by terrain."""
    return sorted(
        (
            each.terrain_index,
            each.trial,
            metric_value(each, "score"),
            metric_value(each, "steps"),
            each.trajectory_hash or "",
        )
        for each in trials
    )


def _enters(cohort: Cohort, person: Person, rules: Mapping[Any, Any]) -> bool:
    trials = cohort.ranked[person.id]
    # trials that a script touched or below the required level are not among them: a person with one does not have all
    whole = len({trial.terrain_index for trial in trials}) == cohort.terrains
    if rules.get("completed") and (person.completed_ms is None or not whole):
        return False
    if rules.get("all_ranked_driver_human") and not whole:
        return False
    if rules.get("no_labels") and any(trial.labels for trial in trials):
        return False
    most = rules.get("max_pause_share")
    return most is None or all(trial.pause_share <= float(most) for trial in trials)


def rule_in_words(rules: Mapping[Any, Any] | None) -> str:
    """Return who enters under a set's rules; None is the set of all."""
    if rules is None:
        return "everybody who finished a ranked episode"
    words = []
    if rules.get("completed"):
        words.append("finished every ranked episode")
    if rules.get("all_ranked_driver_human"):
        words.append("made every move of them")
    if rules.get("no_labels"):
        words.append("no ranked episode carries a label")
    if (most := rules.get("max_pause_share")) is not None:
        words.append(f"none was paused for more than {percent(float(most))} of its time")
    return "; ".join(words) or "everybody who finished a ranked episode"
