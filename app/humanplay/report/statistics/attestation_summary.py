"""What the server could attest of the people's ranked episodes, and what the level that the protocol requires leaves out."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

from humanplay.board.attestation import LEVELS, level_reaches
from humanplay.db.rows import Attestation
from humanplay.study.data import StudyData


@dataclass(frozen=True)
class AttestationSummary:
    """The levels of the people's finished ranked episodes; those that a script began are not among them.

    required          the lowest level that enters a figure
    episodes, people  by level, lowest first; a person counts at every level that one of their episodes has
    left_out          episodes below the required level that are not spoilt: those count as abandoned
    people_left_out   people with such an episode
    reasons           why episodes are not attested, with how many, the most frequent first; the number of the move is left away
    """

    required: Attestation
    episodes: dict[Attestation, int]
    people: dict[Attestation, int]
    left_out: int
    people_left_out: int
    reasons: dict[str, int]


def attestation_summary(data: StudyData) -> AttestationSummary:
    """Return the summary of a study."""
    required = data.protocol.required_attestation
    of_people = [each for each in data.trials if each.kind == "human" and each.phase == "ranked"]
    ranked = [each for each in of_people if each.attestation and each.ended_ms]
    played = [each for each in ranked if each.attestation != "spoilt"]
    below = [each for each in played if not level_reaches(each.attestation, required)]
    given = [each.attestation_reason for each in ranked if each.attestation_reason]
    reasons = Counter(map(_without_step, given))
    people = {level: [t.participant for t in ranked if t.attestation == level] for level in LEVELS}
    return AttestationSummary(
        required=required,
        episodes={level: len(own) for level, own in people.items()},
        people={level: len(set(own)) for level, own in people.items()},
        left_out=len(below),
        people_left_out=len({each.participant for each in below}),
        reasons=dict(sorted(reasons.items(), key=lambda item: (-item[1], item[0]))),
    )


def _without_step(reason: str) -> str:
    """Return a reason without the move that it names and without its numbers, so that like reasons count as one."""
    return re.sub(r"-?\d+(\.\d+)?", "N", re.sub(r"^step \d+: ", "", reason))
