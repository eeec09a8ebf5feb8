"""Supervised sessions: the operator's code of the day, typed in the lab under the operator's eyes.

The code is worth as much as the operator's attention: whoever has seen it can type it elsewhere until it lapses.
"""

from __future__ import annotations

import hmac
from datetime import UTC, datetime, timedelta

from app.play.attestation import SUPERVISED_FOR_MS
from app.storage.studies import StudyStore
from app.storage.study_rows import Participant
from app.study.folder import Study
from app.study.invitations import grouped, read_code, signature
from app.study.participation import StageError

MAX_WRONG_CODES = 10
"""Wrong codes of one participant after which no code of theirs is looked at."""

_WRONG_CODE = "wrong_code"
"""Kind of the stage event of a wrong code."""

_LENGTH = 8  # 40 bits
DAY_MS = 86_400_000


def code_of(study: Study, now_ms: int) -> str:
    """Return the operator's code of the UTC day that `now_ms` lies in, such as `7K3M-XWT5`."""
    day = datetime.fromtimestamp(now_ms / 1000, UTC).date().isoformat()
    return grouped(signature(study.secret, f"{study.protocol_hash}|supervise|{day}", _LENGTH))


def valid_until_ms(now_ms: int) -> int:
    """Return when the code of this day ends to be valid: at the end of the following UTC day."""
    day = datetime.fromtimestamp(now_ms / 1000, UTC).replace(
        hour=0, minute=0, second=0, microsecond=0
    )
    return int((day + timedelta(days=2)).timestamp() * 1000)


def supervised_until_ms(participant: Participant) -> int | None:
    """Return when the participant's supervision lapses or lapsed; None when the operator's code was never typed."""
    return (
        None if participant.supervised_ms is None else participant.supervised_ms + SUPERVISED_FOR_MS
    )


def is_code(study: Study, typed: str, now_ms: int) -> bool:
    """Return whether somebody typed the operator's code of this UTC day or of the one before."""
    given = read_code(typed).encode()
    codes = [read_code(code_of(study, at)).encode() for at in (now_ms, now_ms - DAY_MS)]
    return any(hmac.compare_digest(given, code) for code in codes)


def supervise(
    study_store: StudyStore, study: Study, participant: Participant, typed: str, now_ms: int
) -> None:
    """Note that the operator typed their code for a person; StageError for a wrong one, which is noted too."""
    if participant.kind != "human":
        raise StageError("only a person's session can be supervised")
    if study_store.count_stage_events(participant.id, _WRONG_CODE) >= MAX_WRONG_CODES:
        raise StageError(
            f"{MAX_WRONG_CODES} wrong codes were typed here: no code is looked at any more, go on without one"
        )
    if not is_code(study, typed, now_ms):
        study_store.add_stage_event(participant.id, now_ms, _WRONG_CODE, {})
        raise StageError("this is not the operator's code of today: ask the operator to type it")
    study_store.note_supervised(participant.id, now_ms)
