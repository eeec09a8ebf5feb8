"""The status of each person who came to a study, and how many have each status.

So that one person does not count as two, signs that somebody takes part more than once are noted, as far as they can be known
without observing people's devices: refused joins with the participant who was there before, and with a new participant whether
their outside id is missing or known. An open link cannot stop anybody from joining twice with another browser.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Literal

from humanplay.db.rows import ErasedPerson, NotedArrivals, StageEvent
from humanplay.db.study_rows import BLOCK_EVENT, MOVED_EVENT, Participant
from humanplay.db.trial import Trial
from humanplay.study.invitations import Invitation
from humanplay.study.outcome import Outcome
from humanplay.task import counted

REPEATED_JOIN = "repeated_join"
"""Kind of the stage event of a further join; its detail is {"reason": one of Reason}."""

INTERRUPTED = "interrupted"
"""Kind of the stage event of somebody who was at an episode when the study was closed."""

ENDING_EVENTS = ("withdrawn", INTERRUPTED)
"""Kinds of the stage events that say how taking part ended."""

STOPPED = "stopped"
"""Kind of the stage event of an episode that a rule of the protocol ended; its detail is {"episode": id}."""

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


class Status(StrEnum):
    """Where somebody is who came to a study. Everybody has exactly one."""

    FINISHED = "finished"
    GAVE_UP = "gave_up"
    EXCLUDED = "excluded"
    NOT_ATTESTED = "not_attested"
    PARTLY_BOT = "partly_bot"
    STOPPED = "stopped_by_rule"
    FAILED = "failed"
    WITHDREW = "withdrew"
    INTERRUPTED = "interrupted"
    LEFT = "left"
    PLAYING = "playing"
    BOT = "bot"
    WITHDREW_EARLY = "withdrew_early"
    INTERRUPTED_EARLY = "interrupted_early"
    FAILED_QUESTIONS = "failed_questions"
    FAILED_PRACTICE = "failed_practice"
    FAILED_ATTENTION = "failed_attention"
    NEVER_BEGAN = "never_began"
    DECLINED = "declined"
    UNFIT_DEVICE = "unfit_device"
    OVER_QUOTA = "over_quota"
    UNDECIDED = "undecided"
    ERASED = "erased"


STATUS_IN_WORDS: dict[Status, str] = {
    Status.FINISHED: "finished as the protocol asks",
    Status.GAVE_UP: "ended all, but gave up too many",
    Status.EXCLUDED: "ended all, but another rule excludes them",
    Status.NOT_ATTESTED: "ended all, but not all attested",
    Status.PARTLY_BOT: "ended all, but some by a bot",
    Status.STOPPED: "stopped by a rule of the protocol",
    Status.FAILED: "left after a failure of environment or server",
    Status.WITHDREW: "withdrew",
    Status.INTERRUPTED: "interrupted by the closing",
    Status.LEFT: "left",
    Status.PLAYING: "still playing",
    Status.BOT: "bot from the first moves of every episode",
    Status.WITHDREW_EARLY: "withdrew before a ranked episode",
    Status.INTERRUPTED_EARLY: "interrupted before a ranked episode",
    Status.FAILED_QUESTIONS: "failed the questions",
    Status.FAILED_PRACTICE: "failed the practice",
    Status.FAILED_ATTENTION: "missed too many attention checks",
    Status.NEVER_BEGAN: "never began a ranked episode",
    Status.DECLINED: "declined",
    Status.UNFIT_DEVICE: "came with a device that does not fit",
    Status.OVER_QUOTA: "came when every place was taken",
    Status.UNDECIDED: "did not answer",
    Status.ERASED: "erased",
}


ENDED = (
    Status.FINISHED,
    Status.GAVE_UP,
    Status.EXCLUDED,
    Status.NOT_ATTESTED,
    Status.PARTLY_BOT,
)
"""Ended all ranked episodes."""
BEGAN = (
    *ENDED,
    Status.STOPPED,
    Status.FAILED,
    Status.WITHDREW,
    Status.INTERRUPTED,
    Status.LEFT,
    Status.PLAYING,
)
"""Began a ranked episode, bots left out."""
IN_EVERYBODY = tuple(status for status in BEGAN if status is not Status.PLAYING)
"""Whom the estimate for everybody is of: whoever still plays has left nothing undone yet."""
EARLY = (
    Status.WITHDREW_EARLY,
    Status.INTERRUPTED_EARLY,
    Status.FAILED_QUESTIONS,
    Status.FAILED_PRACTICE,
    Status.FAILED_ATTENTION,
    Status.NEVER_BEGAN,
)
"""Agreed and began no ranked episode."""


@dataclass(frozen=True)
class Arrivals:
    """People of whom only counts are stored.

    A release leaves out people who did not consent, and holds these counts.

    declined   did not agree
    undecided  opened the study and did not answer
    unfit      came with a device that does not fit
    over_quota came when every place was taken
    dry_runs   of the study, in which somebody agreed to take part
    dry_run_people   who agreed to take part in them
    erased     had everything erased, whenever that was
    erased_after_closing  of them, when the estimates were known
    erased_began      of the erased, those who had begun a ranked episode
    erased_finishers  of these, those who had ended all ranked episodes
    erased_by_arm     the erased by the arm to which they had been assigned
    erased_asked_by   the erased by who asked for it, where that was said
    issued     invitations; None where the study has none or its folder is not at hand, and so for the next two
    revoked    of them, before anybody agreed with one
    unopened   of the others, with which nobody has joined
    """

    declined: int = 0
    undecided: int = 0
    unfit: int = 0
    over_quota: int = 0
    dry_runs: int = 0
    dry_run_people: int = 0
    erased: int = 0
    erased_after_closing: int = 0
    erased_began: int = 0
    erased_finishers: int = 0
    erased_by_arm: dict[str, int] = field(default_factory=dict)
    erased_asked_by: dict[str, int] = field(default_factory=dict)
    issued: int | None = None
    revoked: int | None = None
    unopened: int | None = None

    def dry_runs_in_words(self) -> str:
        """How many dry runs there were, in a sentence; empty without any."""
        if not self.dry_runs:
            return ""
        runs = counted(self.dry_runs, "dry run has", "dry runs have")
        people = counted(self.dry_run_people, "person", "people")
        return f"The database knows that {runs} been made with {people}, on other instances; they are in no figure."


@dataclass(frozen=True)
class ParticipantFlow:
    """Everybody who came to a study, scripts left out.

    people  how many have each status
    """

    arrivals: Arrivals
    people: dict[Status, int]

    def count(self, *statuses: Status) -> int:
        """How many people have one of these statuses."""
        return sum(self.people.get(status, 0) for status in statuses)

    @property
    def agreed(self) -> int:
        """How many agreed to take part, the erased left out."""
        return self.count(*BEGAN, Status.BOT, *EARLY)

    @property
    def began(self) -> int:
        """How many began a ranked episode, bots too, the erased left out."""
        return self.count(*BEGAN, Status.BOT)

    @property
    def joined(self) -> int:
        """How many opened the study, the erased among them."""
        return sum(self.people.values())


def arrivals_of(
    declined: int,
    undecided: int,
    unfit: int,
    over_quota: int,
    dry_runs: int,
    dry_run_people: int,
    erased: Sequence[ErasedPerson],
) -> Arrivals:
    """Count people by the database; `erased` is `humanplay.db.series.erased_people`."""
    arms = Counter(person["arm"] for person in erased if person["arm"] is not None)
    asked = Counter(person["asked_by"] for person in erased if person["asked_by"] is not None)
    return Arrivals(
        declined,
        undecided,
        unfit,
        over_quota,
        dry_runs,
        dry_run_people,
        erased=len(erased),
        erased_after_closing=sum(person["after_closing"] for person in erased),
        erased_began=sum(person["ranked_begun"] > 0 for person in erased),
        erased_finishers=sum(person["completed"] for person in erased),
        erased_by_arm=dict(sorted(arms.items())),
        erased_asked_by=dict(sorted(asked.items())),
    )


def participant_flow(arrivals: Arrivals, statuses: Iterable[Status]) -> ParticipantFlow:
    """Count the statuses of people who consented, and add those with counts only."""
    people = Counter(statuses)
    people[Status.DECLINED] = arrivals.declined
    people[Status.UNDECIDED] = arrivals.undecided
    people[Status.UNFIT_DEVICE] = arrivals.unfit
    people[Status.OVER_QUOTA] = arrivals.over_quota
    people[Status.ERASED] = arrivals.erased
    return ParticipantFlow(
        arrivals, {status: people[status] for status in Status if people[status]}
    )


def with_noted(arrivals: Arrivals, noted: NotedArrivals) -> Arrivals:
    """The arrivals with the counts that a release kept of those whom it left out."""
    return replace(
        arrivals,
        declined=arrivals.declined + noted.get("declined", 0),
        undecided=arrivals.undecided + noted.get("undecided", 0),
        unfit=arrivals.unfit + noted.get("unfit", 0),
        over_quota=arrivals.over_quota + noted.get("over_quota", 0),
        dry_runs=arrivals.dry_runs + noted.get("dry_runs", 0),
        dry_run_people=arrivals.dry_run_people + noted.get("dry_run_people", 0),
        issued=noted.get("issued"),
        revoked=noted.get("revoked"),
        unopened=noted.get("unopened"),
    )


def with_invitations(
    arrivals: Arrivals, invitations: Mapping[str, Invitation], opened: Iterable[str]
) -> Arrivals:
    """Return the arrivals with the counts of a study's invitations.

    The erased had one each, and so had who has been unlinked, though it is not known which.

    opened  ids of those with which somebody has joined
    """
    used = set(opened)
    unknown = arrivals.erased + len(used - invitations.keys())
    unused = [invitation for invitation in invitations.values() if invitation.id not in used]
    revoked = sum(invitation.revoked_ms is not None for invitation in unused)
    unopened = max(0, len(unused) - revoked - unknown)
    return replace(arrivals, issued=len(invitations), revoked=revoked, unopened=unopened)


def outcome_of(
    participant: Participant,
    is_running: bool,
    events: Collection[StageEvent],
    trials: Sequence[Trial],
) -> Outcome | None:
    """How taking part ended for somebody; None for whoever can go on.

    Args:
        is_running: Whether the study is.
        events: Of the participant, those of ENDING_EVENTS at least.
        trials: Of the participant.
    """
    if participant.completed_ms is not None:
        return Outcome.FINISHED
    # before the withdrawal: whoever leaves after the closing was stopped by it
    if any(event.kind == INTERRUPTED for event in events):
        return Outcome.STOPPED_BY_US
    if participant.stage == "withdrawn":
        unasked = Outcome.NO_CONSENT if participant.consent_ms is None else Outcome.WITHDREW
        return left_as(events) or unasked
    if is_running or participant.consent_ms is None:
        return None
    return Outcome.STOPPED_BY_US if _failed_last(trials) else Outcome.LEFT


def _failed_last(trials: Sequence[Trial]) -> bool:
    """Whether the environment or the server ended somebody's last ranked episode."""
    ranked = [trial for trial in trials if trial.phase == "ranked"]
    last = max(ranked, key=lambda trial: trial.trial, default=None)
    return last is not None and last.outcome == "environment_failed"


def left_as(events: Iterable[StageEvent]) -> Outcome | None:
    """The outcome of somebody who is withdrawn without their wish; else None."""
    noted = (event.detail.get("outcome") for event in events if event.kind == "withdrawn")
    return next((Outcome(str(outcome)) for outcome in noted if outcome is not None), None)


def missed_checks(events: Iterable[StageEvent]) -> int:
    """How many attention checks somebody left out, declined or answered wrongly."""
    missed = (event.detail.get("missed") for event in events if event.kind == BLOCK_EVENT)
    return sum(number for number in missed if isinstance(number, int))


def devices_used(events: Iterable[StageEvent]) -> int:
    """One more than how often somebody changed devices."""
    return 1 + sum(event.kind == MOVED_EVENT for event in events)


def repeated_reasons(
    events: Iterable[StageEvent], shares_invitation: bool = False
) -> tuple[str, ...]:
    """The signs of repetition in a participant's stage events, each once, in words.

    shares_invitation  whether somebody else has agreed with the same one: two servers do not know of each other

    The order is that of SIGNS_IN_WORDS. No sign is no proof: another browser, another device and another id leave none.
    """
    reasons: set[object] = {"shared"} if shares_invitation else set()
    for event in events:
        if event.kind == REPEATED_JOIN:
            reasons.add(event.detail.get("reason"))
        elif event.kind == "joined":
            reasons.add(event.detail.get("outside_id"))
    return tuple(sentence for reason, sentence in SIGNS_IN_WORDS.items() if reason in reasons)
