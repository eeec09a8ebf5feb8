"""Signs that one person takes part more than once, as far as they can be known without observing people's devices.

An open link cannot stop anybody from joining twice with another browser. What is known is noted: refused joins with the
participant who was there before, and with a new participant whether their outside id is missing or known.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

REPEATED_JOIN = "repeated_join"
"""Kind of the stage event of a further join; its detail is {"reason": one of Reason}."""

MAX_NOTED = 100
"""Further joins that are noted of one participant."""

Reason = Literal["invitation", "outside id", "another invitation", "another outside id", "after leaving"]
SENTENCES: dict[str, str] = {
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


def repeated_reasons(events: Iterable[tuple[int, str, dict[str, Any]]], shares_invitation: bool = False) -> tuple[str, ...]:
    """Return the signs of repetition in a participant's stage events (at_ms, kind, detail), each once, in words.

    shares_invitation  whether somebody else has agreed with the same one: two servers do not know of each other

    The order is that of SENTENCES. No sign is no proof: another browser, another device and another id leave none.
    """
    found: set[str | None] = {"shared"} if shares_invitation else set()
    for _, kind, detail in events:
        if kind == REPEATED_JOIN:
            found.add(detail.get("reason"))
        elif kind == "joined":
            found.add(detail.get("outside_id"))
    return tuple(sentence for reason, sentence in SENTENCES.items() if reason in found)
