"""The thread that makes all writes of a server, in the order in which they were asked for.

The event loop never waits for SQLite: whoever wants to write puts a function into the queue and awaits its result, which comes
after the commit. Writes that wait together are committed together. The thread waits for another program's lock and for a slow
disk; whatever only reads goes on meanwhile (`app.database_file.read_threads`).
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any, TypeVar

from app.database_file.file import StoreError, WriteRefusedError

T = TypeVar("T")
Notice = Callable[[str], Awaitable[None]]

PATIENCE_S = 30.0
"""Seconds after which a write that has not begun is refused."""
NOTICE_S = 1.0
"""Seconds after which whoever waits is told why."""
MAX_WAITING = 1_000
"""Writes that wait at a time; further ones are refused at once."""
GATHERED_S = 0.005
"""Seconds that a write which nobody waits for may wait for another one, to be committed with it."""
MOST_TOGETHER = 64
"""Writes that are committed together, at most."""
SHORTEST_PAUSE_S, LONGEST_PAUSE_S = 0.002, 0.05

WAITS = "another program is writing the server's database: your move waits, and is made as soon as that program is done"
SLOW = "the server's disk is slow to answer: your move waits, and is made as soon as it is recorded"
LOCKED = "another program is writing the server's database and has not finished: nothing has changed; try again in a moment"
NOT_BEGUN = (
    "the server's disk has not answered for a while: nothing has changed; try again in a moment"
)
FULL = "more waits to be recorded than the server's disk takes: nothing has changed; try again in a moment"
ENDS = "the server is about to stop: nothing has changed; try again in a moment"
BROKEN = (
    "the part of the server that records moves has failed: no move is made and nothing is recorded until the server is "
    "started anew; its log says what went wrong"
)
_log = logging.getLogger(__name__)


@dataclass(eq=False, slots=True)
class _Write:
    """A write that waits: what makes it, what follows its commit, and who waits for it until when (monotonic seconds)."""

    work: Callable[[], Any]
    then: Callable[[Any], None] | None
    done: asyncio.Future[Any]
    notice: Notice | None
    deadline: float
    claim: threading.Lock = field(default_factory=threading.Lock)
    """Whoever acquires it decides: the thread makes the write, or the event loop refuses it."""
    result: Any = None
    error: BaseException | None = None


class WriteQueue:
    """The writes of one database; without a started thread each is made at once by whoever asks.

    commit     commits what the writes since the last call wrote
    roll_back  takes it back
    fault      one sentence when the thread has ended by an error, so that nothing can be recorded; else None
    """

    def __init__(self, commit: Callable[[], None], roll_back: Callable[[], None]) -> None:
        self._commit, self._roll_back = commit, roll_back
        self._gathered: list[_Write] = []
        self._is_due = False
        self._unanswered: deque[_Write] = deque()
        self._timer: asyncio.TimerHandle | None = None
        self._queue: SimpleQueue[list[_Write] | None] = SimpleQueue()
        self._waiting = 0
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop
        self._is_ending = False
        self._deadline, self._pause_s, self._is_locked = 0.0, SHORTEST_PAUSE_S, False
        self._notices: set[asyncio.Task[None]] = set()
        self.fault: str | None = None

    def __len__(self) -> int:
        """Return how many writes wait."""
        return self._waiting

    @property
    def is_started(self) -> bool:
        """Return whether the thread makes the writes, and nobody else may."""
        return self._thread is not None

    @property
    def is_own_thread(self) -> bool:
        """Return whether the thread of the writes asks."""
        return self._thread is not None and threading.get_ident() == self._thread.ident

    def start(self) -> None:
        """Let a thread make the writes from now on; call it on the running event loop."""
        self._loop, self._is_ending, self._timer = asyncio.get_running_loop(), False, None
        self._thread = threading.Thread(target=self._make_writes, name="writes", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Make the writes that wait, then end the thread; call it in another thread, while the event loop runs."""
        if self._thread is not None:
            try:
                self._loop.call_soon_threadsafe(self._end)
            except RuntimeError:  # the event loop has ended
                self._end()
            self._thread.join()
            self._thread = None

    def put(
        self,
        work: Callable[[], T],
        notice: Notice | None = None,
        then: Callable[[T], None] | None = None,
        is_awaited: bool = True,
    ) -> asyncio.Future[T]:
        """Queue a write and return the result of `work()` to come: it is called on the thread of the writes, then committed.

        notice      told one sentence when the wait has lasted NOTICE_S
        then        called with the result on the event loop, right after the commit: also when whoever waits was cancelled
        is_awaited  whether somebody waits; else it may wait for another one for GATHERED_S

        An error of `work` is passed on. WriteRefusedError after PATIENCE_S when the write has not begun, or at once while
        MAX_WAITING writes wait. StoreError when the commit failed.
        """
        if self._thread is None:
            made = asyncio.get_running_loop().create_future()
            made.set_result(work())
            if then is not None:
                then(made.result())
            return made
        if self.fault is not None:
            raise StoreError(self.fault)
        if self._is_ending or self._waiting >= MAX_WAITING:
            raise WriteRefusedError(ENDS if self._is_ending else FULL)
        loop = self._loop
        write = _Write(work, then, loop.create_future(), notice, loop.time() + PATIENCE_S)
        self._waiting += 1
        self._unanswered.append(write)
        if self._timer is None:
            self._set_timer()
        self._gathered.append(write)
        if is_awaited and not self._is_due:
            self._is_due = True
            loop.call_soon(self._hand_over)
        elif len(self._gathered) == 1:
            loop.call_later(GATHERED_S, self._hand_over)
        return write.done

    def wait_for_lock(self) -> bool:
        """Wait a moment for another program's lock; return False when the write that is being made has waited long enough.

        Only `work` calls it, on the thread of the writes.
        """
        if self._is_ending or time.monotonic() >= self._deadline:
            return False
        self._is_locked = True
        time.sleep(self._pause_s)
        self._pause_s = min(2 * self._pause_s, LONGEST_PAUSE_S)
        return True

    def _hand_over(self) -> None:
        """Hand what came in one turn of the event loop to the thread, at once: waking it costs more than a write."""
        self._is_due = False
        if self._gathered:
            self._queue.put(self._gathered)
            self._gathered = []

    def _end(self) -> None:
        """Take no further write, and let the thread end behind what was gathered; between two turns nobody else gathers."""
        self._is_ending = True
        self._hand_over()
        self._queue.put(None)

    def _make_writes(self) -> None:
        waiting, batch, is_last = deque[_Write](), list[_Write](), False
        try:
            while waiting or not is_last:
                if not waiting:
                    is_last = self._take(waiting)
                    continue
                while waiting and len(batch) < MOST_TOGETHER:
                    batch.append(waiting.popleft())
                    self._make(batch[-1])
                    if not waiting and not is_last and not self._queue.empty():
                        is_last = self._take(waiting)  # it came meanwhile, and shares the commit
                self._commit_all(batch)
                self._call(self._answer, batch)
                batch = []
        except BaseException:
            _log.exception("the thread that makes the writes has failed")
            self.fault = BROKEN
            with suppress(Exception):
                self._roll_back()
            self._call(self._fail, [*batch, *waiting])

    def _take(self, waiting: deque[_Write]) -> bool:
        """Take what was handed over, wait for it if need be, and return whether nothing comes after it."""
        handed = self._queue.get()
        waiting.extend(handed or ())
        return handed is None

    def _make(self, write: _Write) -> None:
        if not write.claim.acquire(blocking=False):
            return  # it was refused
        self._deadline, self._pause_s = write.deadline, SHORTEST_PAUSE_S
        try:
            if time.monotonic() >= write.deadline:
                raise WriteRefusedError(LOCKED if self._is_locked else NOT_BEGUN)
            write.result = write.work()
        except Exception as error:
            write.error = error

    def _commit_all(self, batch: Sequence[_Write]) -> None:
        try:
            self._commit()
        except Exception as error:
            for write in batch:
                write.error = write.error or error
        self._is_locked = False

    def _call(self, on_loop: Callable[[Sequence[_Write]], None], batch: Sequence[_Write]) -> None:
        with suppress(RuntimeError):  # the event loop has ended, and nobody waits any more
            self._loop.call_soon_threadsafe(on_loop, batch)

    def _answer(self, batch: Sequence[_Write]) -> None:
        """Let those whose writes were made, or refused, go on."""
        for write in batch:
            self._waiting -= 1
            if write.error is None and write.then is not None and not _is_refused(write):
                try:
                    write.then(write.result)
                except Exception as error:
                    _log.exception("what follows a write has failed")
                    write.error = error
            if write.done.done():
                continue
            if write.error is None:
                write.done.set_result(write.result)
            else:
                write.done.set_exception(write.error)
        self._drop_answered()

    def _drop_answered(self) -> None:
        """Forget the oldest writes as far as they are answered; mostly none are left, since answers come in order."""
        while self._unanswered and self._unanswered[0].done.done():
            self._unanswered.popleft()

    def _fail(self, batch: Sequence[_Write]) -> None:
        """Refuse what was being made and what waits, since the thread has ended."""
        self._hand_over()
        waiting = list(batch)
        while not self._queue.empty():
            waiting += self._queue.get() or ()
        for write in waiting:
            write.error = StoreError(BROKEN)
        self._answer(waiting)

    def _set_timer(self) -> None:
        """Let the oldest write that waits be looked at when it has waited for NOTICE_S: one timer serves all of them."""
        self._timer = self._loop.call_at(
            self._unanswered[0].deadline - PATIENCE_S + NOTICE_S, self._look_at_waiting
        )

    def _look_at_waiting(self) -> None:
        self._timer = None
        self._drop_answered()
        while (
            self._unanswered
            and self._unanswered[0].deadline - PATIENCE_S + NOTICE_S <= self._loop.time()
        ):
            self._tell_why(self._unanswered.popleft())
            self._drop_answered()
        if self._unanswered:
            self._set_timer()

    def _tell_why(self, write: _Write) -> None:
        """Tell whoever waits why, and refuse the write when it has not begun in time."""
        self._loop.call_later(PATIENCE_S - NOTICE_S, self._refuse, write)
        if write.notice is not None:
            task = self._loop.create_task(_send(write.notice, WAITS if self._is_locked else SLOW))
            self._notices.add(task)
            task.add_done_callback(self._notices.discard)

    def _refuse(self, write: _Write) -> None:
        if not write.done.done() and write.claim.acquire(blocking=False):
            write.done.set_exception(WriteRefusedError(LOCKED if self._is_locked else NOT_BEGUN))


def _is_refused(write: _Write) -> bool:
    return write.done.done() and not write.done.cancelled() and write.done.exception() is not None


async def _send(notice: Notice, text: str) -> None:
    await notice(text)
