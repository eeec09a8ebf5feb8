"""Jobs in parallel on this machine, each in a process of one thread, as many at a time as there are cores.

Ctrl-C stops them softly: each saves at its next report. When this process is killed they notice and do the same; when one of
them is killed it is begun again and goes on from what it last saved.
"""

from __future__ import annotations

import fcntl
import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection as connections
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path

from marsexplorer.paper.job import Job
from marsexplorer.paper.scheduling.forecast import Forecast
from marsexplorer.paper.scheduling.worker import STOP, Inherited, Report, work

LOOK_INTERVAL_S = 0.5
"""Seconds between two calls of `on_change` when nothing is reported."""
STOP_PATIENCE_S = 60.0
"""Seconds that jobs have to save in after Ctrl-C before they are killed."""
LOCK_PATIENCE_S = 3.0
"""Seconds to wait for the lock: workers of a run that was killed save, and hold it until then."""
TRIES = 3
"""Times that a job is begun whose process is killed."""
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


class BusyError(RuntimeError):
    """Another run is at work in the folder."""


@dataclass(frozen=True)
class Failure:
    """A job that failed, and why, in a sentence."""

    name: str
    error: str


@dataclass
class _Worker:
    """A job under way in a process."""

    job: Job
    process: SpawnProcess
    connection: Connection
    begun: float
    last: Report | None = None


@contextmanager
def lock(folder: Path, patience_s: float | None = None) -> Iterator[int]:
    """Hold the folder for one run and yield the lock's descriptor; a killed process frees it.

    patience_s   seconds to wait for it, LOCK_PATIENCE_S unless given; BusyError when it is held longer
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as file:
        deadline = time.monotonic() + (LOCK_PATIENCE_S if patience_s is None else patience_s)
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise BusyError(
                        f"another run is at work in {folder}; wait for it, or give another --out"
                    ) from None
                time.sleep(0.1)
        yield file.fileno()


class Schedule:
    """Runs jobs in their order.

    folder      that the jobs write in
    forecast    of the jobs, which `run` keeps up to date
    on_change   called after each report, and about twice a second
    on_stop     called when Ctrl-C has come and the jobs begin to save
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        folder: Path,
        workers: int,
        on_change: Callable[[Forecast], None] | None = None,
        on_stop: Callable[[], None] | None = None,
    ) -> None:
        self._folder, self._workers = folder, workers
        self.forecast = Forecast.of(jobs, folder, workers)
        self._on_change, self._on_stop = (
            on_change or (lambda forecast: None),
            on_stop or (lambda: None),
        )
        self._waiting = deque(job for job in jobs if not self.forecast.courses[job.name].is_ended)
        self._tries = {job.name: 0 for job in jobs}
        self._spent: dict[str, tuple[float, float]] = {job.name: (0.0, 0.0) for job in jobs}
        self._running: list[_Worker] = []
        self.failures: list[Failure] = []

    def run(self, lock_descriptor: int) -> list[Failure]:
        """Run what is not done and return the jobs that failed, which leave the others running.

        lock_descriptor   that `lock` yields: every process holds it, so that the folder is free only when all have ended

        KeyboardInterrupt once every process has saved and ended; a second one kills them at once.
        """
        try:
            while self._waiting or self._running:
                while self._waiting and len(self._running) < self._workers:
                    self._begin(self._waiting.popleft(), lock_descriptor)
                self._look()
        except BaseException:
            self._stop()
            raise
        return self.failures

    def _begin(self, job: Job, lock_descriptor: int) -> None:
        own, other = multiprocessing.Pipe()
        self._tries[job.name] += 1
        with _one_thread(), _without_interrupts():
            spawn = multiprocessing.get_context("spawn")
            process = spawn.Process(
                target=work,
                args=(job, self._folder, other, Inherited(lock_descriptor)),
                name=job.name,
            )
            process.start()
            self._running.append(_Worker(job, process, own, time.monotonic()))
        other.close()

    def _look(self) -> None:
        """Take in what has been reported; wait for it for a moment."""
        ready = connections.wait([worker.connection for worker in self._running], LOOK_INTERVAL_S)
        for worker in [each for each in self._running if each.connection in ready]:
            try:
                worker.last = worker.connection.recv()
            except (EOFError, OSError):
                self._take_end(worker)
            else:
                self._take_report(worker, worker.last)
        self._on_change(self.forecast)

    def _take_report(self, worker: _Worker, report: Report) -> None:
        cpu_s, wall_s = self._spent[worker.job.name]
        cpu_s, wall_s = cpu_s + report.cpu_s, wall_s + time.monotonic() - worker.begun
        self.forecast.report(worker.job.name, report.share, cpu_s, wall_s)

    def _take_end(self, worker: _Worker) -> None:
        """Take in that a process has ended: after its last report, or killed."""
        worker.process.join()
        worker.connection.close()
        self._running.remove(worker)
        name, last = worker.job.name, worker.last
        if last is not None and last.kind == "done":
            self.forecast.end(name, is_done=True)
        elif last is not None and last.kind == "failed":
            self._fail(name, last.error)
        elif self._tries[name] < TRIES:
            course = self.forecast.courses[name]
            self._spent[name] = (course.cpu_s, course.wall_s)
            self._waiting.appendleft(worker.job)
        else:
            self._fail(
                name,
                f"its process was ended {TRIES} times, the last time with code {worker.process.exitcode}",
            )

    def _fail(self, name: str, error: str) -> None:
        self.forecast.end(name, is_done=False)
        self.failures.append(Failure(name, error))

    def _stop(self) -> None:
        """Have every process save and end; kill those that take too long, or all when Ctrl-C comes again."""
        try:
            self._on_stop()
            for worker in self._running:
                with _without_errors():
                    worker.connection.send(STOP)
            deadline = time.monotonic() + STOP_PATIENCE_S
            for worker in self._running:
                self._drain(worker, deadline)
        finally:
            for worker in self._running:
                worker.process.kill()
                worker.process.join()

    def _drain(self, worker: _Worker, deadline: float) -> None:
        """Read what a process still reports until it has ended or the time is over."""
        while (left := deadline - time.monotonic()) > 0:
            if worker.connection.poll(left):
                try:
                    worker.last = worker.connection.recv()
                    self._take_report(worker, worker.last)
                except (EOFError, OSError):
                    worker.process.join(max(0.0, deadline - time.monotonic()))
                    return


@contextmanager
def _without_errors() -> Iterator[None]:
    """Let a process be gone already."""
    try:
        yield
    except OSError:
        return


@contextmanager
def _one_thread() -> Iterator[None]:
    """Set the libraries of processes that start now to one thread: the processes share the cores already."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Keep Ctrl-C, which a terminal sends to all processes, from those that start now: they are told to stop instead."""
    resource_tracker.ensure_running()  # its start would undo the next line
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
