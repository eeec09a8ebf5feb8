"""Jobs, the units of work of the paper's experiments, in processes of one thread.

As many run at a time as there are cores. A job writes its result at its end, so a run that is
stopped or killed loses only what was under way: the same run begun again does what is left. A
signal ends a job when it reports its progress, so that a long one can save how far it is.
"""

from __future__ import annotations

import fcntl
import json
import multiprocessing
import os
import signal
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any, Protocol

from marsexplorer.files import write_whole

LOOK_INTERVAL_S = 0.5
"""Seconds between two calls of `advance`, at most."""
STOP_TIMEOUT_S = 60.0
"""Seconds that a job has to end by itself before its process is killed."""
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
ERROR_FILE = "error.txt"
"""The traceback of a job that failed, in its folder."""

Line = dict[str, Any]
"""A JSON object, a line of a file."""
OnProgress = Callable[[float], None]
"""Called with the share of a job that is done, 0..1."""


def read_lines(path: Path) -> list[Line]:
    """The objects of a file of JSON Lines, none if there is no file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def write_lines(path: Path, lines: Iterable[Line]) -> Path:
    """Write a file of JSON Lines, whole and without spaces; return its path."""
    text = "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines)
    return write_text(path, text)


def write_text(path: Path, text: str) -> Path:
    """Write a whole text, and its folder if need be; return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_whole(path) as file:
        file.write(text.encode())
    return path


class Job(Protocol):
    """One training or one evaluation, picklable.

    It writes only under `folder / name`, and its whole result last.
    """

    @property
    def name(self) -> str:
        """The name of its folder, unlike any other job's; it describes the job."""

    def is_done(self, folder: Path) -> bool:
        """Whether the whole result is under `folder / name`."""

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        """Do the job; `on_progress` raises KeyboardInterrupt when it has to stop."""


class BusyError(RuntimeError):
    """Another run is at work in the folder."""


@dataclass(frozen=True)
class _Worker:
    job: Job
    process: SpawnProcess
    share: Any


@contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Hold a folder for one run, whose death frees it; BusyError if another holds it."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BusyError(
                f"another run is at work in {folder}; wait for it, or give another --out"
            ) from None
        yield


def run_jobs(
    jobs: Sequence[Job], folder: Path, workers: int, advance: Callable[[int, int], None]
) -> dict[str, str]:
    """Run what is not done, in order; return job -> error, in a sentence.

    A failure leaves the others running.

    Args:
        jobs: The jobs.
        folder: Of their results.
        workers: Jobs at a time.
        advance: Called about twice a second with (per cent done, summed over the jobs; the same in
            all).

    Raises:
        BusyError: If another run is at work in the folder.
    """
    shares = {job.name: float(job.is_done(folder)) for job in jobs}
    waiting = deque(job for job in jobs if not shares[job.name])
    failures: dict[str, str] = {}
    running: list[_Worker] = []
    os.environ.update(ONE_THREAD)  # the processes share the cores already
    with lock(folder):
        try:
            while waiting or running:
                while waiting and len(running) < workers:
                    running.append(_begin(waiting.popleft(), folder))
                connection.wait([worker.process.sentinel for worker in running], LOOK_INTERVAL_S)
                for worker in running.copy():
                    name = worker.job.name
                    shares[name] = worker.share.value
                    if worker.process.is_alive():
                        continue
                    running.remove(worker)
                    error, code = folder / name / ERROR_FILE, worker.process.exitcode
                    if error.is_file():
                        failures[name] = error.read_text().splitlines()[0]
                    elif code:
                        failures[name] = f"its process ended with code {code}"
                advance(int(100 * sum(shares.values())), 100 * len(shares))
        finally:
            for worker in running:
                worker.process.terminate()
            for worker in running:
                worker.process.join(STOP_TIMEOUT_S)
                worker.process.kill()
                worker.process.join()
    return failures


def _begin(job: Job, folder: Path) -> _Worker:
    spawn = multiprocessing.get_context("spawn")
    share = spawn.Value("d", 0.0)
    args = (job, folder, share, os.getpid())
    process = spawn.Process(target=_work, args=args, name=job.name, daemon=True)
    process.start()
    return _Worker(job, process, share)


def _work(job: Job, folder: Path, share: Any, parent: int) -> None:
    """Run a job in this process; its error goes to ERROR_FILE."""
    error_file = folder / job.name / ERROR_FILE
    error_file.unlink(missing_ok=True)
    signals: list[int] = []
    for stopping in (signal.SIGINT, signal.SIGTERM):
        signal.signal(stopping, lambda number, frame: signals.append(number))

    def on_progress(done: float) -> None:
        share.value = done
        if signals or os.getppid() != parent:
            raise KeyboardInterrupt

    try:
        job.run(folder, on_progress)
        share.value = 1.0
    except KeyboardInterrupt:  # the run says so
        return
    except Exception as error:
        first = (str(error).strip().splitlines() or [""])[0]
        write_text(error_file, f"{type(error).__name__}: {first}\n\n{traceback.format_exc()}")
