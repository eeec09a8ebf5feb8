"""How far a person's episode is attested: its moves match the page's input events.

`attest` is a pure function of stored rows, and with a clock of which actions the environment
allowed, as its replay says. So anybody who has the rows can derive the level again. A level says
that the rows are consistent with a person at a page: each move has a press of its own, the presses
and their times of arrival fit one clock, and no hand would have to be faster than hands are. It is
no proof. A program that invents presses at a person's pace, with a clock that runs as a page's
does, is attested as well.

The clock is compared by cause and effect alone. A page cannot answer a frame before the server had
committed it, and the server cannot receive a move before the page has sent it. With
`offset` = server's clock - page's clock, each move says
    time of the frame - time of sending  <=  offset  <=  time of arrival - time of sending
and all moves of one load of the page, which their presses name, must leave room for one offset.
However late a network delivers, these hold; a clock that runs faster or slower than the server's,
or times that were made up, do not fit them for long.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import NamedTuple, get_args

from humanplay.board.controls import PAUSE_MS, Controls, HeldKeys
from humanplay.db.chain import BegunHash, begin_hash
from humanplay.db.input_events import (
    count_input_events,
    has_copied_timing,
    input_events,
)
from humanplay.db.rows import Attestation, EventRow, MoveRow, PlayerSettings
from humanplay.db.store import Store
from humanplay.task import Allowed

LEVELS: tuple[Attestation, ...] = get_args(Attestation)

SUPERVISED_FOR_MS = 4 * 3_600_000
"""How long before an episode's start the operator's code may have been typed: a morning in the
laboratory."""
SAME_TIME_MS = 1.0
"""Most between a press in an event and in its move: both are rounded to a tenth, and the page adds
tenths to two presses of one time, so that no two events are the same."""
CLOCK_SLACK_MS = 120.0
"""By how much a time may be off: private windows round a page's clock to 100 ms, the server stores
whole milliseconds."""
CLOCK_DRIFT = 0.001
"""Most by which two clocks may run apart: crystals differ by 0.0001, and a corrected clock by
0.0005."""
LONGEST_HANDLING_MS = 10_000.0
"""Most between a press and the page's answer to it; `timeOf_ms` of the page takes an older press
for one of now."""
MOST_STEPS_BEHIND = 8
"""Most moves between the frame on screen and the move: the page lets four moves wait for their
answers, and the answers to four before them may not be painted yet."""
TYPED_AHEAD_MS = 3_000
"""A burst may answer an older frame, where the page keeps all presses: its presses reach the server
within this time after the first move that was not on screen yet. Both times are the server's, so
nobody can make them up. It is the longest of FASTEST."""
FREE_LOADS, MS_PER_LOAD, MOST_LOADS = 4, 2_500, 12
"""Loads of the page that may have made an episode's moves: four at once, one more for each two and
a half seconds, twelve at most. A load takes a person that long, so a program cannot begin a new
clock with each move."""
REST_MS = 10_000
"""A clock that is another one soon after so long a rest is not counted: that of a phone stands
still in its sleep."""
FASTEST = ((5, 100.0), (10, 400.0), (20, 1_000.0), (50, 3_000.0))
"""(presses in a row, ms that they take at least). Ten in 400 ms are 25 a second, what the fastest
typists reach for a moment; one finger taps about seven times a second, and nobody keeps up 16 for
three seconds. Two to four keys pressed as one have no time between them, so there is no floor for a
single gap. All of it is assumed: no person was measured for it."""
COARSE_MS = (1000 / 60, 100.0)
"""Private windows round a page's clock to these times: five presses then take twice as long at
least, since what is rounded away may be as much again."""

COPIED = "its presses have the timing of an earlier episode"
"""The reason that needs other episodes' rows: `humanplay.db.input_events.has_copied_timing` finds
it."""
NO_DEVICE = "the move came from no key and no touch"
UNTRUSTED = "the browser does not vouch for the press"
UNTRUSTED_HELD = "what is held is no person's"
_OF_A_PROGRAM = re.compile(f"{COPIED}|{NO_DEVICE}|{UNTRUSTED}|{UNTRUSTED_HELD}|presses in")
"""Reasons that show a program. The others may be a lost message or a clock."""
FIRST_MOVES = 5
"""A program that shows within an episode's first moves played all of it. Later it may be a person's
who hands over what goes badly: that must leave them in the estimate for everybody."""

_STEP = re.compile(r"step (\d+): ")
_KINDS = {"key": "keydown", "touch": "touchdown"}
_PRESSES = frozenset(_KINDS.values())
KeyMap = Mapping[tuple[str, str], Collection[int]]
"""(kind of event, its code) -> the actions that it may cause."""


@dataclass(frozen=True)
class AttestationResult:
    """An episode's level; below "attested" also the reason and the step it names.

    Attributes:
        reason: One short sentence; None from "attested" on.
        step: The step at fault; None if the reason is about the whole episode.
    """

    level: Attestation
    reason: str | None = None
    step: int | None = None


@dataclass(frozen=True)
class Conditions:
    """What else the level of an episode depends on.

    Attributes:
        started_ms: When the episode began, server's clock.
        key_map: Of `key_map_of`.
        supervised_ms: When the operator's code was typed for its player, server's clock.
        types_ahead: Whether the page keeps presses that come faster than the answers: the
            playground's does, a study's does not.
        controls: Of a task with a clock: what follows from its keys, by every version of a
            participant's.
        allowed: Of a task with a clock: what could be chosen before each move; empty if it was
            always everything.
    """

    started_ms: int
    key_map: KeyMap
    supervised_ms: tuple[int, ...] = ()
    types_ahead: bool = False
    controls: tuple[Controls, ...] = ()
    allowed: Sequence[Allowed] = ()


class _MismatchError(Exception):
    """A move that does not fit the input events."""

    def __init__(self, reason: str, step: int) -> None:
        super().__init__(f"step {step}: {reason}")
        self.step = step


def level_reaches(level: Attestation | None, required: Attestation) -> bool:
    """Whether a level is at least the required one; None, a script's, never is."""
    return level is not None and LEVELS.index(level) >= LEVELS.index(required)


def key_map_of(
    defaults: Mapping[str, Sequence[str]], settings: Iterable[PlayerSettings] = ()
) -> KeyMap:
    """The actions that each key or button may cause.

    Args:
        defaults: Action -> its keys, of all the task's actions in their order.
        settings: What a participant has chosen, in every version so far: a change reaches the
            server after the page.

    Returns:
        The defaults' keys, the participant's and the buttons on the page.
    """
    by_key: dict[tuple[str, str], set[int]] = {}
    actions = list(defaults)
    for keys in (defaults, *(version.get("keys") or {} for version in settings)):
        for action, codes in keys.items():
            for code in codes:
                by_key.setdefault(("keydown", code), set()).add(actions.index(action))
    return {**by_key, **{("touchdown", action): {number} for number, action in enumerate(actions)}}


def shows_program(reason: str | None) -> bool:
    """Whether the reason of a level shows that a program pressed."""
    return reason is not None and _OF_A_PROGRAM.search(reason) is not None


def shows_program_at_once(reason: str | None) -> bool:
    """Whether the reason shows a program from the first moves on."""
    if reason is None or not shows_program(reason):
        return False
    step = _STEP.match(reason)
    return step is None or int(step[1]) < FIRST_MOVES


def attest(
    moves: Sequence[MoveRow], events: Sequence[EventRow], conditions: Conditions
) -> AttestationResult:
    """The level of a person's episode.

    If the first move fits its press, a person played: a later move that does not fit makes the
    level "spoilt", not "unattested". An episode without a move is attested: nothing could differ.

    Args:
        moves: Rows of the table `steps`, in order.
        events: Rows of the table `input_events`, in order, received up to the end of the episode.
    """
    try:
        if conditions.controls:
            _check_ticks(moves, events, conditions)
        else:
            _check_moves(moves, events, conditions)
    except _MismatchError as mismatch:
        # a spoilt episode still counts, so no forged move drops a bad one
        is_persons = len(moves) > 1 and attest(moves[:1], events, conditions).reason is None
        return AttestationResult(
            "spoilt" if is_persons else "unattested", str(mismatch), mismatch.step
        )
    ages_ms = (conditions.started_ms - at_ms for at_ms in conditions.supervised_ms)
    is_supervised = any(0 <= age_ms <= SUPERVISED_FOR_MS for age_ms in ages_ms)
    return AttestationResult("supervised" if is_supervised else "attested")


class _PressTimes(NamedTuple):
    """When a press went down and was sent (page's clock), and when it came (server's)."""

    down_ms: float
    sent_ms: float
    server_ms: int


def _check_moves(
    moves: Sequence[MoveRow], events: Sequence[EventRow], conditions: Conditions
) -> None:
    """Check that each move is that of a press of its own."""
    # 1. each move has a press of its own
    sent, presses = _presses(moves, events, conditions.key_map)
    # 2. each press can have caused its move, and answers a frame that was on screen
    clocks, gaps = _Clocks(), list[float]()
    for step, press in enumerate(presses):
        _check_press(step, sent[step], press)
        _check_frame(step, moves, press, conditions.types_ahead)
        shown_ms = moves[press["step"] - 1]["server_ms"] if press["step"] else conditions.started_ms
        # 3. all presses of one load of the page fit one clock
        gaps.append(clocks.add(sent, step, shown_ms, press["page_load"]))
    # 4. no hand would have to be faster than hands are
    _check_pace(gaps, _is_coarse([times.down_ms for times in sent]))


def _check_ticks(
    moves: Sequence[MoveRow], events: Sequence[EventRow], conditions: Conditions
) -> None:
    """Check that each tick's action follows from the keys held before it.

    No tick comes while the board stands still: after a pause the page asks for it to go on, and a
    countdown follows. The presses must be a page's, too.
    """
    keys, at, before, runs_from_ms = HeldKeys(), 0, 0, None
    presses, loads, shown_ms = list[_PressTimes](), list[int](), list[float]()
    for step, move in enumerate(moves):
        # take every event that came before the tick
        while at < len(events) and events[at]["server_ms"] < move["server_ms"]:
            event, at = events[at], at + 1
            keys.take_row(event)
            if event["kind"] == "resume":
                runs_from_ms = event["server_ms"] + PAUSE_MS - CLOCK_SLACK_MS
            elif event["kind"] in ("hidden", "pause"):
                runs_from_ms = None
            elif event["kind"] in _PRESSES and not event["repeat"]:
                presses.append(
                    _PressTimes(event["client_ms"], event["client_ms"], event["server_ms"])
                )
                loads.append(event["page_load"])
                if not 0 <= (event["step"] or 0) <= step:
                    raise _MismatchError(f"a press answers the frame of step {event['step']}", step)
                shown = (event["step"] or 0) - 1
                at_ms = conditions.started_ms if shown < 0 else float(moves[shown]["server_ms"])
                shown_ms.append(at_ms)
        if move["driver"] != "human" or not keys.is_trusted:
            raise _MismatchError(UNTRUSTED_HELD, step)
        if runs_from_ms is None or move["server_ms"] < runs_from_ms:
            raise _MismatchError("time ran while the board stood still", step)
        allowed = conditions.allowed[step] if step < len(conditions.allowed) else None
        move_made = (move["action"], move["input"])
        if move_made not in {it.action(keys.down, before, allowed) for it in conditions.controls}:
            raise _MismatchError("the action does not follow from the keys that were held", step)
        before = move["action"]
    clocks, gaps = _Clocks(), list[float]()
    for number, page_load in enumerate(loads):
        gaps.append(clocks.add(presses, number, shown_ms[number], page_load))
    _check_pace(gaps, _is_coarse([press.down_ms for press in presses]))


@dataclass(frozen=True)
class Ending:
    """What the end of an episode needs of its input events, worked out beforehand.

    It is computed on another thread than that of the writes, which everybody's moves wait for.

    Attributes:
        events: Their hash, for the chain.
        conditions: By which they were compared with the moves; None for a script's episode.
        attestation: Without a comparison with other episodes' timing; None for a script's
            episode.
    """

    events: BegunHash
    conditions: Conditions | None = None
    attestation: AttestationResult | None = None


def prepare_end(
    store: Store, episode_id: str, conditions: Conditions | None, last: MoveRow | None
) -> Ending:
    """Work out what the end of an episode needs of its input events.

    Call it in `Store.read`, while no event can come.

    Args:
        conditions: None for a script's episode, which has no level.
        last: The move that ends it, a row of the table `steps` that is not stored yet; None if the
            episode is abandoned.
    """
    events = begin_hash(store.connection, episode_id)
    if conditions is None:
        return Ending(events)
    moves = [*store.steps(episode_id), *([] if last is None else [last])]
    return Ending(events, conditions, attest(moves, input_events(store, episode_id), conditions))


def attest_stored(
    store: Store, episode_id: str, conditions: Conditions, ending: Ending | None = None
) -> AttestationResult:
    """The level of a person's episode by the rows in the store.

    The timing of its presses is compared with other episodes' too.

    Args:
        ending: What was prepared; if more has come since, the moves are compared again.
    """
    attestation = None
    if (
        ending is not None
        and ending.conditions == conditions
        and ending.events.until == count_input_events(store, episode_id)
    ):
        attestation = ending.attestation
    if attestation is None:
        attestation = attest(store.steps(episode_id), input_events(store, episode_id), conditions)
    if attestation.level != "unattested" and has_copied_timing(store, episode_id):
        return AttestationResult("spoilt", COPIED)
    return attestation


def _presses(
    moves: Sequence[MoveRow], events: Iterable[EventRow], key_map: KeyMap
) -> tuple[list[_PressTimes], list[EventRow]]:
    """The times of each move, and its own input event.

    The events come in the order of the moves, and were received before them.
    """
    rest = [event for event in events if event["kind"] in _PRESSES]
    sent, presses, at = list[_PressTimes](), list[EventRow](), 0
    for step, move in enumerate(moves):
        if move["driver"] != "human" or move["input"] is None or move["input"] not in _KINDS:
            raise _MismatchError(NO_DEVICE, step)
        if move["key_down_ms"] is None or move["client_ms"] is None:
            raise _MismatchError("the move says no times", step)
        times = _PressTimes(float(move["key_down_ms"]), float(move["client_ms"]), move["server_ms"])
        at = _own_press(times, _KINDS[move["input"]], rest, at, step)
        press, at = rest[at], at + 1
        if not press["trusted"]:
            raise _MismatchError(UNTRUSTED, step)
        code = press["code"]
        if code is None or move["action"] not in key_map.get((press["kind"], code), ()):
            raise _MismatchError(f"the press {code!r} does not drive where the move went", step)
        sent.append(times)
        presses.append(press)
    return sent, presses


def _own_press(
    sent: _PressTimes, kind: str, presses: Sequence[EventRow], first: int, step: int
) -> int:
    """Find the first press, from index `first` on, of a move's kind and time.

    Returns:
        Its index in `presses`.

    Raises:
        _MismatchError: If there is none.
    """
    for index in range(first, len(presses)):
        press = presses[index]
        apart_ms = abs(press["client_ms"] - sent.down_ms)
        is_same = apart_ms <= SAME_TIME_MS and not press["repeat"]
        if is_same and press["kind"] == kind:
            if press["server_ms"] > sent.server_ms:
                raise _MismatchError("its press was received after the move", step)
            return index
    raise _MismatchError("no press of its own was received before the move", step)


def _check_press(step: int, sent: _PressTimes, press: EventRow) -> None:
    """Check that a press can have caused its move: in time, after a real round trip."""
    handling_ms = sent.sent_ms - sent.down_ms
    if not -CLOCK_SLACK_MS <= handling_ms <= LONGEST_HANDLING_MS + CLOCK_SLACK_MS:
        raise _MismatchError(f"the move was sent {handling_ms:.0f} ms after its press", step)
    round_trip_ms = press["round_trip_ms"]
    if round_trip_ms is not None and not 0 <= round_trip_ms <= sent.sent_ms + CLOCK_SLACK_MS:
        raise _MismatchError(f"a round trip of {round_trip_ms:.0f} ms cannot be", step)


def _check_frame(step: int, moves: Sequence[MoveRow], press: EventRow, types_ahead: bool) -> None:
    """Check that the frame a press answers can have been on screen then.

    It is a few moves old, or the last one before a burst.
    """
    shown = press["step"]
    if shown is not None and step - MOST_STEPS_BEHIND <= shown <= step:
        return
    if shown is None or not types_ahead or not 0 <= shown < step:
        late_ms = math.inf
    else:
        late_ms = press["server_ms"] - moves[shown]["server_ms"]
    if late_ms > TYPED_AHEAD_MS:
        raise _MismatchError(f"the press answers the frame of step {shown}", step)


class _Clock:
    """A page load's clock: the offsets (server's clock - its own, ms) that fit so far."""

    def __init__(self, low: float, high: float, sent_ms: float) -> None:
        self.low, self.high, self.sent_ms = low, high, sent_ms

    def take(self, low: float, high: float, sent_ms: float) -> bool:
        """Narrow the offsets to those from `low` to `high`; False if none is left."""
        drift_ms = CLOCK_DRIFT * (sent_ms - self.sent_ms)
        low, high = max(low, self.low - drift_ms), min(high, self.high + drift_ms)
        if sent_ms < self.sent_ms or low > high:
            return False
        self.low, self.high, self.sent_ms = low, high, sent_ms
        return True


class _Clocks:
    """The clocks of the page loads that made an episode's moves.

    A laptop's sleep begins another clock in the same load.
    """

    def __init__(self) -> None:
        self._of_loads: dict[int, _Clock] = {}
        self._counted = 0
        self._last: _Clock | None = None
        self._last_down_ms = 0.0

    def add(
        self, moves: Sequence[_PressTimes], step: int, shown_ms: float, page_load: int
    ) -> float:
        """Add a move.

        Args:
            shown_ms: When the frame was made that was on screen, server's clock.
            page_load: That its press came from.

        Returns:
            Milliseconds since the press before it.

        Raises:
            _MismatchError: If the move does not fit its load's clock.
        """
        down_ms, sent_ms, received_ms = moves[step]
        low, high = shown_ms - sent_ms - CLOCK_SLACK_MS, received_ms - sent_ms + CLOCK_SLACK_MS
        if low > high:
            raise _MismatchError("the frame that the press answers came after it", step)
        clock = self._of_loads.get(page_load)
        if clock is None or not clock.take(low, high, sent_ms):
            clock = self._of_loads[page_load] = _Clock(low, high, sent_ms)
            self._counted += not _rested(moves[max(0, step - MOST_STEPS_BEHIND - 1) : step + 1])
            passed_ms = received_ms - moves[0].server_ms
            if self._counted > min(MOST_LOADS, FREE_LOADS + passed_ms / MS_PER_LOAD):
                raise _MismatchError("the page's clock does not run with the server's", step)
        if clock is self._last:
            gap_ms = down_ms - self._last_down_ms
        else:
            gap_ms = received_ms - moves[step - 1].server_ms if step else 0.0
        self._last, self._last_down_ms = clock, down_ms
        return max(0.0, gap_ms)


def _rested(moves: Sequence[_PressTimes]) -> bool:
    """Whether the server received nothing for REST_MS between two of the moves."""
    times = [move.server_ms for move in moves]
    return any(after - before >= REST_MS for before, after in pairwise(times))


def _is_coarse(times: Sequence[float]) -> bool:
    """Whether all presses have times of a rounded clock."""
    return any(
        all(abs(ms - round(ms / grain) * grain) <= SAME_TIME_MS for ms in times)
        for grain in COARSE_MS
    )


def _check_pace(gaps: Sequence[float], is_coarse: bool) -> None:
    """Check that no hand would have to be faster than hands are.

    Args:
        gaps: Milliseconds from press to press; 0 for the first.
    """
    times = list(accumulate(gaps))
    impossible = []
    for presses, shortest_ms in FASTEST:
        least_ms = 2 * shortest_ms if is_coarse and presses == FASTEST[0][0] else shortest_ms
        for step, (first, last) in enumerate(zip(times, times[presses - 1 :], strict=False)):
            if last - first < least_ms:
                impossible.append((step + presses, step, last - first))
                break
    if impossible:
        until, step, took_ms = min(impossible)
        raise _MismatchError(f"{until - step} presses in {took_ms:.0f} ms", step)
