"""Going on on another device: by a link of 15 minutes, or a recovery code.

Whoever goes on elsewhere keeps their terrains, order and arm; the cookie that stands for them changes, and with it all that the
device before may do ends. A link names the cookie that it replaces, so it is used up by that. Nothing but these two opens a
place: no participant ID, no invitation and no label.
"""

from __future__ import annotations

import hmac
import re
from collections.abc import Iterable
from dataclasses import dataclass

from humanplay.db.study_rows import LABEL_LENGTH, Participant, participant_label
from humanplay.study.folder import Study
from humanplay.study.invitations import grouped, read_code, signature

LINK_MS = 15 * 60_000
"""For how long a link leads to a place."""
WRONG_CODE = "wrong_recovery_code"
"""Kind of the stage event of a wrong recovery code."""

_CODE_LENGTH = 12  # 60 bits
_LINK_LENGTH = 24
_TOKEN = re.compile(r"([0-9A-F]+)\.(\d{1,15})\.([0-9A-Z]+)")


@dataclass(frozen=True)
class Ticket:
    """What leads to a participant's place from elsewhere, until a time (ms)."""

    token: str
    until_ms: int


def ticket_of(study: Study, participant: Participant, now_ms: int) -> Ticket:
    """The ticket of a link to a participant's place."""
    until_ms = now_ms + LINK_MS
    signed = _signed_link(study, participant, until_ms)
    return Ticket(f"{participant_label(participant.id)}.{until_ms}.{signed}", until_ms)


def recovery_code(study: Study, participant: Participant) -> str:
    """A participant's recovery code: their label, and 60 bits that nobody can guess."""
    return grouped(participant_label(participant.id) + _secret_part(study, participant))


def holder_of_ticket(
    study: Study, people: Iterable[Participant], token: str, now_ms: int
) -> Participant | None:
    """Whose place a link leads to now; None if it is too old, used or none."""
    parts = _TOKEN.fullmatch(token.strip())
    if parts is None:
        return None
    label, until, signed = parts.groups()
    person = _labelled(people, label)
    if person is None or now_ms >= int(until):
        return None
    expected = _signed_link(study, person, int(until))
    return person if hmac.compare_digest(signed, expected) else None


def named_by_code(people: Iterable[Participant], typed: str) -> Participant | None:
    """Who has the label at the beginning of a recovery code; None for nobody."""
    return _labelled(people, read_code(typed)[:LABEL_LENGTH])


def is_recovery_code(study: Study, participant: Participant, typed: str) -> bool:
    """Whether somebody typed a participant's recovery code."""
    secret_part = read_code(typed)[LABEL_LENGTH:]
    return hmac.compare_digest(secret_part.encode(), _secret_part(study, participant).encode())


def mark_of(study: Study, player_id: str) -> str:
    """A mark of the cookie of a device that somebody left, by which it is known again."""
    return signature(study.secret, f"{study.protocol_hash}|left|{player_id}", _CODE_LENGTH)


def _labelled(people: Iterable[Participant], label: str) -> Participant | None:
    return next((person for person in people if participant_label(person.id) == label), None)


def _secret_part(study: Study, participant: Participant) -> str:
    text = f"{study.protocol_hash}|recovery|{participant.id}"
    return signature(study.secret, text, _CODE_LENGTH)


def _signed_link(study: Study, participant: Participant, until_ms: int) -> str:
    text = f"{study.protocol_hash}|elsewhere|{participant.id}|{participant.player_id}|{until_ms}"
    return signature(study.secret, text, _LINK_LENGTH)
