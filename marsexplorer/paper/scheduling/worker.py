"""One job in a process of its own: it reports to the process that began it, and stops softly when that one says so or dies."""

from __future__ import annotations

import threading
import time
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.reduction import DupFd
from pathlib import Path
from typing import Any

from marsexplorer.files import write_whole
from marsexplorer.paper.job import Job

REPORT_INTERVAL_S = 0.25
"""Seconds between two reports of how far the job has come."""

ERROR_FILE = "error.txt"
"""In the folder of a job that failed: where it failed."""
STOP = "stop"
"""What the other process sends to stop the job."""


@dataclass(frozen=True)
class Report:
    """What a worker tells.

    kind   "progress", and last "done", "stopped" or "failed"
    share  of the job that is done, 0..1
    cpu_s  CPU seconds of this process
    error  one sentence where it failed
    """

    kind: str
    share: float
    cpu_s: float
    error: str = ""


def work(job: Job, folder: Path, connection: Connection, lock: Inherited) -> None:
    """Run a job and report over the connection.

    lock   of the folder of the run; it is never closed here, so it is held until this process has ended
    """
    del lock
    run_reporting(job, folder, _Line(connection))


@dataclass(frozen=True)
class Inherited:
    """An open file's descriptor that a process has from the one that spawned it."""

    descriptor: int

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how it is made there, where it may have another number."""
        return _inherit, (DupFd(self.descriptor),)


def _inherit(duplicate: Any) -> Inherited:
    return Inherited(duplicate.detach())


class _Line:
    """The connection to the other process: what is sent to it, and whether it wants the job to stop."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._stop = connection, threading.Event()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        try:
            self._connection.recv()
        except (EOFError, OSError):  # the other process is gone
            pass
        finally:
            self._stop.set()

    def send(self, report: Report) -> bool:
        """Send a report; return whether the job should stop."""
        try:
            self._connection.send(report)
        except OSError:
            self._stop.set()
        return self._stop.is_set()


def run_reporting(job: Job, folder: Path, line: Any) -> None:
    """Run a job and send reports; stop it, by KeyboardInterrupt out of its own call of `on_progress`, when `send` says so.

    line   has `send(report)`, which returns whether the job should stop
    """
    share, sent = 0.0, 0.0

    def on_progress(now: float) -> None:
        nonlocal share, sent
        share = now
        if time.monotonic() - sent < REPORT_INTERVAL_S:
            return
        sent = time.monotonic()
        if line.send(Report("progress", share, time.process_time())):
            raise KeyboardInterrupt

    (folder / job.name / ERROR_FILE).unlink(missing_ok=True)
    try:
        job.run(folder, on_progress)
        line.send(Report("done", 1.0, time.process_time()))
    except KeyboardInterrupt:
        line.send(Report("stopped", share, time.process_time()))
    except Exception as error:
        _keep_traceback(folder / job.name)
        line.send(Report("failed", share, time.process_time(), _sentence(error)))


def _sentence(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


def _keep_traceback(folder: Path) -> None:
    """Write where the job failed, if the disk lets it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with write_whole(folder / ERROR_FILE) as file:
            file.write(traceback.format_exc().encode())
    except OSError:
        return
