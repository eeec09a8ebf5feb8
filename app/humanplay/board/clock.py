"""Real-time play: the clock of a board whose task has one.

A board with a clock stands still until its page asks for it to go on. After a countdown the server
makes a move at each tick; its action follows from the keys that are down
(`humanplay.board.controls`). Hiding the page, a lost or a second connection and a server that falls
behind let the board stand still, and all keys count as up when it goes on.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import ClassVar, Literal, Protocol
from weakref import WeakSet

from humanplay.board.controls import COUNTDOWN_S, PAUSE_MS, HeldKeys
from humanplay.board.messages import ClockState, InputEvent
from humanplay.db.store import StoreError

STALL_S = 1.0
"""A tick that would come later than this lets the board stand still instead."""
FEW = 4
"""Boards that tick at once and commit each tick by itself; those of more wait a moment for each
other, which saves commits."""
STALLED = "The server could not keep up for a moment, so the board stands still."
TAKES_KEYS = "time runs on this board: it takes the keys that are held, and no moves"


class TickingBoard(Protocol):
    """What the clock asks of its board."""

    @property
    def episode(self) -> str:
        """The id of the current episode."""

    @property
    def changing(self) -> asyncio.Lock:
        """Held while the episode changes."""

    def notify(self) -> None:
        """Wake whoever looks at the board."""

    async def end_if_left(self) -> None:
        """End an episode that stood still more often or for longer than is allowed."""

    async def held_keys(self) -> HeldKeys:
        """Return what is held by the stored input events; hold `changing`."""

    async def tick(self, held: HeldKeys) -> None:
        """Make the move that follows from what is held."""


class BoardClock:
    """The clock of one board: it stands, counts down, or runs.

    Attributes:
        state: As the page is told; a new object with each change.
        ticking: All clocks that run, on whatever server of this process.
    """

    ticking: ClassVar[WeakSet[BoardClock]] = WeakSet()

    def __init__(self, board: TickingBoard, frames: int) -> None:
        self._board, self._frames = board, frames
        self._held, self._round = HeldKeys(), 0
        self._task: asyncio.Task[None] | None = None
        self.state = ClockState(episode="", state="standing")

    @property
    def shares_commits(self) -> bool:
        """Whether its ticks wait a moment to be committed with other boards' ticks."""
        return len(self.ticking) > FEW

    @property
    def is_standing(self) -> bool:
        """Whether no tick comes until the page asks for it."""
        return self.state.state == "standing"

    def stand(self, reason: str = "", is_new: bool = False) -> None:
        """Let the board stand still from now on; the tick under way is still made.

        Args:
            is_new: Whether a new episode begins, which is told even if the board stood already.
        """
        if is_new or not self.is_standing:
            self._round += 1
            self._tell("standing", reason=reason)

    def take(self, events: Sequence[InputEvent]) -> None:
        """Take input events of the running episode while they are being stored.

        Hold the board's `changing`.
        """
        for event in events:
            if self.state.state == "running":
                self._held.take(event.kind, event.code, event.repeat, event.trusted)
            if event.kind in ("hidden", "pause"):
                self.stand()
            elif event.kind == "resume" and self.is_standing:
                self._round += 1
                self._tell("countdown", ms=PAUSE_MS)
                self._task = asyncio.create_task(self._run(self._round))

    async def _run(self, round_: int) -> None:
        """Count down and tick for as long as this round lasts."""
        try:
            await self._board.end_if_left()
            await asyncio.sleep(COUNTDOWN_S)
            async with self._board.changing:
                if self._round != round_:
                    return
                self._held = await self._board.held_keys()
                self._tell("running")
            self.ticking.add(self)
            await self._tick(round_)
        except (StoreError, ValueError) as error:
            self.stand(str(error))
        finally:
            if self.is_standing:
                self.ticking.discard(self)

    async def _tick(self, round_: int) -> None:
        loop, frame_s = asyncio.get_running_loop(), 1 / self._frames
        due = loop.time()
        while self._round == round_:
            due += frame_s
            await asyncio.sleep(max(0.0, due - loop.time()))
            if self._round != round_:
                return
            late_s = loop.time() - due
            if late_s > STALL_S:
                self.stand(STALLED)
                return
            if late_s > frame_s:
                due = loop.time()  # a late tick is not made up for by quick ones
            await self._board.tick(self._held)

    def _tell(
        self, state: Literal["standing", "countdown", "running"], ms: int = 0, reason: str = ""
    ) -> None:
        self.state = ClockState(
            episode=self._board.episode, state=state, ms=ms, reason=reason or None
        )
        self._board.notify()
