"""The list of how taking part can end for somebody."""

from __future__ import annotations

from enum import StrEnum


class Outcome(StrEnum):
    """How taking part ended for somebody."""

    FINISHED = "finished"
    NO_CONSENT = "no_consent"
    WITHDREW = "withdrew"
    LEFT = "left"
    STOPPED_BY_US = "stopped_by_us"


OUTCOME_IN_WORDS: dict[Outcome, str] = {
    Outcome.FINISHED: "ended the last ranked episode",
    Outcome.NO_CONSENT: "did not agree to the consent text",
    Outcome.WITHDREW: "agreed, and withdrew",
    Outcome.LEFT: "agreed, and had not finished when the study was closed",
    Outcome.STOPPED_BY_US: "was stopped by the closing, or by a failure of server or environment",
}
