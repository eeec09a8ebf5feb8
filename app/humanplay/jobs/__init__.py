"""The one runner of what takes long: worker processes, and fair turns for owners.

A job is a function that can be imported, with arguments that can be pickled. It runs in a worker
process beside the server or the command: each is `python -m humanplay.jobs`. The number of workers
is bounded. What goes wrong with one job is that job's alone: it may take too long, or its process
may be killed.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Hashable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypedDict, TypeVar, Unpack

from humanplay.jobs import held

IDLE_S = 60.0
"""Seconds after which a worker without a job ends and gives back its memory."""
REMEMBERED_S = 600.0
"""Seconds for which a job that failed is not tried again."""
MOST_REMEMBERED = 1000
"""Failures that are remembered, the newest."""
RETRY_S = 5
"""Seconds after which an owner of too many jobs may ask again."""
_LIBRARIES = ("OMP", "MKL", "OPENBLAS", "NUMBA")
ONE_THREAD = dict.fromkeys((f"{library}_NUM_THREADS" for library in _LIBRARIES), "1")
"""The libraries of a worker compute in one thread: the workers share the cores already."""
_passed_on: dict[str, Callable[[], str]] = {}

CLOSED = "the server was closed before this was done"

Progress = Callable[[int, int], None]
T = TypeVar("T")


class JobError(RuntimeError):
    """A job was not done: it took too long, or its process or the runner ended."""


class JobsFullError(RuntimeError):
    """An owner has too many jobs that wait, or the runner is closed."""


def pass_on(variable: str, text: Callable[[], str]) -> None:
    """Set a variable of the environment for workers that start from now on."""
    _passed_on[variable] = text


def cores() -> int:
    """How many processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class JobOptions(TypedDict, total=False):
    """How a job is run.

    owner        whose turn it takes
    key          of jobs with the same result: while one waits or runs, the others get its future,
                 and what failed is refused with the same error for REMEMBERED_S seconds
    limit_s      seconds that it may run
    on_progress  called with (done, in all), in a thread of this process; the function then gets
                 `progress=`, which it calls with the same
    """

    owner: str
    key: Hashable | None
    limit_s: float | None
    on_progress: Progress | None


@dataclass(frozen=True, eq=False)
class _Job:
    """A call that waits or runs; see `JobOptions`."""

    function: Callable[..., object]
    arguments: tuple[object, ...]
    future: Future[Any]
    owner: str = ""
    key: Hashable | None = None
    limit_s: float | None = None
    on_progress: Progress | None = None


class Jobs(Executor):
    """Runs jobs in at most `workers` processes.

    They start with the first jobs and end when there are none.

    Owners take turns: each gives one job, then comes the next owner. All calls may come from any
    thread.

    It is an executor of `concurrent.futures`, but closing it, also by leaving a `with` block, ends
    what still runs.

    Args:
        workers: None takes one for each core.
        per_owner: Jobs of one owner that run at the same time, at most; None: as many as there
            are workers.
        most_waiting: Jobs of one owner that wait, at most; None for no bound.
        nice: Added to the niceness of the worker processes.
    """

    def __init__(
        self,
        workers: int | None = None,
        *,
        per_owner: int | None = None,
        most_waiting: int | None = None,
        nice: int = 0,
    ) -> None:
        self._nice = nice
        self._most_workers = workers or cores()
        self._per_owner, self._most_waiting = per_owner or self._most_workers, most_waiting
        self._changed = threading.Condition()
        self._threads: dict[threading.Thread, _Process | None] = {}
        self._idle = 0
        self._waiting: dict[str, deque[_Job]] = {}
        self._running: Counter[str] = Counter()
        self._by_key: dict[Hashable, Future[Any]] = {}
        self._failed: dict[Hashable, tuple[float, BaseException]] = {}
        self._is_closed = False

    def waiting(self) -> int:
        """How many jobs wait, of all owners."""
        with self._changed:
            return sum(map(len, self._waiting.values()))

    def __enter__(self) -> Jobs:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def submit(  # type: ignore[override]
        self,
        function: Callable[..., T],
        /,
        *arguments: object,
        **options: Unpack[JobOptions],
    ) -> Future[T]:
        """Queue `function(*arguments)` and return its future.

        The future raises what the function raises, and JobError if its process ended early or it
        took longer than `limit_s`.

        Raises:
            JobsFullError: If too many jobs of this owner wait.
        """
        future: Future[T] = Future()
        job = _Job(function, arguments, future, **options)
        with self._changed:
            if self._is_closed:
                raise JobsFullError("this server is closing; ask again in a minute")
            if job.key is not None and (earlier := self._earlier(job.key)) is not None:
                return earlier
            waiting = self._waiting.get(job.owner, deque())
            if self._most_waiting is not None and len(waiting) >= self._most_waiting:
                raise JobsFullError(
                    f"{len(waiting)} things that take long are being worked out for you already; ask again in {RETRY_S} s"
                )
            self._waiting.setdefault(job.owner, waiting).append(job)
            if job.key is not None:
                self._by_key[job.key] = future
                future.add_done_callback(partial(self._forget, job.key))
            waiting_jobs = sum(map(len, self._waiting.values()))
            if waiting_jobs > self._idle and len(self._threads) < self._most_workers:
                thread = threading.Thread(target=self._serve, name="jobs", daemon=True)
                self._threads[thread] = None
                thread.start()
            self._changed.notify_all()
        return future

    async def run(
        self, function: Callable[..., T], *arguments: object, **options: Unpack[JobOptions]
    ) -> T:
        """A job's result; see `submit` and `result_of`."""
        return await result_of(self.submit(function, *arguments, **options))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """As `close`: nothing goes on after it, whatever is asked for."""
        del wait, cancel_futures
        self.close()

    def close(self) -> None:
        """End every worker at once, and with JobError every job that waits or runs."""
        with self._changed:
            self._is_closed = True
            left = [job for waiting in self._waiting.values() for job in waiting]
            self._waiting.clear()
            threads = dict(self._threads)
            self._changed.notify_all()
        for job in left:
            if job.future.set_running_or_notify_cancel():
                job.future.set_exception(JobError(CLOSED))
        for worker in threads.values():
            if worker is not None:
                worker.end()
        for thread in threads:
            thread.join()

    def _earlier(self, key: Hashable) -> Future[Any] | None:
        """The future of the job with this key that waits, runs, or failed lately."""
        if key in self._by_key:
            return self._by_key[key]
        until, error = self._failed.get(key, (0.0, None))
        if error is None or time.monotonic() > until:
            self._failed.pop(key, None)
            return None
        failed: Future[Any] = Future()
        failed.set_exception(error.with_traceback(None))
        return failed

    def _forget(self, key: Hashable, future: Future[T]) -> None:
        with self._changed:
            if self._by_key.get(key) is future:
                del self._by_key[key]

    def _serve(self) -> None:
        """Run one job after the other on one worker, until none comes for IDLE_S."""
        thread = threading.current_thread()
        try:
            while (job := self._take(thread)) is not None:
                self._perform(job, thread)
        finally:
            if (worker := self._threads.pop(thread, None)) is not None:
                worker.end()

    def _take(self, thread: threading.Thread) -> _Job | None:
        """The next job; None if there was none for IDLE_S, or the runner is closed."""
        deadline = time.monotonic() + IDLE_S
        with self._changed:
            self._idle += 1
            try:
                while not self._is_closed:
                    # look for a job before the clock: one that came at the deadline has started no thread
                    if (job := self._next()) is not None:
                        return job
                    if (left := deadline - time.monotonic()) <= 0:
                        break
                    self._changed.wait(left)
            finally:
                self._idle -= 1
            # the next submission starts another thread
            worker = self._threads.pop(thread)
        if worker is not None:
            worker.end()
        return None

    def _next(self) -> _Job | None:
        """Take the job whose turn it is, and put its owner behind the others."""
        for owner, waiting in list(self._waiting.items()):
            if self._running[owner] >= self._per_owner:
                continue
            del self._waiting[owner]
            while waiting and not waiting[0].future.set_running_or_notify_cancel():
                waiting.popleft()
            if not waiting:
                continue
            job = waiting.popleft()
            if waiting:
                self._waiting[owner] = waiting
            self._running[owner] += 1
            return job
        return None

    def _perform(self, job: _Job, thread: threading.Thread) -> None:
        result, error = None, None
        try:
            result = self._worker_of(thread).run(job)
        except Exception as raised:
            error = JobError(CLOSED) if self._is_closed else raised
        with self._changed:
            self._running[job.owner] -= 1
            if not self._running[job.owner]:
                del self._running[job.owner]
            if error is not None and job.key is not None:
                self._failed.pop(job.key, None)
                self._failed[job.key] = time.monotonic() + REMEMBERED_S, error
                if len(self._failed) > MOST_REMEMBERED:
                    del self._failed[next(iter(self._failed))]
            self._changed.notify_all()
        if error is None:
            job.future.set_result(result)
        else:
            job.future.set_exception(error)

    def _worker_of(self, thread: threading.Thread) -> _Process:
        """The worker of a thread, a new one if it has none that lives."""
        worker = self._threads[thread]
        if worker is None or not worker.is_alive():
            if worker is not None:
                worker.end()
            process = _Process(self._nice)
            with self._changed:
                self._threads[thread] = process
                is_closed = self._is_closed
            if is_closed:  # `close` cannot have seen this one
                process.end()
            return process
        return worker


async def result_of(job: Future[T]) -> T:
    """A job's result.

    A caller that stops waiting does not cancel the job: others may wait for it.
    """
    waiting = asyncio.wrap_future(job)
    # asyncio logs an error that nobody has looked at, as when all have stopped waiting
    waiting.add_done_callback(lambda done: done.cancelled() or done.exception())
    return await asyncio.shield(waiting)


def _too_long(limit_s: float | None) -> JobError:
    return JobError(f"this took longer than {limit_s:g} s and was ended")


class _Process:
    """A worker process of this machine, in a session of its own.

    Ctrl-C in this process's terminal is not meant for it.
    """

    def __init__(self, nice: int) -> None:
        self._connection, others = Pipe()
        search = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
        number = others.fileno()
        command = (sys.executable, "-P", "-m", "humanplay.jobs", str(number), str(nice))
        passed_on = {variable: text() for variable, text in _passed_on.items()}
        env = {**os.environ, **ONE_THREAD, **passed_on, "PYTHONPATH": search}
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, pass_fds=[number], env=env, start_new_session=True
        )
        others.close()

    def is_alive(self) -> bool:
        return self._process.poll() is None

    def run(self, job: _Job) -> object:
        """What a job returns.

        Raises:
            JobError: If it takes too long or its process ends early.
            Exception: What the job raises.
        """
        deadline = None if job.limit_s is None else time.monotonic() + job.limit_s
        try:
            reports = job.on_progress is not None
            self._connection.send((held.payloads(), job.function, job.arguments, reports))
            while True:
                left = None if deadline is None else max(0.0, deadline - time.monotonic())
                if not self._connection.poll(left):
                    raise _too_long(job.limit_s)
                kind, payload = self._connection.recv()
                if kind != "progress":
                    break
                assert job.on_progress is not None
                job.on_progress(*payload)
        except (EOFError, ConnectionError, pickle.UnpicklingError) as error:
            self.end()
            code = self._process.returncode
            # a job without a key may be asked for again at once
            later = "" if job.key is None else f" in {REMEMBERED_S / 60:.0f} minutes"
            raise JobError(
                f"its process ended early, with code {code}; ask again{later}"
            ) from error
        except BaseException:
            self.end()  # else its answer would be taken for the next job's
            raise
        if kind == "raised":
            raise payload
        answer: object = payload
        return answer

    def end(self) -> None:
        """Kill the process and those that it started, and wait for its end."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()


def work(connection: Connection) -> None:
    """Run the jobs that come over a connection, one after the other.

    The process ends when the other end is gone.
    """
    coming: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(connection, coming), daemon=True).start()

    def report(done: int, total: int) -> None:
        connection.send(("progress", (done, total)))

    while True:
        job = coming.get()
        try:
            payloads, function, arguments, reports = pickle.loads(job)
            held.take(payloads)
            answer = "done", function(*arguments, **({"progress": report} if reports else {}))
            message = pickle.dumps(answer)
        except Exception as error:
            message = pickle.dumps(("raised", _portable(error)))
        connection.send_bytes(message)


def _listen(connection: Connection, coming: queue.SimpleQueue[bytes]) -> None:
    """Pass on what comes over a connection.

    When the other end is gone, end this process and those that it started.
    """
    try:
        while True:
            coming.put(connection.recv_bytes())
    except (EOFError, OSError):
        os.killpg(0, signal.SIGKILL)


def _portable(error: Exception) -> Exception:
    """An error as it can be sent, its traceback in a note.

    A JobError stands for an error that cannot be pickled.
    """
    error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return JobError(f"{type(error).__name__}: {error}")
    return error


def give_way(nice: int) -> None:
    """Lower the priority of this process and of its session.

    Linux weighs a session as one against others (sched(7), autogroup).
    """
    niceness = str(os.nice(nice))
    for _ in range(10):
        try:
            Path("/proc/self/autogroup").write_text(niceness)
        except BlockingIOError:  # Linux takes one in 100 ms of a user who is not root
            time.sleep(0.1)
        except OSError:  # there are no such groups here
            return
        else:
            return
