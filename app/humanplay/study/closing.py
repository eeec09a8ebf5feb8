"""The end of a study: what is open is abandoned then, and who was at it is counted apart from who had left."""

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
"""Who has moved within this time before the end is interrupted by it; who has not had left."""


@dataclass(frozen=True)
class LeftEpisode:
    """An open episode of a closed study, given up where it stood.

    record   its cause, with what it came to
    allowed  what could be chosen before each move (`humanplay.task.Run.allowed`)
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
    """Close a study and return it; StudyError while somebody is at it, unless `now`.

    reader        of the database in which it is played; None where there is none
    keeps_secret  `Folder.close`
    """
    if not now:
        check_nobody_is_at_it(folder, reader, name, now_ms)
    return folder.close(name, keeps_secret)


def check_nobody_is_at_it(folder: Folder, reader: Reader | None, name: str, now_ms: int) -> None:
    """StudyError where somebody has moved in a running study within the last ten minutes."""
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
    """Write the end of a closed study into the database, if anybody had joined it, and abandon what is open in it.

    Return the sessions whose episodes were abandoned. A running study, or one whose end is written already, changes nothing.

    left  `give_up_left` of each of `left_open`; None: they are replayed here, where an environment is not guarded
    """
    known, row = StudyStore(store), find_study(store, study.name)
    ended_ms = unnoted_ms(study, row)
    if ended_ms is None or row is None:
        return []
    with store.transaction():
        for participant_id in (
            _active(store, study.name, ended_ms) if row.secret_kept_ms is None else ()
        ):
            known.add_stage_event(participant_id, ended_ms, INTERRUPTED, {})
        opened = left_open(store, study)
        for trial, steps in opened:
            given_up = (
                give_up_left(trial, steps, trial.environment)
                if left is None
                else left.get(trial.id)
            )
            if given_up is None:
                raise StoreError(f"an episode of {study.name!r} has begun just now: try again")
            store.next_episode([_abandoned(store, known, trial, steps, given_up, ended_ms)], ())
        known.note_closed(study.row())
    return [trial.session_id for trial, _ in opened]


def unnoted_ms(study: Study, row: SeriesRow | None) -> int | None:
    """When a study ended whose end is still to be written; None if none is."""
    ended_ms = study.closed_ms if study.secret_kept_ms is None else study.secret_kept_ms
    if row is None or row.closed_ms is not None or not is_same_study(row, study):
        return None
    return None if study.is_open and row.secret_kept_ms is not None else ended_ms


def left_open(reader: Reader, study: Study) -> list[tuple[Trial, list[MoveRow]]]:
    """Return the open episodes, with their moves, of a study whose end is still to be written; else nothing."""
    if unnoted_ms(study, find_study(reader, study.name)) is None:
        return []
    running = [trial for trial in study_trials(reader, study.name) if trial.ended_ms is None]
    return [(trial, reader.steps(trial.id)) for trial in running]


def give_up_left(trial: Trial, steps: Sequence[MoveRow], environment: Environment) -> LeftEpisode:
    """Give up an open episode after its moves: by these alone where it cannot be replayed."""
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
    """Return the people who have moved shortly before a time, and have not come to their end."""
    unfinished = {
        person.id
        for person in participants(reader, name)
        if person.kind == "human"
        and person.completed_ms is None
        and person.stage not in ("withdrawn", "complete")
    }
    acts = [each for each in trial_activity(reader, name) if each.moved_ms is not None]
    moved = {each.participant for each in acts if now_ms - (each.moved_ms or 0) < ACTIVE_MS}
    return sorted(unfinished & moved)


def _abandoned(
    store: Store,
    known: StudyStore,
    trial: Trial,
    steps: Sequence[MoveRow],
    left: LeftEpisode,
    at_ms: int,
) -> Closing:
    """Return what closes a running episode: given up where it stands."""
    at_ms = max(at_ms, trial.started_ms, *(step["server_ms"] for step in steps))
    if trial.kind != "human":
        return Closing(trial.id, left.record, at_ms)
    settings = known.settings(trial.participant)
    supervised_ms = known.supervised_ms(trial.participant)
    keys = key_map_of(trial.environment.keys, settings)
    controls = controls_of(trial.environment, settings) if trial.environment.clock else ()
    conditions = Conditions(
        trial.started_ms, keys, supervised_ms, controls=controls, allowed=left.allowed
    )
    attested = attest_stored(store, trial.id, conditions)
    return Closing(trial.id, left.record, at_ms, attested.level, attested.reason)
