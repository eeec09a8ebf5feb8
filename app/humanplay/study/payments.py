"""Whom to pay, and how much, by the protocol: a row for everybody who agreed.

An amount that depends on how somebody played reveals results, so it is shown only once the study is
closed, unless the protocol has `bonus_at_once`.
"""

from __future__ import annotations

import csv
import io
import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
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
from humanplay.study.outcome import BEFORE_CONSENT, Outcome
from humanplay.study.outcomes import Ending, ending, kind_of
from humanplay.study.platforms import CODE_COLUMN, PLATFORMS
from humanplay.study.protocol import StudyError
from humanplay.study.protocol_parts import Payment
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
    """A participant who agreed.

    identifier   the platform's ID, else that of their invitation
    outcome      None while they can go on
    code         the completion code that they were shown, if any
    minutes      from the consent to their end, or to what they did last
    amount       None if none is fixed, or not yet
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
        """Prolific's lines of bonuses: an ID and an amount each; no header, no zeros.

        Raises:
            StudyError: If amounts are not shown yet, or people come from elsewhere.
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
        """The pay per hour of those who finished, in a sentence; empty if not known yet."""
        payment = self.study.protocol.payment
        finishers = [payee for payee in self.payees if payee.outcome is Outcome.FINISHED]
        amounts = [payee.amount for payee in finishers if payee.amount is not None]
        if payment is None or self.waits or not amounts:
            return ""
        minutes, amount = median(payee.minutes for payee in finishers), mean(amounts)
        if minutes <= 0:
            return ""
        return (
            f"Effective pay: {60 * float(amount) / minutes:.2f} {payment.currency} an hour, that is {amount:.2f} on average "
            f"for a median of {minutes:.1f} minutes from consent to end ({counted(len(finishers), 'finisher')})"
        )


def in_words(amount: Decimal | None) -> str:
    """An amount as it is paid, with two decimals; empty for none."""
    return "" if amount is None else f"{amount:.2f}"


def payments_of(reader: Reader, study: Study, texts: Mapping[Outcome, str]) -> Payments:
    """The payments of a study, as of now.

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
    for row in series.stage_events(reader, study.name, ("stage", *ENDING_EVENTS)):
        events[row.participant_id].append(row.event())
        if row.kind != INTERRUPTED:  # the operator closed the study; they did nothing
            stages[row.participant_id].append(row.at_ms)
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
        code = None
        if outcome is not None:
            code = _code_shown(ending(study.protocol, texts, outcome, idents, drawn), drawn)
        payees.append(
            Payee(
                identifier=idents.get(names[0], "") if names else person.invitation or "",
                label=participant_label(person.id),
                outcome=outcome,
                code=code,
                minutes=minutes,
                amount=amount,
                bonus=bonus,
                share_ended=None if study.is_open else _share_ended(study, played),
                arm=arms.get(person.id, ""),
            )
        )
    without_consent = len(people) - len(payees)
    return Payments(study, tuple(payees), without_consent, waits, shows_play)


def amounts(
    payment: Payment, outcome: Outcome, trials: Iterable[Trial], minutes: float
) -> tuple[Decimal, Decimal]:
    """A participant's amount, and the part that the platform does not pay itself."""
    if outcome is Outcome.FINISHED:
        bonus = _bonus(payment, [trial for trial in trials if trial.phase == "ranked"])
        return Decimal(str(payment.base)) + bonus, bonus
    amount = Decimal(str(payment.outcomes.get(outcome, 0)))
    if outcome is Outcome.STOPPED_BY_US:
        for_time = Decimal(str(payment.hourly_rate)) * Decimal(str(minutes)) / 60
        amount = max(amount, _rounded(payment, for_time))
    return amount, Decimal(0) if outcome is payment.screen_out else amount


def _bonus(payment: Payment, ranked: Sequence[Trial]) -> Decimal:
    """The bonus for ranked episodes: at least 0, at most `payment.bonus_limit`."""
    played = [trial for trial in ranked if trial.ended_ms is not None]
    if payment.bonus_unit == "success":
        units = Decimal(sum(trial.succeeded for trial in played))
    else:
        metric = "score" if payment.bonus_unit == "score" else "steps_to_target"
        numbers = [Decimal(str(getattr(trial, metric) or 0)) for trial in played]
        above = [number - Decimal(str(payment.bonus_threshold)) for number in numbers]
        units = sum(above, Decimal(0)) * (1 if payment.bonus_direction == "more" else -1)
    bonus = _rounded(payment, max(Decimal(0), Decimal(str(payment.bonus_per_unit)) * units))
    if payment.bonus_limit is None:
        return bonus
    return min(bonus, _rounded(payment, Decimal(str(payment.bonus_limit)), ROUND_FLOOR))


def _rounded(payment: Payment, amount: Decimal, mode: str = ROUND_HALF_UP) -> Decimal:
    step = Decimal(str(payment.rounding))
    return (amount / step).quantize(Decimal(1), mode) * step


def _code_shown(shown: Ending, drawn: str | None) -> str | None:
    """The code that a participant was shown, also within a sentence; None without one."""
    if drawn is not None and shown.sentence is not None and drawn in shown.sentence:
        return drawn
    return shown.code


def _share_ended(study: Study, trials: Iterable[Trial]) -> float:
    """The share of the ranked episodes that a participant ended before the closing."""
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
    """Minutes from a participant's consent to their end, or to what they did last."""
    began_ms = person.consent_ms or person.joined_ms
    if person.completed_ms is not None:
        return (person.completed_ms - began_ms) / 60_000
    moved_ms = [trial.moved_ms or trial.started_ms for trial in trials]
    return (max([began_ms, *moved_ms, *stages_ms]) - began_ms) / 60_000


_UNFINISHED = "claim to have finished and have not"
_CODELESS = "finished without a code"
_ASTRAY = "finished and did not come back"
_UNKNOWN = "unknown here (never agreed, erased or unlinked)"
_TIMED_OUT = "timed out"
_CLAIMING = ("AWAITING REVIEW", "APPROVED", "PENDING", "PENDING REVIEW", "SUBMITTED", "COMPLETED")
"""Statuses of whoever says there that they have finished: Prolific's, then Connect's."""


def differences_to_export(
    payments: Payments, exported: str, texts: Mapping[Outcome, str]
) -> dict[str, list[str]]:
    """Compare a platform's export with who finished.

    Nothing is stored of people who did not agree. A code of theirs is believed; where a
    platform has no codes, they are listed as unknown.

    Args:
        exported: The platform's submissions, as CSV.
        texts: Outcome -> what participants read.

    Returns:
        Each kind of difference in words -> the identifiers of whom it concerns.

    Raises:
        StudyError: If the platform exports no submissions, or its export lacks a column.
    """
    rows = list(csv.DictReader(io.StringIO(exported.removeprefix("\ufeff"))))
    heads = {_plain_heading(name): name for name in (rows[0] if rows else {}) if name}
    platform = PLATFORMS[payments.study.protocol.platform]
    columns, has_codes = platform.export_columns, CODE_COLUMN in platform.export_columns
    if not columns:
        comparable = [other.title for other in PLATFORMS.values() if other.export_columns]
        raise StudyError(
            f"people of this study come from {platform.title}: --against compares with what "
            f"{' or '.join(comparable)} exports, so compare the list of payments there by hand"
        )
    headings = [heads.get(_plain_heading(name)) for name in columns]
    if missing := [name for name, head in zip(columns, headings, strict=True) if head is None]:
        raise StudyError(
            f"the platform's export must have the columns {', '.join(columns)}; {missing[0]!r} is missing: "
            "export the submissions as CSV there"
        )
    payees = {payee.identifier: payee for payee in payments.payees}
    codes_before_consent = {texts[outcome] for outcome in BEFORE_CONSENT if outcome in texts}
    kinds = [_CODELESS] if has_codes else [_ASTRAY, _UNKNOWN]
    listed: dict[str, list[str]] = {kind: [] for kind in (_UNFINISHED, *kinds, _TIMED_OUT)}
    for row in rows:
        ident, status, *typed = ((row[head] or "").strip() for head in headings if head)
        payee = payees.get(ident)
        if "TIMED" in status.upper():
            difference: str | None = _TIMED_OUT
        elif has_codes:
            codes = codes_before_consent if payee is None else {payee.code}
            difference = _difference_by_code(payee, status.upper(), typed[0], codes)
        else:
            difference = _difference_by_status(payee, status.upper(), texts)
        if difference is not None:
            listed[difference].append(ident)
    return listed


def _difference_by_code(
    payee: Payee | None, status: str, typed: str, codes: Collection[str | None]
) -> str | None:
    """How a submission with a code differs from ours; None if it does not.

    Args:
        codes: What they may have typed.
    """
    if payee is not None and payee.outcome is Outcome.FINISHED:
        return _CODELESS if typed.upper() in ("", "NOCODE") else None
    is_theirs = bool(typed) and typed in codes
    return _UNFINISHED if status in _CLAIMING and not is_theirs else None


def _difference_by_status(
    payee: Payee | None, status: str, texts: Mapping[Outcome, str]
) -> str | None:
    """How a submission without a code differs from ours; None if it does not."""
    if payee is None:
        return _UNKNOWN
    is_claim = status in _CLAIMING
    if payee.outcome is Outcome.FINISHED:
        return None if is_claim or status == "REJECTED" else _ASTRAY
    text = "" if payee.outcome is None else texts.get(payee.outcome, "")
    # an address alone leads somebody back who has not finished
    return _UNFINISHED if is_claim and kind_of(text) != "address" else None


def _plain_heading(name: str) -> str:
    """A column's name without spaces and case, in which platforms differ."""
    return re.sub(r"[\s_]+", "", name).casefold()
