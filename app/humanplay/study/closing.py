"""The end of a study: open episodes are abandoned.

People who were playing then are counted as interrupted, others as left.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from humanplay.board.attestation import Conditions, attest_stored, key_map_of
from humanplay.board.controls import controls_of
from humanplay.db.reader import Reader
from humanplay.db.rows import MoveRow
from humanplay.db.series import StudyStore, find_study, participants, study_trials, trial_activity
from humanplay.db.store import Closing, Store, StoreError
from humanplay.db.study_rows import SeriesRow, is_same_study
from humanplay.db.trial import Trial
from humanplay.study.flow import INTERRUPTED
from humanplay.study.folder import Folder, Study
from humanplay.study.protocol import StudyError
from humanplay.task import Allowed, Ending, Environment, Record, counted

_log = logging.getLogger(__name__)
UNNOTED = (
    "the study {!r} is closed, but {} has not taken note, and holds episodes of it that are open: they count as abandoned "
    "then. Wait until its server has, or start one on it"
)
ACTIVE_MS = 10 * 60_000
"""Moved less than this long before closing: interrupted. Otherwise: left."""


@dataclass(frozen=True)
class LeftEpisode:
    """An open episode of a closed study, abandoned where it stood.

    Attributes:
        record: Its cause with actions and result.
        allowed: What could be chosen before each move (`humanplay.task.Run.allowed`).
    """

    record: Record
    allowed: Sequence[Allowed] = ()


def close_study(
    folder: Folder,
    reader: Reader | None,
    name: str,
    now_ms: int,
    now: bool,
    keeps_secret: bool = False,
) -> Study:
    """Close a study and return it.

    Args:
        reader: Of the database in which it is played; None if there is none.
        now: Close it although somebody is playing.
        keeps_secret: As for `Folder.close`.

    Raises:
        StudyError: If somebody is playing, unless `now`.
    """
    if not now:
        check_nobody_is_at_it(folder, reader, name, now_ms)
    return folder.close(name, keeps_secret)


def check_nobody_is_at_it(folder: Folder, reader: Reader | None, name: str, now_ms: int) -> None:
    """Raise StudyError if somebody has moved within the last ten minutes."""
    active = 0 if reader is None else len(_active(reader, name, now_ms))
    if not active or not folder.study(name).is_running:
        return
    raise StudyError(
        f"{counted(active, 'person has', 'people have')} moved in {name!r} within the last ten minutes: "
        "nothing was closed; wait until they have finished, or close it now (--now), which abandons their episodes and counts "
        "them as interrupted"
    )


def note_closed(
    store: Store, study: Study, left: Mapping[str, LeftEpisode] | None = None
) -> list[str]:
    """Record the end of a closed study, and abandon its open episodes.

    A running study, or one whose end is recorded already, changes nothing.

    Args:
        left: Episode id -> `give_up_left` of it, for all of `left_open`. None: they are replayed
            here, where nothing guards the process from the environment.

    Returns:
        The sessions whose episodes were abandoned.
    """
    study_store, row = StudyStore(store), find_study(store, study.name)
    ended_ms = unnoted_ms(study, row)
    if ended_ms is None or row is None:
        return []
    with store.transaction():
        for participant_id in (
            _active(store, study.name, ended_ms) if row.secret_kept_ms is None else ()
        ):
            study_store.add_stage_event(participant_id, ended_ms, INTERRUPTED, {})
        opened = left_open(store, study)
        for trial, steps in opened:
            given_up = (
                give_up_left(trial, steps, trial.environment)
                if left is None
                else left.get(trial.id)
            )
            if given_up is None:
                raise StoreError(f"an episode of {study.name!r} has begun just now: try again")
            closing = _abandoned(store, study_store, trial, steps, given_up, ended_ms)
            store.next_episode([closing], ())
        study_store.note_closed(study.row())
    return [trial.session_id for trial, _ in opened]


def unnoted_ms(study: Study, row: SeriesRow | None) -> int | None:
    """When a study ended, if its end is not recorded yet; else None."""
    ended_ms = study.closed_ms if study.secret_kept_ms is None else study.secret_kept_ms
    if row is None or row.closed_ms is not None or not is_same_study(row, study):
        return None
    return None if study.is_open and row.secret_kept_ms is not None else ended_ms


def left_open(reader: Reader, study: Study) -> list[tuple[Trial, list[MoveRow]]]:
    """Open episodes and their moves of a study whose end is not recorded yet."""
    if unnoted_ms(study, find_study(reader, study.name)) is None:
        return []
    running = [trial for trial in study_trials(reader, study.name) if trial.ended_ms is None]
    return [(trial, reader.steps(trial.id)) for trial in running]


def give_up_left(trial: Trial, steps: Sequence[MoveRow], environment: Environment) -> LeftEpisode:
    """Abandon an open episode after its moves, without a replay if that fails."""
    actions = bytes(step["action"] for step in steps)
    try:
        run = environment.replay(trial, actions, True)
        return LeftEpisode(run.record(), run.allowed())
    except Exception as error:  # an environment may raise anything
        _log.warning("episode %s cannot be replayed and is closed as stored: %r", trial.id, error)
    total = sum(step["reward"] for step in steps)
    ending: Ending = {
        "outcome": "abandoned",
        "total": total,
        "score": trial.environment.given_up_score(trial, "timed_out", total, total),
        "steps": len(steps),
        "discovered": steps[-1]["discovered"] if steps else 0,
        "trajectory_hash": "",
        "core_version": trial.core_version,
    }
    return LeftEpisode(trial.environment.record(trial, actions, ending))


def _active(reader: Reader, name: str, now_ms: int) -> list[str]:
    """People who moved shortly before a time and have not finished."""
    unfinished = {
        person.id
        for person in participants(reader, name)
        if person.kind == "human"
        and person.completed_ms is None
        and person.stage not in ("withdrawn", "complete")
    }
    moved = {
        activity.participant
        for activity in trial_activity(reader, name)
        if activity.moved_ms is not None and now_ms - activity.moved_ms < ACTIVE_MS
    }
    return sorted(unfinished & moved)


def _abandoned(
    store: Store,
    study_store: StudyStore,
    trial: Trial,
    steps: Sequence[MoveRow],
    left: LeftEpisode,
    at_ms: int,
) -> Closing:
    """What closes an abandoned episode, with its level."""
    at_ms = max(at_ms, trial.started_ms, *(step["server_ms"] for step in steps))
    if trial.kind != "human":
        return Closing(trial.id, left.record, at_ms)
    settings = study_store.settings(trial.participant)
    supervised_ms = study_store.supervised_ms(trial.participant)
    keys = key_map_of(trial.environment.keys, settings)
    controls = controls_of(trial.environment, settings) if trial.environment.clock else ()
    conditions = Conditions(
        trial.started_ms, keys, supervised_ms, controls=controls, allowed=left.allowed
    )
    attested = attest_stored(store, trial.id, conditions)
    return Closing(trial.id, left.record, at_ms, attested.level, attested.reason)
