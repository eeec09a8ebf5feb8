"""Labels on episodes whose input looks implausible for a person. They are never deletions: the report counts them, and its
strict figure leaves labelled participants out; the other figures keep them.

Rows are those of the tables `steps` and `input_events`, as dictionaries, in order. Times are the page's own clock (ms), which
begins anew when the page is loaded again; an interval across that is not counted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from statistics import quantiles
from typing import Any

from app.board.clock import late_share, pauses_of
from app.series.protocol import Protocol

FEWEST_PRESSES = 5
"""Fewer presses than this say nothing about key-ups or speed."""
FASTEST_MS = 80.0
"""Two moves closer than this are faster than seeing and deciding."""
FAST_SHARE = 0.1
RELEASED_SHARE = 0.5
FEWEST_INTERVALS = 20
STEADY = 0.1
"""Interquartile range over median of the intervals between presses, below which they are those of a clock."""
AWAY_MS = 60_000.0
"""Where no input event shows pauses, a gap between two moves longer than this counts as one."""

LABELS = {
    "robotic timing": f"of {FEWEST_INTERVALS} or more intervals between presses, the middle half lies within {STEADY:.0%}",
    "no key-up": f"fewer than {RELEASED_SHARE:.0%} of {FEWEST_PRESSES} or more presses were released",
    "under 80 ms": f"more than {FAST_SHARE:.0%} of {FEWEST_PRESSES} or more presses came within {FASTEST_MS:.0f} ms of another",
    "untrusted": "a press that the browser does not vouch for (isTrusted is false)",
    "unfocused": "a press while the page was hidden",
    "no telemetry": f"at least {FEWEST_PRESSES} moves by key or touch and not one input event of a press",
}
"""Every label with what it means; a task has labels of its own (`Rules.own_labels`)."""

LATE = "late frames"
"""The label of an episode of which more frames came late than its protocol allows (`max_late`), where time runs."""

PRESSES, RELEASES = ("keydown", "touchdown"), ("keyup", "touchup")
Rows = Sequence[Mapping[str, Any]]


def labels_of(protocol: Protocol) -> dict[str, str]:
    """Return every label that a study's episodes can have from their input, with what it means."""
    if not protocol.rules.clock:
        return LABELS
    seeing = {name: what for name, what in LABELS.items() if name != "under 80 ms"}
    late = f"more than {protocol.max_late:.0%} of the frames came more than a frame late"
    return {**seeing, LATE: late}


def plausibility_labels(
    moves: Rows, inputs: Rows, clock: int | None = None, most_late: float = 1.0
) -> tuple[str, ...]:
    """Return an episode's labels, in the order of `labels_of`.

    clock      of the task; where time runs, two keys are often pressed as one
    most_late  share (0..1) of frames that may come late
    """
    presses = [row for row in inputs if row["kind"] in PRESSES and not row["repeat"]]
    found = {
        "robotic timing": _is_steady(presses),
        "no key-up": _lacks_releases(presses, inputs),
        "under 80 ms": clock is None and _is_fast(presses),
        "untrusted": any(row["trusted"] == 0 for row in presses),
        "unfocused": _pressed_hidden(inputs),
        "no telemetry": not presses
        and sum(row["input"] is not None for row in moves) >= FEWEST_PRESSES,
    }
    is_late = clock and late_share([row["server_ms"] for row in moves], clock) > most_late
    return (*(name for name in LABELS if found.get(name)), *((LATE,) if is_late else ()))


def intervals(presses: Rows) -> list[float]:
    """Return the milliseconds between presses that follow each other."""
    times = [float(row["client_ms"]) for row in presses]
    return [after - before for before, after in pairwise(times) if after >= before]


def _is_steady(presses: Rows) -> bool:
    gaps = intervals(presses)
    if len(gaps) < FEWEST_INTERVALS:
        return False
    low, median, high = quantiles(gaps, n=4)
    return high - low < STEADY * median


def _is_fast(presses: Rows) -> bool:
    gaps = intervals(presses)
    fast = sum(gap < FASTEST_MS for gap in gaps)
    return len(gaps) >= FEWEST_PRESSES and fast > FAST_SHARE * len(gaps)


def _lacks_releases(presses: Rows, inputs: Rows) -> bool:
    releases = sum(row["kind"] in RELEASES for row in inputs)
    return len(presses) >= FEWEST_PRESSES and releases < RELEASED_SHARE * len(presses)


def _pressed_hidden(inputs: Rows) -> bool:
    is_hidden = False
    for row in inputs:
        if row["kind"] in ("hidden", "visible"):
            is_hidden = row["kind"] == "hidden"
        elif is_hidden and row["kind"] in PRESSES:
            return True
    return False


def pause_share(moves: Rows, inputs: Rows, clock: int | None = None) -> float:
    """Return the share (0..1) of an episode's time that was spent paused or with the page hidden.

    Where time runs it follows from the frames.

    Without input events: the share of the server's time that lay in gaps above AWAY_MS between moves.
    """
    if clock:
        at_ms = [float(row["server_ms"]) for row in moves]
        return sum(pauses_of(at_ms)) / (at_ms[-1] - at_ms[0] or 1.0) if at_ms else 0.0
    if not inputs:
        times = [float(row["server_ms"]) for row in moves]
        gaps = [after - before for before, after in pairwise(times)]
        return sum(gap for gap in gaps if gap > AWAY_MS) / (sum(gaps) or 1.0)
    away = total = 0.0
    states = {"pause": False, "hidden": False}
    starts = {
        "pause": ("pause", True),
        "resume": ("pause", False),
        "hidden": ("hidden", True),
        "visible": ("hidden", False),
    }
    before = float(inputs[0]["client_ms"])
    for row in inputs:
        gap = max(0.0, float(row["client_ms"]) - before)
        total += gap
        away += gap if any(states.values()) else 0.0
        before = float(row["client_ms"])
        if row["kind"] in starts:
            which, now = starts[row["kind"]]
            states[which] = now
    return away / total if total else 0.0
