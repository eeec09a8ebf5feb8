"""The keys that are held on a board whose time runs, and the action that follows.

Whoever has the stored input events can derive every action again: the events before a tick are
those with an earlier `server_ms`.

Pauses and late ticks need no rows of their own. Each tick has its time, and a board that stood
still goes on after a countdown. So a gap as long as that is a pause, and any other gap longer than
two frames is a tick that came late.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from humanplay.db.rows import EventRow, Input, PlayerSettings
from humanplay.task import Allowed, Environment

COUNTDOWN_S = 3.0
"""Seconds from a page's `resume` to the first tick."""
PAUSE_MS = int(COUNTDOWN_S * 1000)
"""A gap between two ticks that is no shorter is a pause."""

_PRESSES: dict[str, tuple[Input, bool]] = {
    "keydown": ("key", True), "keyup": ("key", False), "touchdown": ("touch", True), "touchup": ("touch", False),
}  # fmt: skip
_RELEASES = frozenset({"blur", "hidden", "pause", "resume"})
"""Events after which every key counts as up."""


@dataclass(frozen=True)
class ClockLimits:
    """What an episode may have in time.

    Attributes:
        pauses: How often its board may stand still once it has begun; beyond, the episode ends
            as left.
        paused_s: For how long in all; beyond, it ends as left.
        late: Share (0..1) of its ticks that may come more than a frame late; beyond, it is
            labelled.
    """

    pauses: int = 10
    paused_s: float = 600.0
    late: float = 0.02


class HeldKeys:
    """The keys and buttons that are down, in the order in which they went down."""

    def __init__(self) -> None:
        self._down: dict[tuple[Input, str], bool] = {}

    def take(self, kind: str, code: str | None, repeat: int | None, trusted: int | None) -> None:
        """Take an input event, by the columns of `input_events`."""
        if kind in _RELEASES:
            self._down.clear()
        if kind in _PRESSES and code is not None and not repeat:
            by, is_down = _PRESSES[kind]
            self._down.pop((by, code), None)
            if is_down:
                self._down[by, code] = bool(trusted)

    def take_row(self, event: EventRow) -> None:
        """Take an input event as it is stored."""
        self.take(event["kind"], event["code"], event["repeat"], event["trusted"])

    @property
    def down(self) -> list[tuple[Input, str]]:
        """All that is down, the newest last: (input, `event.code` or button's action)."""
        return list(self._down)

    @property
    def is_trusted(self) -> bool:
        """Whether the browser vouches for all that is down."""
        return all(self._down.values())


@dataclass(frozen=True)
class Controls:
    """Which action follows from what is held.

    Attributes:
        keys: Action -> its keys, of all the task's actions in their order; "KeyA+KeyD" is a
            combination.
        noop: The action of no key; None: the last action again, and the first one at the start.
    """

    keys: Mapping[str, Sequence[str]]
    noop: int | None

    @cached_property
    def _codes(self) -> dict[tuple[Input, str], int]:
        actions: dict[tuple[Input, str], int] = {}
        for number, (name, codes) in enumerate(self.keys.items()):
            actions.update({("key", code): number for code in codes if "+" not in code})
            if codes:
                actions["touch", name] = number
        return actions

    @cached_property
    def _combinations(self) -> list[tuple[set[tuple[Input, str]], int]]:
        """(keys, action), the largest first."""
        combinations: list[tuple[set[tuple[Input, str]], int]] = [
            ({("key", part) for part in code.split("+")}, number)
            for number, codes in enumerate(self.keys.values())
            for code in codes
            if "+" in code
        ]
        return sorted(combinations, key=lambda combination: -len(combination[0]))

    def action(
        self, down: Sequence[tuple[Input, str]], before: int, allowed: Allowed = None
    ) -> tuple[int, Input | None]:
        """The action of what is down, and what decided: a key, a touch, or None.

        It is the largest combination that is held, else the newest key or button that names an
        action, else the no-op. An action that is not allowed becomes the no-op, and if that is not
        allowed either, the lowest allowed action.

        Args:
            down: Of `HeldKeys.down`.
            before: The action of the tick before.
        """
        action, input = self._held_action(down, before)
        if allowed is None or action in allowed:
            return action, input
        return (self.noop if self.noop in allowed else min(allowed)), None

    def _held_action(
        self, down: Sequence[tuple[Input, str]], before: int
    ) -> tuple[int, Input | None]:
        for keys, number in self._combinations:
            if keys <= {*down}:
                return number, "key"
        for key in reversed(down):
            if key in self._codes:
                return self._codes[key], key[0]
        return (before if self.noop is None else self.noop), None


def controls_of(
    environment: Environment, settings: Iterable[PlayerSettings] = ()
) -> tuple[Controls, ...]:
    """The controls of a task's own keys, then of each version of a participant's.

    Args:
        settings: Every version, the newest last.
    """
    versions = [PlayerSettings(), *settings]
    return tuple(
        Controls({**environment.keys, **(version.get("keys") or {})}, environment.noop)
        for version in versions
    )


def pauses_of(times_ms: Iterable[float]) -> list[float]:
    """Lengths (ms) of an episode's pauses.

    Args:
        times_ms: Of its ticks.
    """
    return [after - before for before, after in pairwise(times_ms) if after - before >= PAUSE_MS]


def late_share(times_ms: Sequence[float], clock: int) -> float:
    """The share (0..1) of ticks that came more than a frame late.

    Ticks after a pause are left out.

    Args:
        times_ms: Of the episode's ticks.
        clock: Frames a second.
    """
    gaps = [after - before for before, after in pairwise(times_ms) if after - before < PAUSE_MS]
    return sum(gap > 2 * 1000 / clock + 1 for gap in gaps) / (len(gaps) or 1)
