"""Whoever is screened out and paid for it: not too late, and not too little."""

from __future__ import annotations

from collections.abc import Iterator

from humanplay.study.outcome import BEFORE_CONSENT, OUTCOME_IN_WORDS, Outcome
from humanplay.study.platforms import PLATFORMS
from humanplay.study.protocol import Protocol
from humanplay.study.questions import EARLY_POSITIONS, POSITIONS, attention_checks
from humanplay.task import counted

BEFORE_PRACTICE_MIN = 5.0
"""Minutes that consent, instructions, tutorial and questions take, roughly."""
LATEST_SHARE = 1 / 5
"""Share of the minutes in all after which nobody is to be screened out."""


def minutes_until(protocol: Protocol, episodes: int) -> float:
    """The minutes from the first page to the end of so many episodes, roughly."""
    return BEFORE_PRACTICE_MIN + _episode_min(protocol) * episodes


def _episode_min(protocol: Protocol) -> float:
    return protocol.environment.texts(protocol.env_config).minutes


def playing_minutes(protocol: Protocol) -> float:
    """The minutes that the episodes of whoever finishes take, roughly."""
    return _episode_min(protocol) * (protocol.warm_up + protocol.ranked)


def minutes_in_all(protocol: Protocol) -> float:
    """The minutes that whoever finishes needs, roughly."""
    return BEFORE_PRACTICE_MIN + playing_minutes(protocol)


def _can_come(protocol: Protocol, outcome: Outcome) -> bool:
    """Whether the protocol lets anybody come to an outcome."""
    practice = protocol.practice
    return {
        Outcome.UNFIT_DEVICE: protocol.device != "any",
        Outcome.OVER_QUOTA: protocol.cap is not None,
        Outcome.FAILED_QUESTIONS: protocol.question_tries is not None,
        Outcome.FAILED_PRACTICE: practice is not None and practice.if_failed == "screen_out",
        Outcome.FAILED_ATTENTION: protocol.attention_limit is not None,
    }.get(outcome, True)


def _latest_min(protocol: Protocol, outcome: Outcome) -> float:
    """After how many minutes somebody may still come to an outcome."""
    if outcome in BEFORE_CONSENT:
        return 0.0
    if outcome is Outcome.FAILED_QUESTIONS:
        return BEFORE_PRACTICE_MIN
    is_after = attention_checks(protocol.blocks, "after_warm_up") > 0
    if outcome is Outcome.FAILED_ATTENTION and not is_after:
        return BEFORE_PRACTICE_MIN
    if outcome in (Outcome.FAILED_PRACTICE, Outcome.FAILED_ATTENTION):
        return minutes_until(protocol, protocol.most_warm_up)
    return minutes_in_all(protocol)


def attention_cautions(protocol: Protocol) -> Iterator[str]:
    """Yield a sentence where attention checks are asked that no rule reads."""
    if any("max_missed_checks" in rules for rules in protocol.rule_sets):
        return
    is_early_read = protocol.attention_limit is not None
    read_by_none = [at for at in POSITIONS if not (is_early_read and at in EARLY_POSITIONS)]
    unread = attention_checks(protocol.blocks, *read_by_none)
    if unread:
        checks = counted(unread, "attention check is", "attention checks are")
        yield (
            f"{checks} read by no rule, so that missing one means nothing: give flags or an exclusion set the rule "
            "max_missed_checks, or take the question out"
        )


def screening_cautions(protocol: Protocol) -> Iterator[str]:
    """Yield what speaks against the paid screen-out of a protocol, a sentence each."""
    payment = protocol.payment
    if payment is None or payment.screen_out is None:
        return
    outcome, platform = payment.screen_out, PLATFORMS[protocol.platform]
    if not _can_come(protocol, outcome):
        yield (
            f"the protocol lets nobody come to the paid screen-out {outcome} ({OUTCOME_IN_WORDS[outcome]}): take it out of "
            "payment, or fix in the protocol when somebody comes to it"
        )
        return
    whole_min, latest_min = minutes_in_all(protocol), _latest_min(protocol, outcome)
    if latest_min > LATEST_SHARE * whole_min:
        yield (
            f"the paid screen-out {outcome} ({OUTCOME_IN_WORDS[outcome]}) can come after {latest_min:.0f} of about "
            f"{whole_min:.0f} minutes, and should within a fifth of them: ask for less before it, or let people go on"
        )
    least, paid = platform.least_screen_out.get(payment.currency, 0.0), payment.outcomes[outcome]
    if paid < least:
        yield (
            f"the paid screen-out {outcome} gets {paid:.2f} {payment.currency}, and {platform.title} asks for at least "
            f"{least:.2f}: raise its amount in outcomes"
        )
