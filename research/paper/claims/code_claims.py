"""The paper's findings, judged by trainings in the world of the authors' code.

They are on one level, that of the videos, so a finding is reached there in part at most. That it is not reached counts
after the paper's moves and gradient steps alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from research.difference.answers import Record, Records, spread
from research.paper.claims.results import NOT_REPRODUCED, NOT_YET, PARTLY, UNDECIDED

MAJORITY, MOST = 0.5, 0.9


def on_one_level(shares: Sequence[float], least: float, is_full: bool) -> str:
    """Judge a finding by the share of episodes in which each seed reaches it."""
    if not shares:
        return NOT_YET
    if any(share > least for share in shares):
        return PARTLY
    return NOT_REPRODUCED if is_full else UNDECIDED


def trained(records: Records) -> tuple[list[Record], bool]:
    """The finished trainings in the code's world, with full passes if possible."""
    finished = [
        record
        for training, record in records.items()
        if record.result is not None
        and (training.level, training.world, training.estimates) == ("videos", "code", "code")
        and training.leaving == "free"
    ]
    full = [record for record in finished if record.training.passes == "full"]
    return full or finished, bool(full)


def share_of(column: str, least: float, words: str) -> Callable[[Records], str]:
    """What judges a finding by a column of the results on terrains kept apart."""

    def judge(records: Records) -> str:
        own, is_full = trained(records)
        shares = [record.result[column] for record in own if record.result is not None]
        judgement = on_one_level(shares, least, is_full)
        return f"{judgement}: {words} in {spread(shares)}" if shares else judgement

    return judge


BY_CODE: dict[str, Callable[[Records], str]] = {
    "generalises": share_of("covers_most", MOST, "90 % of a new terrain"),
    "hilbert": share_of("clean_u", MAJORITY, "a U without going back"),
}
"""Finding -> what judges it; the others are not measured there."""


def by_code(name: str, records: Records) -> str:
    """Judge a finding in the world of the code; empty if not measured there."""
    return BY_CODE[name](records) if name in BY_CODE else ""
