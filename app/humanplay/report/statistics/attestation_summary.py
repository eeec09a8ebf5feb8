"""What the server could attest of the people's ranked episodes.

And what the level that the protocol requires leaves out.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

from humanplay.board.attestation import LEVELS, level_reaches
from humanplay.db.rows import Attestation
from humanplay.study.data import StudyData


@dataclass(frozen=True)
class AttestationSummary:
    """The attestation levels of the people's finished ranked episodes.

    Episodes that a script began are not among them.

    Attributes:
        required: The lowest level that enters an estimate.
        episodes, people: By level, lowest first; a person counts at every level that one of their
            episodes has.
        left_out: Episodes below the required level that are not spoilt: those count as abandoned.
        people_left_out: People with such an episode.
        reasons: Why episodes are not attested, with how many, the most frequent first; without the
            number of the move.
    """

    required: Attestation
    episodes: dict[Attestation, int]
    people: dict[Attestation, int]
    left_out: int
    people_left_out: int
    reasons: dict[str, int]


def attestation_summary(data: StudyData) -> AttestationSummary:
    """The summary of a study."""
    required = data.protocol.required_attestation
    of_people = [
        trial for trial in data.trials if trial.kind == "human" and trial.phase == "ranked"
    ]
    ranked = [trial for trial in of_people if trial.attestation and trial.ended_ms]
    played = [trial for trial in ranked if trial.attestation != "spoilt"]
    below = [trial for trial in played if not level_reaches(trial.attestation, required)]
    reasons = Counter(
        _without_step(trial.attestation_reason) for trial in ranked if trial.attestation_reason
    )
    people = {level: [t.participant for t in ranked if t.attestation == level] for level in LEVELS}
    return AttestationSummary(
        required=required,
        episodes={level: len(ids) for level, ids in people.items()},
        people={level: len(set(ids)) for level, ids in people.items()},
        left_out=len(below),
        people_left_out=len({trial.participant for trial in below}),
        reasons=dict(sorted(reasons.items(), key=lambda pair: (-pair[1], pair[0]))),
    )


def _without_step(reason: str) -> str:
    """A reason without its move and its numbers.

    So like reasons count as one.
    """
    return re.sub(r"-?\d+(\.\d+)?", "N", re.sub(r"^step \d+: ", "", reason))
