"""How long a person was at an episode, without pauses and without a hidden page.

Every input event carries the load of the page that it comes from, and each load has a clock of its own. What a load says of
itself, that it is hidden or paused, holds until it says otherwise, until another load begins in its tab, or until a key is
pressed in it. A person is away while no load is both visible and going on.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from humanplay.board.controls import pauses_of
from humanplay.db.rows import EventRow, MoveTime

PRESSES = ("keydown", "touchdown")


def active_ms(
    moves: Sequence[MoveTime],
    inputs: Sequence[EventRow],
    started_ms: float,
    quiet_ms: float,
    clock: int | None = None,
) -> float:
    """Measure the time from an episode's start to its last move without pauses.

    Args:
        started_ms: server's clock
        quiet_ms: after so long without a sign of its player a page pauses by itself
        clock: of the environment; where time runs, the time begins with the first frame

    Returns:
        Milliseconds, 0 without a move.
    """
    if not moves:
        return 0.0
    if clock:
        times_ms = [float(move["server_ms"]) for move in moves]
        return times_ms[-1] - times_ms[0] - sum(pauses_of(times_ms))
    last_ms = float(moves[-1]["server_ms"])
    return last_ms - started_ms - _away_ms(moves, inputs, (started_ms, last_ms), quiet_ms)


def pause_share(
    moves: Sequence[MoveTime],
    inputs: Sequence[EventRow],
    quiet_ms: float,
    clock: int | None = None,
) -> float:
    """Share (0..1) of the time from first to last move that was paused or hidden."""
    if not moves:
        return 0.0
    first_ms, last_ms = float(moves[0]["server_ms"]), float(moves[-1]["server_ms"])
    whole_ms = last_ms - first_ms
    return 1 - active_ms(moves, inputs, first_ms, quiet_ms, clock) / whole_ms if whole_ms else 0.0


@dataclass
class _Load:
    """What a load of the page has said of itself."""

    is_hidden: bool = False
    is_paused: bool = False

    def take(self, kind: str) -> None:
        if kind in ("hidden", "visible"):
            self.is_hidden = kind == "hidden"
        elif kind in ("pause", "resume"):
            self.is_paused = kind == "pause"
        elif kind in PRESSES:
            self.is_hidden = self.is_paused = False


def _away_ms(
    moves: Sequence[MoveTime],
    inputs: Sequence[EventRow],
    between_ms: tuple[float, float],
    quiet_ms: float,
) -> float:
    """Measure how much of the time between two moments nobody was there.

    A machine that sleeps says nothing, so of a silence only `quiet_ms` count as time with a person.
    """
    first_ms, last_ms = between_ms
    signs = [(float(move["server_ms"]), None) for move in moves]
    loads, tabs = dict[int, _Load](), dict[int, int]()
    away_ms, before_ms = 0.0, first_ms
    for sign_ms, event in sorted([*signs, *_on_servers_clock(inputs)], key=lambda sign: sign[0]):
        at_ms = min(max(sign_ms, first_ms), last_ms)
        is_away = bool(loads) and all(load.is_hidden or load.is_paused for load in loads.values())
        away_ms += at_ms - before_ms if is_away else max(0.0, at_ms - before_ms - quiet_ms)
        before_ms = at_ms
        if event is not None:
            tab, number = event["tab"], event["page_load"]
            if number not in loads and number > tabs.get(tab, -1):
                loads.pop(tabs.get(tab, -1), None)
                tabs[tab] = number
            loads.setdefault(number, _Load()).take(event["kind"])
    return away_ms


def _on_servers_clock(inputs: Sequence[EventRow]) -> Iterator[tuple[float, EventRow]]:
    """Each input event with the latest server time (ms) at which it can have happened.

    An event happened before the server received it, and before any later one of its load by as much as the load's clock says.
    Without delays, and with a clock that never stood still, this is the time itself.
    """
    by_load = defaultdict[int, list[EventRow]](list)
    for event in inputs:
        by_load[event["page_load"]].append(event)
    for events in by_load.values():
        offset_ms = float("inf")
        for event in sorted(events, key=lambda event: -event["client_ms"]):
            offset_ms = min(offset_ms, event["server_ms"] - event["client_ms"])
            yield event["client_ms"] + offset_ms, event
