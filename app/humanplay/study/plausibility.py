"""Labels on episodes whose input looks implausible for a person.

A label deletes nothing: the report counts labels, and only its strict estimate leaves labelled
participants out.

Rows are those of the tables `steps` and `input_events`, in order. Times are those of the page load's
own clock (ms): an interval from one load to another is not counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from statistics import quantiles

from humanplay.board.controls import late_share
from humanplay.db.rows import EventRow, MoveTime
from humanplay.study.active_time import PRESSES
from humanplay.study.protocol import Protocol

FEWEST_PRESSES = 5
"""Fewer presses than this say nothing about key-ups or speed, and fewer moves are no attempt."""
FASTEST_MS = 80.0
"""Two moves closer than this are faster than seeing and deciding."""
FAST_SHARE = 0.1
RELEASED_SHARE = 0.5
FEWEST_INTERVALS = 20
STEADY = 0.1
"""Interquartile range over median of the intervals between presses, below which they are those of a clock."""

LABELS = {
    "robotic timing": f"of {FEWEST_INTERVALS} or more intervals between presses, the middle half lies within {STEADY:.0%}",
    "no key-up": f"fewer than {RELEASED_SHARE:.0%} of {FEWEST_PRESSES} or more presses were released",
    "under 80 ms": f"more than {FAST_SHARE:.0%} of {FEWEST_PRESSES} or more presses came within {FASTEST_MS:.0f} ms of another",
    "untrusted": "a press that the browser does not vouch for (isTrusted is false)",
    "unfocused": "a press in a page that was hidden",
    "no telemetry": f"at least {FEWEST_PRESSES} moves by key or touch and not one input event of a press",
    "no attempt": f"abandoned after fewer than {FEWEST_PRESSES} moves",
}
"""Every label with what it means; a task has labels of its own (`Environment.own_labels`)."""

NO_ATTEMPT = "no attempt"
OF_THE_INPUT = tuple(label for label in LABELS if label != NO_ATTEMPT)
"""Labels that say nothing of how an episode went."""
LATE = "late frames"
"""The label of an episode of which more frames came late than its protocol allows (`max_late`), where time runs."""

RELEASES = ("keyup", "touchup")


def labels_of(protocol: Protocol) -> dict[str, str]:
    """Label -> its meaning, for all labels that a study's input can have."""
    if not protocol.environment.clock:
        return LABELS
    # where time runs, two keys are often pressed as one
    labels = {name: meaning for name, meaning in LABELS.items() if name != "under 80 ms"}
    late = f"more than {protocol.max_late:.0%} of the frames came more than a frame late"
    return {**labels, LATE: late}


def plausibility_labels(
    moves: Sequence[MoveTime],
    inputs: Sequence[EventRow],
    clock: int | None = None,
    most_late: float = 1.0,
    outcome: str | None = None,
) -> tuple[str, ...]:
    """An episode's labels, in the order of `labels_of`.

    Args:
        clock: Ticks a second of the task, if time runs.
        most_late: Share (0..1) of frames that may come late.
        outcome: None while the episode runs.
    """
    presses = [row for row in inputs if row["kind"] in PRESSES and not row["repeat"]]
    applies = {
        "robotic timing": _is_steady(presses),
        "no key-up": _lacks_releases(presses, inputs),
        "under 80 ms": clock is None and _is_fast(presses),
        "untrusted": any(row["trusted"] == 0 for row in presses),
        "unfocused": _pressed_hidden(inputs),
        "no telemetry": not presses
        and sum(row["input"] is not None for row in moves) >= FEWEST_PRESSES,
        "no attempt": outcome == "abandoned" and len(moves) < FEWEST_PRESSES,
    }
    is_late = clock and late_share([row["server_ms"] for row in moves], clock) > most_late
    return (*(name for name in LABELS if applies.get(name)), *((LATE,) if is_late else ()))


def _gaps_ms(presses: Sequence[EventRow]) -> list[float]:
    """Times between successive presses in one load of the page."""
    return [
        after["client_ms"] - before["client_ms"]
        for before, after in pairwise(presses)
        if before["page_load"] == after["page_load"] and before["client_ms"] <= after["client_ms"]
    ]


def _is_steady(presses: Sequence[EventRow]) -> bool:
    gaps = _gaps_ms(presses)
    if len(gaps) < FEWEST_INTERVALS:
        return False
    low, median, high = quantiles(gaps, n=4)
    return high - low < STEADY * median


def _is_fast(presses: Sequence[EventRow]) -> bool:
    gaps = _gaps_ms(presses)
    fast = sum(gap < FASTEST_MS for gap in gaps)
    return len(gaps) >= FEWEST_PRESSES and fast > FAST_SHARE * len(gaps)


def _lacks_releases(presses: Sequence[EventRow], inputs: Sequence[EventRow]) -> bool:
    releases = sum(row["kind"] in RELEASES for row in inputs)
    return len(presses) >= FEWEST_PRESSES and releases < RELEASED_SHARE * len(presses)


def _pressed_hidden(inputs: Sequence[EventRow]) -> bool:
    hidden = set[int]()
    for row in inputs:
        if row["kind"] == "hidden":
            hidden.add(row["page_load"])
        elif row["kind"] == "visible":
            hidden.discard(row["page_load"])
        elif row["kind"] in PRESSES and row["page_load"] in hidden:
            return True
    return False
