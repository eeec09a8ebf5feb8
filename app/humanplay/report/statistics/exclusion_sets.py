"""Who enters an estimate, and the tables of players by terrains or trials.

Per protocol: an episode enters as it was played if its attestation reaches the level that the
protocol requires and no move was a script's; a spoilt one enters as abandoned. Everybody: each
terrain of each person who began a ranked episode enters, as it was played or at the lowest score
and the limit. Scripts' tables are made by the same rules, their moves allowed.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from operator import attrgetter
from typing import Literal, get_args

import numpy as np

from humanplay.board.attestation import level_reaches, shows_program, shows_program_at_once
from humanplay.db.trial import LEFT, Required, Trial
from humanplay.report.statistics.formatting import counted, percent
from humanplay.study.data import Person, StudyData
from humanplay.study.exclusion_rules import Rule
from humanplay.study.flow import (
    IN_EVERYBODY,
    INTERRUPTED,
    STOPPED,
    Status,
    devices_used,
    left_as,
    missed_checks,
)
from humanplay.study.outcome import Outcome
from humanplay.study.practice import has_passed
from marsexplorer.intervals import Floats

MetricName = Literal["score", "steps"]
METRICS: tuple[MetricName, ...] = ("score", "steps")
EVERYBODY = "everybody"


class LowestReason(StrEnum):
    """Why a terrain enters the estimate for everybody at the lowest score."""

    GIVEN_UP = "given_up"
    NOT_ENDED = "not_ended"
    BOT = "by_a_bot"
    FAILED = "failed"
    STOPPED = "stopped_by_rule"


LOWEST_IN_WORDS: dict[LowestReason, str] = {
    LowestReason.GIVEN_UP: "given up",
    LowestReason.NOT_ENDED: "not ended",
    LowestReason.BOT: "by a bot",
    LowestReason.FAILED: "failure of environment or server",
    LowestReason.STOPPED: "stopped by a rule",
}


@dataclass(frozen=True)
class Cohort:
    """The participants of one kind, and their finished episodes in the order played.

    Attributes:
        lowest: The score that an episode which was left counts with, minus infinity where none
            is known.
        passed: Who passed the practice.
    """

    name: str
    kind: str
    people: tuple[Person, ...]
    ranked: Mapping[str, tuple[Trial, ...]]
    warm_up: Mapping[str, tuple[Trial, ...]]
    terrains: int
    warm_up_trials: int
    lowest: float
    passed: frozenset[str] = frozenset()

    def table(
        self,
        ids: Sequence[str],
        metric: MetricName | Literal["completed"],
        by: Literal["terrain", "trial"] = "terrain",
    ) -> Floats:
        """A metric of some players in their ranked episodes.

        Returns:
            float64[players, terrains or trials], NaN if not finished; `completed` is 0 or 1.
        """
        column = "terrain_index" if by == "terrain" else "trial"
        episodes = [self.ranked[person] for person in ids]
        return _filled(
            episodes, self.terrains, attrgetter(column), partial(metric_value, metric=metric)
        )

    def warm_up_table(self, ids: Sequence[str], metric: MetricName) -> Floats:
        """float64[players, warm-up trials] of a metric, NaN if not finished."""
        episodes = [self.warm_up[person] for person in ids]
        metric_of = partial(metric_value, metric=metric)
        return _filled(episodes, self.warm_up_trials, attrgetter("trial"), metric_of)


def _filled(
    trials: Sequence[Sequence[Trial]],
    columns: int,
    column: Callable[[Trial], int],
    metric_of: Callable[[Trial], float],
) -> Floats:
    """A table with a row for each player's trials, NaN if there is none."""
    table = np.full((len(trials), columns), np.nan)
    for row, player in zip(table, trials, strict=True):
        for trial in player:
            if 0 <= column(trial) < columns:
                row[column(trial)] = metric_of(trial)
    return table


def metric_value(trial: Trial, metric: MetricName | Literal["completed"]) -> float:
    """A finished trial's score, its steps to the target, or whether it succeeded."""
    if metric == "completed":
        return float(trial.succeeded)
    number = trial.score if metric == "score" else trial.steps_to_target
    assert number is not None
    return float(number)


def ended_ranked(data: StudyData, people: Iterable[Person]) -> list[Trial]:
    """The ranked episodes that some participants ended, whoever drove them."""
    ids = {person.id for person in people}
    ended = [
        trial for trial in data.trials if trial.phase == "ranked" and trial.ended_ms is not None
    ]
    return [trial for trial in ended if trial.participant in ids]


def people_of(data: StudyData) -> Cohort:
    """The people of a study, with the episodes that may be seen of it now."""
    shown = data.shown()
    people = [person for person in shown.people if person.kind == "human"]
    return _cohort(shown, "people", "human", people)


def scripts_of(data: StudyData) -> list[Cohort]:
    """A study's scripts, one cohort for each kind of script."""
    scripts: dict[str, list[Person]] = {}
    for person in data.people:
        if person.kind == "script":
            scripts.setdefault(person.script or "script", []).append(person)
    return [_cohort(data, name, "script", people) for name, people in sorted(scripts.items())]


def _cohort(data: StudyData, name: str, kind: str, people: list[Person]) -> Cohort:
    protocol = data.protocol
    ranked, warm_up = (_finished(data, people, kind, phase) for phase in ("ranked", "warm_up"))
    lowest, _ = protocol.environment.bounds(protocol.env_config)
    verdicts = practice_verdicts(data, people)
    return Cohort(
        name,
        kind,
        tuple(people),
        ranked,
        warm_up,
        protocol.ranked,
        protocol.warm_up,
        lowest,
        frozenset(person for person, passed in verdicts.items() if passed),
    )


def practice_verdicts(data: StudyData, people: Iterable[Person]) -> dict[str, bool]:
    """Return who of some participants passed the practice, and who failed it."""
    trials = defaultdict[str, list[Trial]](list)
    for trial in data.trials:
        trials[trial.participant].append(trial)
    verdicts = {person.id: has_passed(data.protocol, trials[person.id]) for person in people}
    return {person: passed for person, passed in verdicts.items() if passed is not None}


def _finished(
    data: StudyData, people: list[Person], kind: str, phase: str
) -> dict[str, tuple[Trial, ...]]:
    """Each participant's finished episodes of a phase that they drove themselves.

    A person's are at the required level, or spoilt.
    """
    episodes: dict[str, list[Trial]] = {person.id: [] for person in people}
    required = data.protocol.required_attestation
    for trial in data.trials:
        if trial.participant not in episodes or trial.phase != phase or trial.ended_ms is None:
            continue
        if _is_own(trial, required):
            episodes[trial.participant].append(trial.as_left())
        elif trial.attestation == "spoilt":
            episodes[trial.participant].append(trial.forfeited())
    return {id: tuple(sorted(trials, key=attrgetter("trial"))) for id, trials in episodes.items()}


def _is_own(trial: Trial, required: Required) -> bool:
    """Whether a participant made every move, a person at the required level."""
    if trial.driver != trial.kind:
        return False
    return trial.kind != "human" or level_reaches(trial.attestation, required)


def _is_by_bot(trial: Trial, required: Required) -> bool:
    """Whether an ended episode shows that a program made some of its moves."""
    if _is_own(trial, required):
        return False
    return trial.driver != trial.kind or shows_program(trial.attestation_reason)


def _is_by_bot_at_once(trial: Trial, required: Required) -> bool:
    """Whether an ended episode shows that a program made its first moves."""
    was_begun_by_person = trial.attestation == "spoilt" and not shows_program_at_once(
        trial.attestation_reason
    )
    return _is_by_bot(trial, required) and not was_begun_by_person


def statuses(data: StudyData, cohort: Cohort) -> dict[str, Status]:
    """Where everybody is who agreed, by participant.

    Nobody sees an outcome of an open study: whoever has ended all is finished there.
    """
    inside = set(members(cohort, data.protocol.per_protocol))
    ranked = _ranked(data, cohort)
    return {
        person.id: _status(data, cohort, person, ranked[person.id], person.id in inside)
        for person in cohort.people
        if person.consent_version is not None
    }


def _ranked(data: StudyData, cohort: Cohort) -> Mapping[str, list[Trial]]:
    """Each one's ranked episodes in the order begun, whoever drove them."""
    episodes = defaultdict[str, list[Trial]](list)
    for trial in data.trials:
        if trial.phase == "ranked" and trial.kind == cohort.kind:
            episodes[trial.participant].append(trial)
    return episodes


_SCREENED_OUT: dict[Outcome | None, Status] = {
    Outcome.FAILED_QUESTIONS: Status.FAILED_QUESTIONS,
    Outcome.FAILED_PRACTICE: Status.FAILED_PRACTICE,
    Outcome.FAILED_ATTENTION: Status.FAILED_ATTENTION,
}


def _status(
    data: StudyData, cohort: Cohort, person: Person, ranked: Sequence[Trial], is_inside: bool
) -> Status:
    """One person's status.

    Args:
        ranked: Their ranked episodes in the order begun.
        is_inside: Whether they are in the per-protocol estimate.
    """
    required = data.protocol.required_attestation
    is_interrupted = any(event.kind == INTERRUPTED for event in person.events)
    has_withdrawn = person.stage == "withdrawn" and not is_interrupted
    if not ranked:
        if is_interrupted:
            return Status.INTERRUPTED_EARLY
        early = Status.WITHDREW_EARLY if has_withdrawn else Status.NEVER_BEGAN
        return _SCREENED_OUT.get(left_as(person.events), early)
    ended = [trial for trial in ranked if trial.ended_ms is not None]
    # handing what goes badly to a program leaves nobody out of both estimates
    if ended and all(_is_by_bot_at_once(trial, required) for trial in ended):
        return Status.BOT
    if person.completed_ms is None:
        if is_interrupted:
            return Status.INTERRUPTED
        if has_withdrawn:
            return Status.WITHDREW
        if data.closed_ms is None:
            return Status.PLAYING
        last = lowest_reason(data, person, ranked[-1])
        by_last = {LowestReason.FAILED: Status.FAILED, LowestReason.STOPPED: Status.STOPPED}
        return by_last.get(last, Status.LEFT) if last is not None else Status.LEFT
    if is_inside or not data.shows_people:
        return Status.FINISHED
    if any(_is_by_bot(trial, required) for trial in ranked):
        return Status.PARTLY_BOT
    if len(cohort.ranked[person.id]) < cohort.terrains:
        return Status.NOT_ATTESTED
    most = data.protocol.per_protocol.get("max_given_up_share", 1.0)
    is_over = share_given_up(cohort, person.id) > most
    return Status.GAVE_UP if is_over or _lacks_score(cohort, person.id) else Status.EXCLUDED


def lowest_reason(data: StudyData, person: Person, trial: Trial) -> LowestReason | None:
    """Why a ranked episode counts at the lowest score; None if it counts as played."""
    stopped = {event.detail.get("episode") for event in person.events if event.kind == STOPPED}
    if trial.id in stopped:
        return LowestReason.STOPPED
    if trial.outcome == "environment_failed":
        return LowestReason.FAILED
    if trial.ended_ms is None:
        return LowestReason.NOT_ENDED
    if _is_by_bot(trial, data.protocol.required_attestation):
        return LowestReason.BOT
    if trial.outcome not in LEFT:
        return None
    is_cut_off = data.closed_ms is not None and trial.ended_ms >= data.closed_ms
    return LowestReason.NOT_ENDED if is_cut_off else LowestReason.GIVEN_UP


@dataclass(frozen=True)
class Everybody:
    """The cohort for the estimate over everybody who began a ranked episode.

    Attributes:
        reasons: By participant, why each terrain of theirs counts at the lowest score; None: as
            played.
    """

    cohort: Cohort
    reasons: Mapping[str, tuple[LowestReason | None, ...]]


def everybody_of(data: StudyData, cohort: Cohort) -> Everybody:
    """Everybody who began a ranked episode and is no bot, with all ranked terrains.

    Nobody of an open study's people, and nobody who is still playing in a dry run.
    """
    people = {person.id: person for person in cohort.people}
    is_shown = data.shows_people or cohort.kind != "human"
    episodes = _ranked(data, cohort)
    ranked: dict[str, tuple[Trial, ...]] = dict.fromkeys(cohort.ranked, ())
    reasons: dict[str, tuple[LowestReason | None, ...]] = {}
    for ident, status in statuses(data, cohort).items():
        if status not in IN_EVERYBODY or not is_shown:
            continue
        by_terrain = {trial.terrain_index: trial for trial in episodes[ident]}
        lowest = [
            lowest_reason(data, people[ident], by_terrain[at])
            if at in by_terrain
            else LowestReason.NOT_ENDED
            for at in range(cohort.terrains)
        ]
        reasons[ident] = tuple(lowest)
        ranked[ident] = tuple(
            by_terrain[at] if reason is None else _at_lowest(episodes[ident][0], at, cohort)
            for at, reason in enumerate(lowest)
        )
    return Everybody(replace(cohort, ranked=ranked), reasons)


def _at_lowest(trial: Trial, terrain: int, cohort: Cohort) -> Trial:
    """Somebody's episode on a terrain, given up before a move, at the lowest score."""
    return replace(
        trial,
        terrain_index=terrain,
        trial=cohort.terrains + terrain,  # never played: its cell of the table by trial stays NaN
        outcome="abandoned",
        steps=0,
        total=0.0,
        score=cohort.lowest,
        trajectory_hash=None,
        labels=(),
    )


def unspoilt(trials: Iterable[Trial]) -> list[Trial]:
    """The trials that were not spoilt, for what follows from moves.

    In a spoilt one some moves may be a script's.
    """
    return [trial for trial in trials if trial.attestation != "spoilt"]


def members(cohort: Cohort, rules: Mapping[Rule, bool | float]) -> list[str]:
    """The ids of those whom a set's rules let in, in the order of what they played.

    That order says nothing of who joined when, and it is the same under other ids: sums, draws and
    the report's own pseudonyms come out the same from an imported release, whose ids are
    pseudonyms.
    """
    people = [person for person in cohort.people if cohort.ranked[person.id]]
    inside = [person.id for person in people if _enters(cohort, person, rules)]
    return sorted(inside, key=lambda id: (_played(cohort.ranked[id]), _played(cohort.warm_up[id])))


def _played(trials: Sequence[Trial]) -> list[tuple[int, int, float, float, str]]:
    """Terrain, trial, score, moves and trajectory of some trials, to order people by."""
    return sorted(
        (
            trial.terrain_index,
            trial.trial,
            metric_value(trial, "score"),
            metric_value(trial, "steps"),
            trial.trajectory_hash or "",
        )
        for trial in trials
    )


def _enters(cohort: Cohort, person: Person, rules: Mapping[Rule, bool | float]) -> bool:
    if rules and is_flagged_throughout(cohort, person.id):
        return False
    return next(broken(cohort, person, rules), None) is None


def broken(cohort: Cohort, person: Person, rules: Mapping[Rule, bool | float]) -> Iterator[Rule]:
    """Yield the rules that a person breaks."""
    trials = cohort.ranked[person.id]
    # trials that a script touched or below the required level are not among them: a person with one does not have all
    whole = len({trial.terrain_index for trial in trials}) == cohort.terrains
    if rules.get("completed") and (
        person.completed_ms is None or not whole or _lacks_score(cohort, person.id)
    ):
        yield "completed"
    if rules.get("all_ranked_driver_human") and not whole:
        yield "all_ranked_driver_human"
    if share_given_up(cohort, person.id) > rules.get("max_given_up_share", 1.0):
        yield "max_given_up_share"
    if rules.get("no_labels") and any(trial.labels for trial in trials):
        yield "no_labels"
    most = rules.get("max_pause_share")
    if most is not None and any(trial.pause_share > float(most) for trial in trials):
        yield "max_pause_share"
    most = rules.get("max_touch_share")
    if most is not None and any(trial.touch_share > float(most) for trial in trials):
        yield "max_touch_share"
    if rules.get("passed_practice") and person.id not in cohort.passed:
        yield "passed_practice"
    if person.minutes is not None and person.minutes < rules.get("min_minutes", 0.0):
        yield "min_minutes"
    if person.minutes is not None and person.minutes > rules.get("max_minutes", np.inf):
        yield "max_minutes"
    if missed_checks(person.events) > rules.get("max_missed_checks", np.inf):
        yield "max_missed_checks"
    if devices_used(person.events) > rules.get("max_devices", np.inf):
        yield "max_devices"


OF_NO_EPISODE: tuple[Rule, ...] = (
    "passed_practice",
    "min_minutes",
    "max_minutes",
    "max_missed_checks",
    "max_devices",
)
"""Rules of which a break says nothing of a ranked episode: the operator of an open study sees it."""


def flagged(
    cohort: Cohort, people: Container[str], rules: Mapping[Rule, bool | float]
) -> dict[str, list[str]]:
    """Return which of some people break each rule, by what does not hold of them."""
    ids: dict[str, list[str]] = {
        _rule_text(rule, rules[rule]): [] for rule in get_args(Rule) if is_set(rules.get(rule))
    }
    for person in cohort.people:
        if person.id in people:
            for rule in broken(cohort, person, rules):
                ids[_rule_text(rule, rules[rule])].append(person.id)
    return ids


def flags_of_finishers(data: StudyData) -> dict[str, list[str]]:
    """Flag -> IDs of the finishers who have it, if an operator may see it now."""
    people = [person for person in data.people if person.kind == "human" and person.completed_ms]
    cohort, ids = _cohort(data, "people", "human", people), {person.id for person in people}
    flags, protocol = data.protocol.flags, _of_no_episode(data.protocol.per_protocol)
    shown = flags if data.shows_people else _of_no_episode(flags)
    return {**flagged(cohort, ids, protocol), **flagged(cohort, ids, shown)}


def _of_no_episode(rules: Mapping[Rule, bool | float]) -> dict[Rule, bool | float]:
    return {rule: bound for rule, bound in rules.items() if rule in OF_NO_EPISODE}


def is_flagged_throughout(cohort: Cohort, participant: str) -> bool:
    """Whether every ranked episode that a person ended has a label or is spoilt."""
    trials = cohort.ranked[participant]
    has_fault = [bool(trial.labels) or trial.attestation == "spoilt" for trial in trials]
    return cohort.kind == "human" and bool(has_fault) and all(has_fault)


def share_given_up(cohort: Cohort, participant: str) -> float:
    """The share (0..1) of the ranked terrains that somebody gave up."""
    trials = cohort.ranked[participant]
    return sum(trial.outcome == "abandoned" for trial in trials) / cohort.terrains


def _lacks_score(cohort: Cohort, participant: str) -> bool:
    """Whether somebody left an episode and no lowest score is declared.

    Giving up would pay, then.
    """
    return np.isinf(cohort.lowest) and any(
        trial.outcome in LEFT for trial in cohort.ranked[participant]
    )


def entry_condition(rules: Mapping[Rule, bool | float]) -> str:
    """Who enters under a set's rules."""
    words = join_rule_texts(rules)
    if words:
        return f"{words}; not every ranked episode carries a data-quality flag"
    return "everybody who finished a ranked episode"


def join_rule_texts(rules: Mapping[Rule, bool | float]) -> str:
    """What holds of whoever keeps to some rules; empty without any."""
    return "; ".join(
        _rule_text(rule, rules[rule]) for rule in get_args(Rule) if is_set(rules.get(rule))
    )


def is_set(bound: bool | float | None) -> bool:
    """Whether a rule holds: some are true or false, the others have a bound."""
    return bound is not None and bound is not False


def _rule_text(rule: Rule, bound: bool | float) -> str:
    """What holds of whoever keeps to a rule."""
    texts: dict[Rule, str] = {
        "completed": "ended every ranked episode",
        "all_ranked_driver_human": "made every move of the ranked episodes",
        "max_given_up_share": f"gave up at most {percent(float(bound))} of the ranked episodes",
        "no_labels": "no ranked episode carries a label",
        "max_pause_share": f"no ranked episode was paused for more than {percent(float(bound))} of its time",
        "max_touch_share": f"in no ranked episode more than {percent(float(bound))} of the moves were made by touch",
        "passed_practice": "passed the practice",
        "min_minutes": f"took at least {bound:g} minutes in all",
        "max_minutes": f"took at most {bound:g} minutes in all",
        "max_missed_checks": f"missed at most {counted(int(bound), 'attention check')}"
        if bound
        else "missed no attention check",
        "max_devices": f"changed devices at most {counted(int(bound) - 1, 'time')}"
        if bound > 1
        else "never changed devices",
    }
    return texts[rule]
