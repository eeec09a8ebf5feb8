"""The rows of the tables of series as Python sees them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

from humanplay.db.rows import StageEvent
from humanplay.db.trial import ParticipantKind

Stage = Literal[
    "consent", "instructions", "tutorial", "questions", "warm_up", "ranked", "debrief", "complete", "withdrawn"
]  # fmt: skip
SeriesKind = Literal["study", "daily"]
BLOCK_EVENT = "block"
"""Kind of the stage event of a block that was answered or skipped: its `block`, its `turn`, and whether it was `skipped`."""
ARM_EVENT = "arm"
"""Kind of the stage event of an assignment: the `arm`, and the `number` that it follows from."""
MOVED_EVENT = "moved"
"""Kind of the stage event of going on on another device: `by` a link or a code, and a mark of the cookie that was `left`."""
ORDER_EVENT = "order"
"""Kind of the stage event whose detail holds the `number` that fixes a participant's order of the
ranked terrains."""


class SeriesRow(NamedTuple):
    """A study that somebody has joined, or the terrain of a day; `protocol` is JSON.

    Attributes:
        closed_ms: From when on everything of it is public; None while a study is open.
        secret: Hex; None while a study is open. That of a day is told to nobody before the day
            is over.
        secret_kept_ms: Since when nobody can take part while the secret is kept; None where it
            is not.
    """

    name: str
    protocol: str
    protocol_hash: str
    commitment: str
    frozen_ms: int
    closed_ms: int | None = None
    secret: str | None = None
    kind: SeriesKind = "study"
    secret_kept_ms: int | None = None


class FrozenStudy(Protocol):
    """Whatever says what freezing fixed of a study."""

    @property
    def protocol_hash(self) -> str: ...
    @property
    def commitment(self) -> str: ...


def is_same_study(one: FrozenStudy, other: FrozenStudy) -> bool:
    """Whether two are one freezing.

    Another freezing of the same protocol has its hash too, but another secret.
    """
    return (one.protocol_hash, one.commitment) == (other.protocol_hash, other.commitment)


@dataclass(frozen=True)
class Participant:
    """A person, or a script, in a study.

    Attributes:
        settings: JSON.
        invitation: Id of the invitation that brought them; None without one.
        supervised_ms: When the operator's code was typed last; None if it never was.
        consent_ms, joined_ms, completed_ms: Milliseconds since 1970.
    """

    id: str
    study: str
    player_id: str
    session_id: str | None
    kind: ParticipantKind
    script: str | None
    consent_version: str | None
    stage: Stage
    consent_ms: int | None
    joined_ms: int
    completed_ms: int | None
    completion_code: str | None
    settings: str
    invitation: str | None = None
    supervised_ms: int | None = None


class AnswerRow(NamedTuple):
    """A number that answers a part of a question; None: prefer not to say."""

    participant_id: str
    block: str
    turn: int
    question: str
    part: int
    answer: float | None
    place: int | None
    answered_ms: int


class FreeTextRow(NamedTuple):
    """What somebody wrote in answer to a question; None: prefer not to say."""

    participant_id: str
    block: str
    turn: int
    question: str
    words: str | None


class StageEventRow(NamedTuple):
    """Something that happened to a participant; `detail` is JSON."""

    participant_id: str
    number: int
    at_ms: int
    kind: str
    detail: str

    def event(self) -> StageEvent:
        """The event with its detail parsed."""
        return StageEvent(self.at_ms, self.kind, json.loads(self.detail))


LABEL_LENGTH = 8
"""Characters of a participant's label."""


def participant_label(participant_id: str) -> str:
    """The short label that a participant sees and can quote.

    Nobody can find the id from it.
    """
    return hashlib.sha256(f"label|{participant_id}".encode()).hexdigest()[:LABEL_LENGTH].upper()
