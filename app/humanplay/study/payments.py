"""Whom to pay, and how much: one row for everybody who agreed, by the protocol's amounts.

An amount that follows from how somebody played waits until the study is closed, unless the protocol has `bonus_at_once`:
whoever sees it knows what the figures are made of.
"""

from __future__ import annotations

import csv
import io
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_FLOOR, ROUND_HALF_UP, Decimal
from statistics import mean, median

from humanplay.db import series
from humanplay.db.reader import Reader
from humanplay.db.rows import StageEvent
from humanplay.db.study_rows import Participant, participant_label
from humanplay.db.trial import LEFT, Trial
from humanplay.study.closing import UNNOTED, unnoted_ms
from humanplay.study.flow import ENDING_EVENTS, INTERRUPTED, outcome_of
from humanplay.study.folder import Study
from humanplay.study.outcome import Outcome
from humanplay.study.outcomes import Ending, ending
from humanplay.study.protocol import Payment, StudyError
from humanplay.task import counted
from marsexplorer.files import to_cell

COLUMNS = (
    "identifier",
    "label",
    "outcome",
    "code",
    "minutes",
    "amount",
    "currency",
    "share_ended",
    "arm",
)
WAITS = "after the study is closed"


@dataclass(frozen=True)
class Payee:
    """Somebody who agreed.

    identifier   of the platform, else of their invitation
    outcome      None while they can go on
    code         that they were shown, if any
    minutes      from the consent to their end, or to their newest sign
    amount       None where none is fixed, or not yet
    bonus        the part of it that the platform does not pay by itself
    share_ended  of the ranked episodes, 0..1; None while the study is open
    arm          to which they are assigned; empty before, and in a study without arms
    """

    identifier: str
    label: str
    outcome: Outcome | None
    code: str | None
    minutes: float
    amount: Decimal | None = None
    bonus: Decimal | None = None
    share_ended: float | None = None
    arm: str = ""


@dataclass(frozen=True)
class Payments:
    """Everybody who agreed, and how many did not.

    waits       whether amounts are shown only once the study is closed
    shows_play  whether the study is open and its amounts follow from how people played
    """

    study: Study
    payees: tuple[Payee, ...]
    without_consent: int
    waits: bool
    shows_play: bool

    @property
    def finished(self) -> int:
        """How many have finished."""
        return sum(payee.outcome is Outcome.FINISHED for payee in self.payees)

    def table(self) -> list[tuple[str, ...]]:
        """The rows of the list, in the order of COLUMNS."""
        payment = self.study.protocol.payment
        currency = payment.currency if payment else ""
        return [
            (
                payee.identifier,
                payee.label,
                payee.outcome or "can go on",
                payee.code or "",
                f"{payee.minutes:.1f}",
                WAITS if self.waits and payee.outcome else in_words(payee.amount),
                currency,
                "" if payee.share_ended is None else f"{payee.share_ended:.3f}",
                payee.arm,
            )
            for payee in self.payees
        ]

    def csv(self) -> str:
        """The list as CSV; nothing in it acts in a spreadsheet."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(
            map(to_cell, row) for row in (COLUMNS, *self.table())
        )
        return text.getvalue()

    def bulk(self) -> str:
        """Prolific's lines of bonuses: an ID and an amount each, without a head and without zeros.

        StudyError where amounts wait, or people come from elsewhere.
        """
        study = self.study
        if study.protocol.platform != "prolific":
            raise StudyError(
                f"bulk lines are Prolific's, and people come to {study.name!r} from {study.protocol.platform}: "
                "take the amounts from the list"
            )
        if self.waits:
            raise StudyError(
                f"the amounts of {study.name!r} follow from how people played: they are listed {WAITS}, or earlier "
                "where the protocol has bonus_at_once"
            )
        paid = [payee for payee in self.payees if payee.identifier and payee.bonus]
        return "".join(f"{payee.identifier},{in_words(payee.bonus)}\n" for payee in paid)

    def effective_pay(self) -> str:
        """What an hour was worth to those who finished, in a sentence; empty where nothing is known yet."""
        payment = self.study.protocol.payment
        done = [payee for payee in self.payees if payee.outcome is Outcome.FINISHED]
        amounts = [payee.amount for payee in done if payee.amount is not None]
        if payment is None or self.waits or not amounts:
            return ""
        minutes, amount = median(payee.minutes for payee in done), mean(amounts)
        if minutes <= 0:
            return ""
        return (
            f"Effective pay: {60 * float(amount) / minutes:.2f} {payment.currency} an hour, that is {amount:.2f} on average "
            f"for a median of {minutes:.1f} minutes from consent to end ({counted(len(done), 'finisher')})"
        )


def in_words(amount: Decimal | None) -> str:
    """An amount as it is paid, with two decimals; empty for none."""
    return "" if amount is None else f"{amount:.2f}"


def payments_of(reader: Reader, study: Study, texts: Mapping[Outcome, str]) -> Payments:
    """Everybody to be paid of a study, as of now.

    Args:
        texts: What people read at each outcome.
    """
    if unnoted_ms(study, series.find_study(reader, study.name)) is not None:
        raise StudyError(UNNOTED.format(study.name, reader.path))
    joined = series.participants(reader, study.name)
    people = [person for person in joined if person.kind == "human"]
    trials = defaultdict[str, list[Trial]](list)
    for trial in series.trial_activity(reader, study.name):
        trials[trial.participant].append(trial)
    stages = defaultdict[str, list[int]](list)
    events = defaultdict[str, list[StageEvent]](list)
    for noted in series.stage_events(reader, study.name, ("stage", *ENDING_EVENTS)):
        events[noted.participant_id].append(noted.event())
        if noted.kind != INTERRUPTED:  # the closing is no sign of theirs
            stages[noted.participant_id].append(noted.at_ms)
    ids = series.identities_by_person(reader, study.name)
    arms = series.arms_by_person(reader, study.name)
    payment = study.protocol.payment
    shows_play = study.is_open and payment is not None and payment.follows_from_play
    waits = shows_play and not (payment and payment.bonus_at_once)
    payees = []
    for person in people:
        if person.consent_ms is None:
            continue
        played, idents = trials[person.id], ids.get(person.id, {})
        outcome = outcome_of(person, study.is_running, events[person.id], played)
        minutes = _minutes(person, played, stages[person.id])
        amount = bonus = None
        if payment is not None and outcome is not None and not waits:
            amount, bonus = amounts(payment, outcome, played, minutes)
        names = study.protocol.outside_ids
        drawn = person.completion_code
        payees.append(
            Payee(
                identifier=idents.get(names[0], "") if names else person.invitation or "",
                label=participant_label(person.id),
                outcome=outcome,
                code=None
                if outcome is None
                else _code_shown(ending(study.protocol, texts, outcome, idents, drawn), drawn),
                minutes=minutes,
                amount=amount,
                bonus=bonus,
                share_ended=None if study.is_open else _share_ended(study, played),
                arm=arms.get(person.id, ""),
            )
        )
    without = len(people) - len(payees)
    return Payments(study, tuple(payees), without, waits, shows_play)


def amounts(
    payment: Payment, outcome: Outcome, trials: Iterable[Trial], minutes: float
) -> tuple[Decimal, Decimal]:
    """What somebody gets in all, and the part of it that the platform does not pay by itself."""
    if outcome is Outcome.FINISHED:
        bonus = _bonus(payment, [trial for trial in trials if trial.phase == "ranked"])
        return Decimal(str(payment.base)) + bonus, bonus
    amount = Decimal(str(payment.outcomes.get(outcome, 0)))
    if outcome is Outcome.STOPPED_BY_US:
        time = Decimal(str(payment.hour)) * Decimal(str(minutes)) / 60
        amount = max(amount, _rounded(payment, time))
    return amount, Decimal(0) if outcome is payment.screen_out else amount


def _bonus(payment: Payment, ranked: Sequence[Trial]) -> Decimal:
    """The bonus for ranked episodes: at least 0, at most the protocol's cap."""
    played = [trial for trial in ranked if trial.ended_ms is not None]
    if payment.unit == "success":
        units = Decimal(sum(trial.succeeded for trial in played))
    else:
        metric = "score" if payment.unit == "score" else "steps_to_target"
        numbers = [Decimal(str(getattr(trial, metric) or 0)) for trial in played]
        beyond = [number - Decimal(str(payment.beyond)) for number in numbers]
        units = sum(beyond, Decimal(0)) * (1 if payment.direction == "more" else -1)
    bonus = _rounded(payment, max(Decimal(0), Decimal(str(payment.each)) * units))
    if payment.most is None:
        return bonus
    return min(bonus, _rounded(payment, Decimal(str(payment.most)), ROUND_FLOOR))


def _rounded(payment: Payment, amount: Decimal, mode: str = ROUND_HALF_UP) -> Decimal:
    step = Decimal(str(payment.rounding))
    return (amount / step).quantize(Decimal(1), mode) * step


def _code_shown(shown: Ending, drawn: str | None) -> str | None:
    """The code that somebody was shown, also in a sentence; None without one."""
    if drawn is not None and shown.sentence is not None and drawn in shown.sentence:
        return drawn
    return shown.code


def _share_ended(study: Study, trials: Iterable[Trial]) -> float:
    """The share of the ranked episodes that somebody ended before the closing."""
    stopped_ms = study.closed_ms if study.secret_kept_ms is None else study.secret_kept_ms
    ended = [
        trial
        for trial in trials
        if trial.phase == "ranked"
        and trial.ended_ms is not None
        and not (trial.outcome in LEFT and stopped_ms is not None and trial.ended_ms >= stopped_ms)
    ]
    return len(ended) / study.protocol.ranked


def _minutes(person: Participant, trials: Iterable[Trial], stages_ms: Sequence[int]) -> float:
    """The minutes from somebody's consent to their end, or to their newest sign."""
    began_ms = person.consent_ms or person.joined_ms
    if person.completed_ms is not None:
        return (person.completed_ms - began_ms) / 60_000
    moved_ms = [trial.moved_ms or trial.started_ms for trial in trials]
    return (max([began_ms, *moved_ms, *stages_ms]) - began_ms) / 60_000


@dataclass(frozen=True)
class Claims:
    """What a platform's own list says against ours: identifiers of each kind.

    unfinished  claim to have finished and have not
    codeless    finished here and gave no code there
    timed_out   timed out there
    """

    unfinished: tuple[str, ...]
    codeless: tuple[str, ...]
    timed_out: tuple[str, ...]

    def in_words(self) -> list[tuple[str, tuple[str, ...]]]:
        """Each kind in words, and who is of it."""
        return [
            ("claim to have finished and have not", self.unfinished),
            ("finished without a code", self.codeless),
            ("timed out", self.timed_out),
        ]


_CLAIMING = ("AWAITING REVIEW", "APPROVED")


def claims(payments: Payments, exported: str) -> Claims:
    """Compare a platform's export (CSV) with who finished; StudyError where it lacks a column."""
    rows = list(csv.DictReader(io.StringIO(exported.removeprefix("\ufeff"))))
    heads = {" ".join(name.split()).casefold(): name for name in (rows[0] if rows else {}) if name}
    wanted = ("participant id", "status", "completion code")
    if missing := [name for name in wanted if name not in heads]:
        raise StudyError(
            f"the platform's export must have the columns {', '.join(wanted)}; {missing[0]!r} is missing: "
            "export the submissions as CSV there"
        )
    outcomes = {payee.identifier: payee for payee in payments.payees}
    kinds = defaultdict[str, list[str]](list)
    for row in rows:
        ident, status, code = ((row[heads[name]] or "").strip() for name in wanted)
        payee = outcomes.get(ident)
        has_finished = payee is not None and payee.outcome is Outcome.FINISHED
        is_theirs = payee is not None and bool(code) and code == payee.code
        if "TIMED" in status.upper():
            kinds["timed_out"].append(ident)
        elif has_finished and code.upper() in ("", "NOCODE"):
            kinds["codeless"].append(ident)
        elif not has_finished and not is_theirs and status.upper() in _CLAIMING:
            kinds["unfinished"].append(ident)
    return Claims(*(tuple(kinds[name]) for name in ("unfinished", "codeless", "timed_out")))
