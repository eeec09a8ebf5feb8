"""The flow of people through a study, from invitation to the last ranked episode: how many came to each stage, and who left.

So that one person does not count as two, signs that somebody takes part more than once are noted, as far as they can be known
without observing people's devices: refused joins with the participant who was there before, and with a new participant whether
their outside id is missing or known. An open link cannot stop anybody from joining twice with another browser.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from app.series.data import Person, StudyData
    from app.series.invitations import Invitation


REPEATED_JOIN = "repeated_join"
"""Kind of the stage event of a further join; its detail is {"reason": one of Reason}."""

INTERRUPTED = "interrupted"
"""Kind of the stage event of somebody who was at an episode when the study was closed."""

MAX_NOTED = 100
"""Further joins that are noted of one participant."""

Reason = Literal[
    "invitation", "outside id", "another invitation", "another outside id", "after leaving"
]
SIGNS_IN_WORDS: dict[str, str] = {
    "invitation": "their invitation was opened again elsewhere",
    "shared": "somebody else agreed with their invitation on another server",
    "outside id": "their outside id came again elsewhere",
    "another invitation": "another invitation was opened in their browser",
    "another outside id": "another outside id came in their browser",
    "after leaving": "the study was opened again after leaving it",
    "missing": "no outside id",
    "repeated": "an outside id that somebody had before",
}
"""Each reason in words."""


@dataclass(frozen=True)
class Arrivals:
    """People before they agreed to take part. A release leaves those out who did not agree, and keeps these counts.

    declined   did not agree
    undecided  opened the study and did not answer
    erased     had everything erased at their own request, whenever that was
    erased_after_closing  of them, when the figures were known
    erased_finishers      of these, those who had ended all ranked episodes
    issued     invitations; None where the study has none or its folder is not at hand, and so for the next two
    revoked    of them, before anybody agreed with one
    unopened   of the others, with which nobody has joined
    """

    declined: int = 0
    undecided: int = 0
    erased: int = 0
    erased_after_closing: int = 0
    erased_finishers: int = 0
    issued: int | None = None
    revoked: int | None = None
    unopened: int | None = None


@dataclass(frozen=True)
class ParticipantFlow:
    """Everybody who came, stage by stage; scripts are not among them.

    agreed          to take part, the erased not among them
    withdrew_early  before their first ranked episode
    interrupted_early, interrupted  by the end of the study, before their first ranked episode and after it
    stayed_early    did not go on to the ranked episodes, by the stage that they are at
    ranked          began a ranked episode
    withdrew        after that
    unfinished      left: neither withdrew nor ended all ranked episodes, nor were interrupted
    completed       ended all ranked episodes
    """

    arrivals: Arrivals
    agreed: int
    withdrew_early: int
    stayed_early: dict[str, int]
    ranked: int
    withdrew: int
    unfinished: int
    completed: int
    interrupted_early: int = 0
    interrupted: int = 0

    @property
    def joined(self) -> int:
        """Return how many opened the study, the erased among them."""
        return self.agreed + self.arrivals.declined + self.arrivals.undecided + self.arrivals.erased


def arrivals_of(declined: int, undecided: int, erased: Sequence[Mapping[str, Any]]) -> Arrivals:
    """Return the counts of people before they agreed, as the database knows them; `erased` of `app.db.series.erased_people`."""
    late = [each for each in erased if each["after_closing"]]
    finishers = sum(each["stage"] in ("debrief", "complete") for each in late)
    return Arrivals(declined, undecided, len(erased), len(late), finishers)


def with_noted(arrivals: Arrivals, noted: Mapping[str, Any]) -> Arrivals:
    """Return the arrivals with the counts that a release kept of those whom it left out; none noted: as they are."""
    changed: dict[str, Any] = {name: noted.get(name) for name in ("issued", "revoked", "unopened")}
    for name in ("declined", "undecided"):
        changed[name] = getattr(arrivals, name) + noted.get(name, 0)
    return replace(arrivals, **changed)


def with_invitations(
    arrivals: Arrivals, invitations: Mapping[str, Invitation], opened: Iterable[str]
) -> Arrivals:
    """Return the arrivals with the counts of a study's invitations. The erased had one each, though it is not known which.

    opened  ids of those with which somebody has joined
    """
    used = set(opened)
    unused = [each for each in invitations.values() if each.id not in used]
    revoked = sum(each.revoked_ms is not None for each in unused)
    left = max(0, len(unused) - revoked - arrivals.erased)
    return replace(arrivals, issued=len(invitations), revoked=revoked, unopened=left)


def participant_flow(data: StudyData) -> ParticipantFlow:
    """Return the flow of a study's people."""
    people = [p for p in data.people if p.kind == "human" and p.consent_version is not None]
    began = {trial.participant for trial in data.trials if trial.phase == "ranked"}
    early = [person for person in people if person.id not in began]
    late = [person for person in people if person.id in began]
    completed = sum(person.completed_ms is not None for person in late)
    withdrew = sum(_has_withdrawn(person) and person.completed_ms is None for person in late)
    interrupted_early, interrupted = (sum(map(_is_interrupted, each)) for each in (early, late))
    stayed = [each for each in early if each.stage != "withdrawn" and not _is_interrupted(each)]
    return ParticipantFlow(
        arrivals=data.arrivals,
        agreed=len(people),
        withdrew_early=sum(map(_has_withdrawn, early)),
        stayed_early=dict(Counter(person.stage for person in stayed)),
        ranked=len(late),
        withdrew=withdrew,
        unfinished=len(late) - withdrew - completed - interrupted,
        completed=completed,
        interrupted_early=interrupted_early,
        interrupted=interrupted,
    )


def repeated_reasons(
    events: Iterable[tuple[int, str, dict[str, Any]]], shares_invitation: bool = False
) -> tuple[str, ...]:
    """Return the signs of repetition in a participant's stage events (at_ms, kind, detail), each once, in words.

    shares_invitation  whether somebody else has agreed with the same one: two servers do not know of each other

    The order is that of SIGNS_IN_WORDS. No sign is no proof: another browser, another device and another id leave none.
    """
    found: set[str | None] = {"shared"} if shares_invitation else set()
    for _, kind, detail in events:
        if kind == REPEATED_JOIN:
            found.add(detail.get("reason"))
        elif kind == "joined":
            found.add(detail.get("outside_id"))
    return tuple(sentence for reason, sentence in SIGNS_IN_WORDS.items() if reason in found)


def _has_withdrawn(person: Person) -> bool:
    """Return whether somebody withdrew before the study ended: whoever was interrupted then left no earlier."""
    return person.stage == "withdrawn" and not _is_interrupted(person)


def _is_interrupted(person: Person) -> bool:
    return any(kind == INTERRUPTED for _, kind, _ in person.events)
