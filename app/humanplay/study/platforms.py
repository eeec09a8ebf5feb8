"""Recruitment platforms: the IDs in their links, and the way back to them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Literal

PlatformName = Literal["prolific", "sona", "connect", "code"]


@dataclass(frozen=True)
class Platform:
    """How people come from a recruitment platform, and how they go back.

    ids     pattern of each ID that a link holds, by its parameter; the first one names the person
    query   what the platform's form asks for after the study's address
    back    the address to which a fixed code leads; empty where the operator gives whole addresses
    export_columns  of the table of submissions that it exports, as `study payments --against` reads it; none:
        it exports no such table
    least_screen_out  that a screen-out must be paid, by currency
    """

    title: str
    ids: dict[str, str] = field(default_factory=dict)
    query: str = ""
    back: str = ""
    export_columns: tuple[str, ...] = ()
    least_screen_out: dict[str, float] = field(default_factory=dict)


CODE_COLUMN = "completion code"
"""The column of an export with the code that somebody brought back."""
_PROLIFIC_IDS = ("PROLIFIC_PID", "STUDY_ID", "SESSION_ID")
_CONNECT_IDS = ("participantId", "assignmentId", "projectId")

PLATFORMS: dict[PlatformName, Platform] = {
    "prolific": Platform(
        "Prolific",
        dict.fromkeys(_PROLIFIC_IDS, "[0-9a-f]{24}"),
        query="?" + "&".join(f"{name}={{{{%{name}%}}}}" for name in _PROLIFIC_IDS),
        back="https://app.prolific.com/submissions/complete?cc={code}",
        export_columns=("participant id", "status", CODE_COLUMN),
        least_screen_out={"GBP": 0.10, "USD": 0.14},
    ),
    "sona": Platform("SONA", {"survey_code": "[0-9]{1,12}"}, query="?survey_code=%SURVEY_CODE%"),
    "connect": Platform(
        "Connect",
        dict.fromkeys(_CONNECT_IDS, "[0-9A-Za-z-]{6,64}"),
        export_columns=("participant id", "status"),
    ),
    "code": Platform("a code for each person"),
}

NO_ASSIGNMENT = "ASSIGNMENT_ID_NOT_AVAILABLE"
"""What Mechanical Turk sends while somebody only looks at a task."""


def plain(value: str) -> str:
    """An ID without spaces and case: what two IDs are compared by."""
    return re.sub(r"\s+", "", value).casefold()


def is_unfilled(value: str) -> bool:
    """Whether an ID is a platform's placeholder, like `{{%PROLIFIC_PID%}}`."""
    name = value.strip()
    return "{" in name or re.fullmatch("%[^%]+%", name) is not None


def fits(platform: PlatformName, name: str, value: str) -> bool:
    """Whether an ID looks like those that a platform sends under this name."""
    pattern = PLATFORMS[platform].ids.get(name)
    return pattern is None or re.fullmatch(pattern, value.strip(), re.IGNORECASE) is not None
