"""Compiles beside a server, at lowest priority; the server loads what is ready.

numba's cache is what the two share.

On a thread of the server's, compiling would keep every other board waiting: it holds the interpreter's lock, and numba's own.
"""

from __future__ import annotations

import threading
from concurrent.futures import Future
from contextlib import suppress
from typing import NoReturn

from humanplay.jobs import Jobs, JobsFullError
from humanplay.task import NotReadyError
from marsexplorer.compiled import KernelCall, compiling
from marsexplorer.warmup import step_once, warmups

PRIORITY = 19
"""Niceness of the process that compiles: whoever plays comes first."""
LIMIT_S = 3600.0
"""Seconds that one kernel may take: many, since other programs may leave the lowest priority little."""
PAUSE_S = 0.1
"""Seconds in which a board that waited for a kernel asks for its next one."""


class MissingKernelError(Exception):
    """A kernel is not in the cache; `call` is what to compile."""

    def __init__(self, call: KernelCall) -> None:
        super().__init__(call.name)
        self.call = call


class Compilation:
    """Compiles a server's kernels one by one: those that boards need come first."""

    def __init__(self) -> None:
        self._jobs = Jobs(1, nice=PRIORITY)
        self._asked: dict[KernelCall, Future[None]] = {}
        self._rest: Future[bool] | None = None
        self._warmups_done = 0

    def start(self) -> None:
        """Compile nothing in this process from now on, and load what a first board needs."""
        compiling.instead = self._compile_beside
        with suppress(NotReadyError):
            step_once()

    def close(self) -> None:
        """End the process that compiles."""
        compiling.instead = None
        self._jobs.close()

    @property
    def is_running(self) -> bool:
        """Whether something that was asked for is not compiled yet."""
        return any(not future.done() for future in list(self._asked.values()))

    def _compile_beside(self, call: KernelCall) -> NoReturn:
        """Request a kernel that the cache lacks, and raise NotReadyError.

        RuntimeError if it was compiled in vain.
        """
        future = self._asked.get(call)
        if future is not None and future.done() and future.exception() is None:
            raise RuntimeError(
                f"expected {call.name} in numba's cache, where another process has put it, and it is not there: "
                "start the server again"
            )
        if future is None or future.done():
            submit = self._jobs.submit
            future = self._asked[call] = submit(call.compile, key=call, limit_s=LIMIT_S)
            future.add_done_callback(self._go_on)
        raise NotReadyError(future)

    def _go_on(self, _: object) -> None:
        """Compile a kernel that nobody needs yet, unless a waiting board asks for another."""
        timer = threading.Timer(PAUSE_S, self._compile_rest)
        timer.daemon = True
        timer.start()

    def _compile_rest(self) -> None:
        if self._rest is not None:
            if not self._rest.done():
                return
            if self._rest.exception() is not None or not self._rest.result():
                self._warmups_done += 1  # all of its kernels are compiled, or cannot be
            self._rest = None
        if self._warmups_done < len(warmups()) and not self.is_running:
            with suppress(JobsFullError):  # the server is closing
                self._rest = self._jobs.submit(advance, self._warmups_done, limit_s=LIMIT_S)
                self._rest.add_done_callback(self._go_on)


def advance(number: int) -> bool:
    """Compile the first kernel that a warm-up misses; return whether it missed one."""
    compiling.instead = _raise_missing
    try:
        warmups()[number]()
    except MissingKernelError as missing:
        compiling.instead = None
        missing.call.compile()
        return True
    finally:
        compiling.instead = None
    return False


def _raise_missing(call: KernelCall) -> NoReturn:
    raise MissingKernelError(call)
