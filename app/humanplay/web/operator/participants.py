"""A running study for the operator: each participant's progress, and recruitment.

These queries are cheap and always fresh; the figure and the labels, which read every move, are kept for some seconds.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from statistics import fmean
from typing import get_args

from humanplay.db import series
from humanplay.db.reader import Reader
from humanplay.db.rows import StageEvent
from humanplay.db.study_rows import Stage, participant_label
from humanplay.db.trial import Trial
from humanplay.report.statistics.exclusion_sets import flags_of_finishers
from humanplay.report.statistics.study_figures import live_figure
from humanplay.study.data import load
from humanplay.study.flow import REPEATED_JOIN, repeated_reasons
from humanplay.study.folder import Study
from humanplay.study.invitations import Invitations, state_of, token_of, uses_of
from humanplay.study.plausibility import OF_THE_INPUT
from humanplay.study.protocol import StudyError
from humanplay.study.recruitment import code_of, valid_until_ms
from humanplay.web.answers import operator as answers

STAGES: tuple[Stage, ...] = get_args(Stage)
QUIET_MS = 30 * 60_000
"""A participant who has not finished and has sent nothing for so long counts as gone quiet."""
FRESH_S = 15.0


def list_participants(
    reader: Reader, study: str, now_ms: int, is_open: bool
) -> list[answers.Participant]:
    """A study's participants in the order of joining, with their progress.

    is_open  whether the study is: then nothing of a person's ranked episodes is listed
    """
    trials = defaultdict[str, list[Trial]](list)
    for trial in series.trial_activity(reader, study):
        trials[trial.participant].append(trial)
    events, loads = series.event_summaries(reader, study), series.page_loads(reader, study)
    gone, arms = series.withdrawals(reader, study), series.arms_by_person(reader, study)
    left = {event.participant_id: event.event().detail for event in gone}
    signs = defaultdict[str, list[StageEvent]](list)
    for event in series.stage_events(reader, study, ("joined", REPEATED_JOIN)):
        signs[event.participant_id].append(event.event())
    listed: list[answers.Participant] = []
    for person in series.participants(reader, study):
        hides = is_open and person.kind == "human"
        played = trials[person.id]
        seen = events.get(person.id, series.EventSummary(person.id, 0, 0))
        acted = (trial.ended_ms or trial.moved_ms or trial.started_ms for trial in played)
        last_ms = max(person.joined_ms, seen.last_ms, *acted)
        is_under_way = person.stage not in ("debrief", "complete", "withdrawn")
        ended = [trial for trial in played if trial.outcome is not None]
        ranked = [trial for trial in ended if trial.phase == "ranked" and not hides]
        listed.append(
            answers.Participant(
                id=person.id,
                label=participant_label(person.id),
                kind=person.kind,
                script=person.script,
                stage=person.stage,
                joined_ms=person.joined_ms,
                minutes=(last_ms - person.joined_ms) // 60_000,
                connections=loads.get(person.id, 0),
                is_quiet=is_under_way and now_ms - last_ms > QUIET_MS,
                left_at=left.get(person.id, {}).get("from"),
                asks_erasure=left.get(person.id, {}).get("erase", False),
                deviations=None if hides else seen.deviations,
                repeated=repeated_reasons(signs[person.id]),
                not_attested=[
                    f"{trial.attestation} {trial.phase.replace('_', '-')} {trial.trial + 1}: {trial.attestation_reason}"
                    for trial in played
                    if trial.attestation_reason and not (hides and trial.phase == "ranked")
                ],
                arm=arms.get(person.id),
                invitation=person.invitation,
                supervised_ms=person.supervised_ms,
                warm_up=sum(trial.phase == "warm_up" for trial in ended),
                ranked=None if hides else len(ranked),
                mean_score=fmean(trial.score or 0.0 for trial in ranked) if ranked else None,
                mean_steps=fmean(trial.steps_to_target or 0 for trial in ranked)
                if ranked
                else None,
                outcomes=dict(Counter(str(trial.outcome) for trial in ranked)),
            )
        )
    return listed


def count_stages(people: Sequence[answers.Participant]) -> list[answers.StageCount]:
    """How many people and how many scripts are at each stage."""
    count = Counter((person.stage, person.kind) for person in people)
    return [
        answers.StageCount(stage=stage, human=count[stage, "human"], script=count[stage, "script"])
        for stage in STAGES
    ]


class LiveFigures:
    """The newest figure and labels of each study, computed by one thread at a time."""

    def __init__(self, database: Path) -> None:
        self._database = database
        self._lock = threading.Lock()
        self._made: dict[str, tuple[float, answers.LiveFigures]] = {}

    def of(self, study: str) -> answers.LiveFigures:
        """The newest ones, at most FRESH_S or ten times their computing time old."""
        with self._lock:
            until, newest = self._made.get(study, (0.0, None))
            if newest is None or time.monotonic() >= until:
                began = time.monotonic()
                newest = self._make(study)
                took = time.monotonic() - began
                self._made[study] = (time.monotonic() + max(FRESH_S, 10 * took), newest)
            return newest

    def forget(self, study: str) -> None:
        """Make a study's figure anew when it is asked for again: the study was closed."""
        with self._lock:
            self._made.pop(study, None)

    def _make(self, study: str) -> answers.LiveFigures:
        try:
            with closing(Reader.open(self._database)) as reader, reader.snapshot():
                data = load(reader, study)
        except StudyError:  # nobody has joined
            return answers.LiveFigures(figure=None, labels=[])
        people = {person.id for person in data.people if person.kind == "human"}
        labels = [
            (label, trial.participant)
            for trial in data.trials
            if trial.participant in people
            for label in trial.labels
            if trial.phase != "ranked" or data.shows_people or label in OF_THE_INPUT
        ]
        by_label: list[answers.LabelCount] = []
        for label, number in Counter(name for name, _ in labels).most_common():
            ids = {participant for name, participant in labels if name == label}
            people_in_words = sorted(map(participant_label, ids))
            by_label.append(
                answers.LabelCount(label=label, episodes=number, participants=people_in_words)
            )
        by_label += [
            answers.LabelCount(
                label=f"not so: {words}",
                episodes=0,
                participants=sorted(map(participant_label, ids)),
            )
            for words, ids in flags_of_finishers(data).items()
            if ids
        ]
        figure = answers.LiveFigure.model_validate(live_figure(data))
        return answers.LiveFigures(figure=figure, labels=by_label)


def recruiting(
    reader: Reader, invitations: Invitations, study: Study, now_ms: int
) -> answers.Recruiting:
    """How people come into a study: recruitment, code of the day, invitations.

    Invitations are in the order of issuing. The token of one that still lets somebody in is among them: the operator hands it
    out. A closed study has neither code nor tokens.
    """
    uses = uses_of(reader, study.name)
    listed: list[answers.Invitation] = []
    for invitation in invitations.of(study.name).values():
        use = uses.get(invitation.id)
        state = state_of(invitation, use)
        lets_in = study.is_running and state in ("issued", "opened")
        listed.append(
            answers.Invitation(
                id=invitation.id,
                state=state,
                label=use.label if use else None,
                token=token_of(study, invitation.id) if lets_in else None,
                issued_ms=invitation.issued_ms,
                revoked_ms=invitation.revoked_ms,
                at_ms=use.at_ms if use else None,
            )
        )
    return answers.Recruiting(
        recruitment=study.protocol.recruitment,
        code=code_of(study, now_ms) if study.is_running else None,
        code_until_ms=valid_until_ms(now_ms) if study.is_running else None,
        invitations=listed,
    )
