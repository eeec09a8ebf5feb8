"""Real-time play: the clock of a board whose task has one.

A board with a clock stands still until its page asks for it to go on. After a countdown
the server makes a move at each tick; its action follows from the keys that are down
(`humanplay.board.controls`). Hiding the page, a lost or a second connection, and a server that
falls behind stop the board. When it goes on, all keys count as up.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import ClassVar, Literal, Protocol
from weakref import WeakSet

from humanplay.board.controls import COUNTDOWN_S, PAUSE_MS, HeldKeys
from humanplay.board.messages import ClockState, InputEvent
from humanplay.db.store import StoreError
from humanplay.task.sentences import Sentence, SentenceName, sentence_of

STALL_S = 1.0
"""A tick later than this, in seconds, stops the board instead."""

MOST_SEPARATE = 4
"""At most so many running boards commit every tick separately.

If more run, ticks wait a moment and share a commit.
"""

STALLED = Sentence(
    "clock.stalled", "The server could not keep up for a moment, so the board stands still."
)
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

    async def load_keys(self) -> HeldKeys:
        """Return what is held by the stored input events; hold `changing`."""

    async def tick(self, held: HeldKeys) -> None:
        """Make the move that follows from what is held."""


class BoardClock:
    """The clock of one board: it stands, counts down, or runs.

    Attributes:
        state: What the page was told last; every change makes a new object.
        ticking: All running clocks of this process, whatever their server.
    """

    ticking: ClassVar[WeakSet[BoardClock]] = WeakSet()

    def __init__(self, board: TickingBoard, ticks_per_second: int) -> None:
        self._board, self._ticks_per_second = board, ticks_per_second
        self._held, self._round = HeldKeys(), 0
        self._task: asyncio.Task[None] | None = None
        self.state = ClockState(episode="", state="standing")

    @property
    def shares_commits(self) -> bool:
        """Whether its ticks wait a moment to be committed with other boards' ticks."""
        return len(self.ticking) > MOST_SEPARATE

    @property
    def is_standing(self) -> bool:
        """Whether no tick comes until the page asks for it."""
        return self.state.state == "standing"

    def stand(self, reason: str = "", tells_anyway: bool = False) -> None:
        """Stop the board; a tick that has begun is finished.

        Args:
            tells_anyway: Whether the page is told even if the board stands already, as when an
                episode begins or ends.
        """
        if tells_anyway or not self.is_standing:
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
                self._held = await self._board.load_keys()
                self._tell("running")
            self.ticking.add(self)
            await self._tick(round_)
        except (StoreError, ValueError) as error:
            self.stand(sentence_of(error))
        finally:
            if self.is_standing:
                self.ticking.discard(self)

    async def _tick(self, round_: int) -> None:
        loop, tick_s = asyncio.get_running_loop(), 1 / self._ticks_per_second
        due = loop.time()
        while self._round == round_:
            due += tick_s
            await asyncio.sleep(max(0.0, due - loop.time()))
            if self._round != round_:
                return
            late_s = loop.time() - due
            if late_s > STALL_S:
                self.stand(STALLED)
                return
            if late_s > tick_s:
                due = loop.time()  # a late tick is not made up for by quick ones
            await self._board.tick(self._held)

    def _tell(
        self, state: Literal["standing", "countdown", "running"], ms: int = 0, reason: str = ""
    ) -> None:
        name = SentenceName.of(reason)
        self.state = ClockState(
            episode=self._board.episode,
            state=state,
            ms=ms,
            reason=reason or None,
            ident=name.ident,
            values=name.values,
        )
        self._board.notify()
