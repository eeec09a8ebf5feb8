"""Real-time play: the clock of a board whose task has one, and the action that follows from the keys that are held.

A board with a clock stands still until its page asks for it to go on. After a countdown the server makes a move at each tick;
its action follows from the keys that are down (`Held`, `Controls`). Keys come as input events, so whoever has the stored rows
can derive every action again: the events before a tick are those with an earlier `server_ms`. Hiding the page, a lost or a
second connection and a server that falls behind let the board stand still, and all keys count as up when it goes on.

Pauses and late ticks need no rows of their own: each tick has its time, and a board that stood still goes on after a countdown,
so that a gap as long as that is a pause, and one longer than two frames otherwise is a tick that came late.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Literal
from weakref import WeakSet

from humanplay.board.messages import ClockState
from humanplay.db.store import StoreError
from humanplay.task import Rules

if TYPE_CHECKING:
    from humanplay.board.messages import InputEvent
    from humanplay.board.session import Session

COUNTDOWN_S = 3.0
"""Between the wish to go on and the first tick."""
STALL_S = 1.0
"""A tick that would come later than this lets the board stand still instead."""
PAUSE_MS = int(COUNTDOWN_S * 1000)
"""A gap between two ticks that is no shorter is a pause."""
FEW = 4
"""Boards that tick at once and commit each tick by itself; those of more wait a moment for each other, which saves commits."""
STALLED = "The server could not keep up for a moment, so the board stands still."
TAKES_KEYS = "time runs on this board: it takes the keys that are held, and no moves"

_PRESSES = {
    "keydown": ("key", True), "keyup": ("key", False), "touchdown": ("touch", True), "touchup": ("touch", False),
}  # fmt: skip
_RELEASES = frozenset({"blur", "hidden", "pause", "resume"})
"""Events after which every key counts as up."""
Input = Literal["key", "touch"]


@dataclass(frozen=True)
class Allowed:
    """What an episode may have in time.

    pauses    how often its board may stand still once it has begun; beyond, the episode ends as left
    paused_s  for how long in all; beyond, it ends as left
    late      share (0..1) of its ticks that may come more than a frame late; beyond, it is labelled
    """

    pauses: int = 10
    paused_s: float = 600.0
    late: float = 0.02


class Held:
    """The keys and buttons that are down, in the order in which they went down."""

    def __init__(self) -> None:
        self._down: dict[tuple[Input, str], bool] = {}

    def take(self, event: Mapping[str, Any]) -> None:
        """Take an input event, a row of `input_events` or a message's."""
        kind, code = event["kind"], event["code"]
        if kind in _RELEASES:
            self._down.clear()
        if kind in _PRESSES and code is not None and not event["repeat"]:
            by, is_down = _PRESSES[kind]
            self._down.pop((by, code), None)  # type: ignore[arg-type]
            if is_down:
                self._down[by, code] = bool(event["trusted"])  # type: ignore[index]

    @property
    def down(self) -> list[tuple[Input, str]]:
        """(input, `event.code` or the name of a button's action) of all that is down, the newest last."""
        return list(self._down)

    @property
    def is_trusted(self) -> bool:
        """Whether the browser vouches for all that is down."""
        return all(self._down.values())


@dataclass(frozen=True)
class Controls:
    """Which action follows from what is held.

    keys  action -> its keys, of all the task's actions in their order; "KeyA+KeyD" is a combination
    noop  the action of no key; None: the last action again, and the first one at the start
    """

    keys: Mapping[str, Sequence[str]]
    noop: int | None

    @cached_property
    def _codes(self) -> dict[tuple[Input, str], int]:
        found: dict[tuple[Input, str], int] = {}
        for number, (name, codes) in enumerate(self.keys.items()):
            found.update({("key", code): number for code in codes if "+" not in code})
            if codes:
                found["touch", name] = number
        return found

    @cached_property
    def _combinations(self) -> list[tuple[set[tuple[Input, str]], int]]:
        """(keys, action), the largest first."""
        found: list[tuple[set[tuple[Input, str]], int]] = [
            ({("key", each) for each in code.split("+")}, number)
            for number, codes in enumerate(self.keys.values())
            for code in codes
            if "+" in code
        ]
        return sorted(found, key=lambda each: -len(each[0]))

    def action(self, down: Sequence[tuple[Input, str]], before: int) -> tuple[int, Input | None]:
        """Return the action of what is down, and what decided: a key, a touch, or None for nothing.

        The largest combination that is held, else the newest key or button that names an action, else the no-op.

        down    of `Held.down`
        before  the action of the tick before
        """
        for keys, number in self._combinations:
            if keys <= {*down}:
                return number, "key"
        for each in reversed(down):
            if each in self._codes:
                return self._codes[each], each[0]
        return (before if self.noop is None else self.noop), None


def controls_of(rules: Rules, settings: Iterable[Mapping[str, Any]] = ()) -> tuple[Controls, ...]:
    """Return the controls of a task's own keys, and those of each version of a participant's settings, the newest last."""
    keys = ({**rules.keys, **(each.get("keys") or {})} for each in ({}, *settings))
    return tuple(Controls(each, rules.noop) for each in keys)


def pauses_of(times_ms: Iterable[float]) -> list[float]:
    """Return the lengths (ms) of an episode's pauses; `times_ms` are those of its ticks."""
    return [after - before for before, after in pairwise(times_ms) if after - before >= PAUSE_MS]


def late_share(times_ms: Sequence[float], clock: int) -> float:
    """Return the share (0..1) of an episode's ticks that came more than a frame late, those after a pause left out."""
    gaps = [after - before for before, after in pairwise(times_ms) if after - before < PAUSE_MS]
    return sum(gap > 2 * 1000 / clock + 1 for gap in gaps) / (len(gaps) or 1)


class BoardClock:
    """The clock of one board: it stands, counts down, or runs.

    state    as the page is told; a new object with each change
    ticking  all clocks that run, on whatever server of this process
    """

    ticking: ClassVar[WeakSet[BoardClock]] = WeakSet()

    def __init__(self, board: Session, frames: int) -> None:
        self._board, self._frames = board, frames
        self._held, self._round = Held(), 0
        self._task: asyncio.Task[None] | None = None
        self.state = ClockState(episode="", state="standing")

    @property
    def shares_commits(self) -> bool:
        """Whether its ticks wait a moment for those of other boards, to be committed with them."""
        return len(self.ticking) > FEW

    @property
    def is_standing(self) -> bool:
        """Whether no tick comes until the page asks for it."""
        return self.state.state == "standing"

    def stand(self, reason: str = "", is_new: bool = False) -> None:
        """Let the board stand still from now on, whose tick under way is made yet; `is_new` for a new episode."""
        if is_new or not self.is_standing:
            self._round += 1
            self._tell("standing", reason=reason)

    def take(self, events: Sequence[InputEvent]) -> None:
        """Take input events of the running episode, which are being stored; hold the board's `changing`."""
        for event in events:
            if self.state.state == "running":
                self._held.take(event.__dict__)
            if event.kind in ("hidden", "pause"):
                self.stand()
            elif event.kind == "resume" and self.is_standing:
                self._round += 1
                self._tell("countdown", ms=PAUSE_MS)
                self._task = asyncio.create_task(self._run(self._round))

    async def _run(self, mine: int) -> None:
        """Count down and tick, for as long as this round lasts; whoever asked for it is charged for what is stored."""
        try:
            await self._board.end_if_left()
            await asyncio.sleep(COUNTDOWN_S)
            async with self._board.changing:
                if self._round != mine:
                    return
                self._held = await self._board.held_keys()
                self._tell("running")
            self.ticking.add(self)
            await self._tick(mine)
        except (StoreError, ValueError) as error:
            self.stand(str(error))
        finally:
            if self.is_standing:
                self.ticking.discard(self)

    async def _tick(self, mine: int) -> None:
        loop, frame_s = asyncio.get_running_loop(), 1 / self._frames
        due = loop.time()
        while self._round == mine:
            due += frame_s
            await asyncio.sleep(max(0.0, due - loop.time()))
            if self._round != mine:
                return
            late_s = loop.time() - due
            if late_s > STALL_S:
                self.stand(STALLED)
                return
            if late_s > frame_s:
                due = loop.time()  # nothing is made up for
            await self._board.tick(self._held)

    def _tell(
        self, state: Literal["standing", "countdown", "running"], ms: int = 0, reason: str = ""
    ) -> None:
        self.state = ClockState(
            episode=self._board.current.id, state=state, ms=ms, reason=reason or None
        )
        self._board.channel.notify()
