"""The list of how taking part can end for somebody."""

from __future__ import annotations

from enum import StrEnum


class Outcome(StrEnum):
    """How taking part ended for somebody."""

    FINISHED = "finished"
    UNFIT_DEVICE = "unfit_device"
    OVER_QUOTA = "over_quota"
    NO_CONSENT = "no_consent"
    FAILED_QUESTIONS = "failed_questions"
    FAILED_PRACTICE = "failed_practice"
    FAILED_ATTENTION = "failed_attention"
    WITHDREW = "withdrew"
    LEFT = "left"
    STOPPED_BY_US = "stopped_by_us"


BEFORE_CONSENT = frozenset({Outcome.UNFIT_DEVICE, Outcome.OVER_QUOTA, Outcome.NO_CONSENT})
"""No code is drawn for these, and their IDs are deleted at once."""
OUTCOME_IN_WORDS: dict[Outcome, str] = {
    Outcome.FINISHED: "ended the last ranked episode",
    Outcome.UNFIT_DEVICE: "came with a device that does not fit, before the consent",
    Outcome.OVER_QUOTA: "came, or agreed, when every place was taken",
    Outcome.NO_CONSENT: "did not agree to the consent text",
    Outcome.FAILED_QUESTIONS: "did not answer the questions rightly in the tries that the protocol allows",
    Outcome.FAILED_PRACTICE: "did not pass the practice in the tries that the protocol allows",
    Outcome.FAILED_ATTENTION: "missed more attention checks before the ranked episodes than the protocol allows",
    Outcome.WITHDREW: "agreed, and withdrew",
    Outcome.LEFT: "agreed, and had not finished when the study was closed",
    Outcome.STOPPED_BY_US: "was stopped by the closing, or by a failure of server or environment",
}
