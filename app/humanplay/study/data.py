"""A study as the database holds it: its protocol, its people and their trials.

Report, release and the operator's page begin with it. Nothing here comes from the table of
identities.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from humanplay.db.input_events import input_events
from humanplay.db.reader import Reader
from humanplay.db.rows import MoveTime, PlayerSettings, StageEvent
from humanplay.db.series import (
    ListedAmounts,
    amounts_listed,
    answers_of_people,
    count_dry_runs,
    count_freezings,
    erased_people,
    exports_while_open,
    find_study,
    move_inputs,
    noted_answers,
    noted_arrivals,
    of_same_configuration,
    participants,
    stage_events,
    study_names,
    study_trials,
)
from humanplay.db.study_rows import ARM_EVENT
from humanplay.db.trial import ParticipantKind, Trial
from humanplay.study.active_time import active_ms, pause_share
from humanplay.study.answer_counts import AnswerCounts, known_counts
from humanplay.study.flow import Arrivals, arrivals_of, left_as, repeated_reasons, with_noted
from humanplay.study.outcome import Outcome
from humanplay.study.plausibility import plausibility_labels
from humanplay.study.policy_files import PolicyFiles
from humanplay.study.protocol import Protocol, StudyError, parse_protocol
from humanplay.task import Record


@dataclass(frozen=True)
class Person:
    """A participant, or a script that took part.

    script        what plays, for kind `script`
    joined_ms     milliseconds since 1970, as all times
    completed_ms  when the last ranked episode ended; None before
    settings      modality, palette, keys, and the language of a study with several
    events        stage events in order
    invitation    whether an invitation brought them
    supervised    whether the operator's code was typed at least once
    arm           to which they are assigned; None before, and in a study without arms
    arm_assigned_by  `chance` or `operator`; None before
    minutes       from consent to the end of the last ranked episode; None before
    repeated      signs that they take part more than once, in words (`humanplay.study.flow`); none is no proof
    """

    id: str
    kind: ParticipantKind
    script: str | None
    stage: str
    joined_ms: int
    consent_version: str | None
    completed_ms: int | None
    settings: PlayerSettings
    events: tuple[StageEvent, ...] = field(default=(), repr=False)
    invitation: bool = False
    supervised: bool = False
    arm: str | None = None
    arm_assigned_by: str | None = None
    minutes: float | None = None
    repeated: tuple[str, ...] = ()


@dataclass(frozen=True)
class StudyData:
    """Everything that a study's figures are computed from.

    secret    hex; None until the study is closed
    freezings how often a study of this name was frozen, as the chain of its database says; 0 where none is known
    same_configuration  (name, frozen_ms) of all other studies of its configuration, as the chain says
    exports_ms  when its episodes were exported while it was open, as the chain says
    amounts_listed  when amounts that follow from play were listed while it was open, as the chain says
    arrivals  people before they agreed; a release's holds nobody who did not, and counts them
    answers   of the people who agreed, counted; a release's may hold the counts alone
    policy_files  of the policies that it is compared with
    """

    protocol: Protocol
    protocol_hash: str
    commitment: str
    frozen_ms: int
    closed_ms: int | None
    secret: str | None = field(repr=False)
    people: tuple[Person, ...]
    trials: tuple[Trial, ...] = field(repr=False)
    freezings: int = 0
    same_configuration: tuple[tuple[str, int], ...] = ()
    exports_ms: tuple[int, ...] = ()
    amounts_listed: tuple[ListedAmounts, ...] = ()
    arrivals: Arrivals = field(default_factory=Arrivals)
    answers: tuple[AnswerCounts, ...] = ()
    policy_files: PolicyFiles = field(default_factory=PolicyFiles, repr=False)

    @property
    def shows_people(self) -> bool:
        """Whether people's figures may be seen: once closed, and in a dry run at once."""
        return self.closed_ms is not None or self.protocol.dry_run_of is not None

    def shown(self) -> StudyData:
        """The data as they may be seen: while open, people's episodes look unfinished.

        A figure that moves while people play tempts to stop where it pleases, and ten looks miss the
        truth in 19 % of studies instead of 5 % (Armitage, McPherson and Rowe 1969). So nobody sees a
        figure of people before the study is closed. Scripts are no people: theirs are always shown.
        """
        if self.shows_people:
            return self
        people = {person.id for person in self.people if person.kind == "human"}
        trials = tuple(_unfinished(t) if t.participant in people else t for t in self.trials)
        return replace(self, trials=trials, answers=())

    def progress_sentence(self) -> str:
        """How many have finished: the sentence in the place of an open study's figure."""
        finishers = (person for person in self.people if person.completed_ms is not None)
        finished = sum(person.kind == "human" for person in finishers)
        players = self.protocol.players
        return (
            f"No figure is shown until the study is closed: {finished} of {players} have finished."
        )

    def with_policies_in(self, folder: Path) -> StudyData:
        """The same data with the policies' files read from a folder."""
        return replace(self, policy_files=self.policy_files.at(folder))

    def seeds(self) -> dict[int, int]:
        """Index of a ranked terrain -> its seed, for those that somebody has begun.

        They are secret while the study is open.
        """
        ranked = (trial for trial in self.trials if trial.phase == "ranked")
        return {trial.terrain_index: trial.seed for trial in ranked if trial.seed is not None}


def _unfinished(trial: Trial) -> Trial:
    """The episode without its result, as if it still ran; a tutorial stays as it is."""
    if trial.phase == "tutorial":
        return trial
    return replace(
        trial,
        outcome=None,
        steps=None,
        score=None,
        total=None,
        discovered=None,
        ended_ms=None,
        trajectory_hash=None,
        pause_share=0.0,
        active_ms=0.0,
        labels=(),
    )


def load(source: Reader | Path | str, study: str) -> StudyData:
    """A study's data as of one moment.

    Args:
        source: An open reader, or the path of a database.

    Raises:
        StudyError: If the database has no such study.
        StoreError: If the file is no database of ours.
    """
    if isinstance(source, Reader):
        return _load(source, study)
    reader = Reader.open(source)
    try:
        with reader.snapshot():
            return _load(reader, study)
    finally:
        reader.close()


def trial_records(reader: Reader, trials: Iterable[Trial]) -> Iterator[tuple[Trial, Record]]:
    """Yield each finished trial with its cause, ready to be replayed."""
    for trial in trials:
        if trial.ended_ms is not None:
            yield trial, reader.load_record(trial.id)


def _load(reader: Reader, study: str) -> StudyData:
    row = find_study(reader, study)
    if row is None:
        names = ", ".join(study_names(reader)) or "none"
        raise StudyError(
            f"nobody has joined a study {study!r} in {reader.path}; studies in it: {names}"
        )
    people = _people(reader, study)
    protocol = parse_protocol(json.loads(row.protocol))
    return StudyData(
        protocol=protocol,
        protocol_hash=row.protocol_hash,
        commitment=row.commitment,
        frozen_ms=row.frozen_ms,
        closed_ms=row.closed_ms,
        secret=row.secret,
        people=people,
        trials=tuple(_with_input(reader, trial, protocol) for trial in study_trials(reader, study)),
        freezings=count_freezings(reader, study),
        same_configuration=tuple(of_same_configuration(reader, row)),
        exports_ms=tuple(exports_while_open(reader, study, row.commitment)),
        amounts_listed=tuple(amounts_listed(reader, study, row.commitment)),
        answers=known_counts(
            protocol.blocks, *answers_of_people(reader, study), noted_answers(reader, study)
        ),
        arrivals=with_noted(_arrivals(reader, study, people), noted_arrivals(reader, study)),
        policy_files=PolicyFiles.of(protocol),
    )


def _arrivals(reader: Reader, study: str, people: Sequence[Person]) -> Arrivals:
    """Return the counts of people before they agreed, and of the erased."""
    humans = (person for person in people if person.kind == "human")
    undecided = [person for person in humans if person.consent_version is None]
    withdrawn = [person for person in undecided if person.stage == "withdrawn"]
    turned_away = Counter(left_as(person.events) for person in withdrawn)
    dry_runs, dry_run_people = count_dry_runs(reader, study)
    return arrivals_of(
        dry_runs=dry_runs,
        dry_run_people=dry_run_people,
        declined=turned_away[None],
        undecided=len(undecided) - len(withdrawn),
        unfit=turned_away[Outcome.UNFIT_DEVICE],
        over_quota=turned_away[Outcome.OVER_QUOTA],
        erased=erased_people(reader, study),
    )


def _people(reader: Reader, study: str) -> tuple[Person, ...]:
    events = defaultdict[str, list[StageEvent]](list)
    for event in stage_events(reader, study):
        events[event.participant_id].append(event.event())
    joined = participants(reader, study)
    agreed = (row.invitation for row in joined if row.consent_ms is not None)
    used = Counter(invitation for invitation in agreed if invitation is not None)
    assignments = {row.id: _assignment_in(events[row.id]) for row in joined}
    return tuple(
        Person(
            id=row.id,
            kind=row.kind,
            script=row.script,
            stage=row.stage,
            joined_ms=row.joined_ms,
            consent_version=row.consent_version,
            completed_ms=row.completed_ms,
            settings=json.loads(row.settings),
            events=tuple(events[row.id]),
            invitation=row.invitation is not None,
            supervised=row.supervised_ms is not None,
            arm=assignments[row.id][0],
            arm_assigned_by=assignments[row.id][1],
            minutes=None
            if row.completed_ms is None or row.consent_ms is None
            else (row.completed_ms - row.consent_ms) / 60_000,
            repeated=repeated_reasons(
                events[row.id], shares_invitation=used[row.invitation or ""] > 1
            ),
        )
        for row in joined
    )


def _assignment_in(events: Sequence[StageEvent]) -> tuple[str | None, str | None]:
    """The arm to which somebody is assigned, and by whom; None for both before."""
    for event in events:
        if event.kind == ARM_EVENT:
            return str(event.detail["arm"]), str(event.detail.get("assigned_by", "chance"))
    return None, None


def _with_input(reader: Reader, trial: Trial, protocol: Protocol) -> Trial:
    """The episode with what its input events show: pauses, active time, labels."""
    # an episode's events are read and dropped: a study's may be larger than memory
    moves, inputs = move_inputs(reader, trial.id), input_events(reader, trial.id)
    clock = trial.environment.clock
    labels = plausibility_labels(moves, inputs, clock, protocol.max_late, trial.outcome)
    if trial.ended_ms is not None:
        labels += trial.environment.labels(trial, [row["discovered"] for row in moves])
    quiet_ms = 1000 * protocol.pause_after_s
    return replace(
        trial,
        pause_share=pause_share(moves, inputs, quiet_ms, clock),
        touch_share=_touch_share(moves),
        active_ms=active_ms(moves, inputs, trial.started_ms, quiet_ms, clock),
        labels=labels,
    )


def _touch_share(moves: Sequence[MoveTime]) -> float:
    """The share of an episode's moves by key or touch that were made by touch."""
    modes = [move["input"] for move in moves if move["input"] is not None]
    return modes.count("touch") / len(modes) if modes else 0.0
