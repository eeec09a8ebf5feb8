"""Jobs on a Ray cluster, each on one core, in a folder that all machines of the cluster see."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from marsexplorer.evaluation.cluster import session
from marsexplorer.paper.job import Job
from marsexplorer.paper.scheduling.forecast import Forecast
from marsexplorer.paper.scheduling.schedule import LOOK_INTERVAL_S, STOP_PATIENCE_S, Failure
from marsexplorer.paper.scheduling.worker import Report, run_reporting

RETRIES = 2
"""Times that Ray begins a job again whose machine or process is lost."""


class Board:
    """What the jobs report, in a process of the cluster."""

    def __init__(self) -> None:
        self._reports: dict[str, Report] = {}
        self._is_stopped = False

    def put(self, name: str, report: Report) -> bool:
        """Keep a job's newest report; return whether the jobs should stop."""
        self._reports[name] = report
        return self._is_stopped

    def take(self) -> dict[str, Report]:
        """Return the newest reports since the last call, by the jobs' names."""
        reports, self._reports = self._reports, {}
        return reports

    def stop(self) -> None:
        """Have every job stop at its next report."""
        self._is_stopped = True


class _Line:
    """Sends a job's reports to the board, and keeps the last."""

    def __init__(self, ray: Any, board: Any, name: str) -> None:
        self._ray, self._board, self._name = ray, board, name
        self.last: Report | None = None

    def send(self, report: Report) -> bool:
        """Send a report; return whether the job should stop."""
        self.last = report
        return bool(self._ray.get(self._board.put.remote(self._name, report)))


def _run_remotely(job: Job, folder: str, board: Any) -> Report | None:
    """Run a job on a machine of the cluster and return its last report."""
    with session("auto") as ray:
        line = _Line(ray, board, job.name)
        run_reporting(job, Path(folder), line)
    return line.last


def run_on_ray(
    jobs: Sequence[Job],
    folder: Path,
    address: str,
    on_change: Callable[[Forecast], None] | None = None,
) -> list[Failure]:
    """Run what is not done in `folder` on the cluster at `address` and return the jobs that failed.

    ClusterError when Ray is missing or the cluster cannot be reached; KeyboardInterrupt once the jobs have saved and ended.
    """
    with session(address) as ray:
        forecast = Forecast.of(jobs, folder, int(ray.cluster_resources().get("CPU", 1)))
        board = ray.remote(num_cpus=0)(Board).remote()
        task = ray.remote(num_cpus=1, max_retries=RETRIES)(_run_remotely)
        waiting = [job for job in jobs if not forecast.courses[job.name].is_ended]
        pending = {task.remote(job, str(folder.resolve()), board): job.name for job in waiting}
        run = _Run(ray, board, forecast, pending)
        try:
            while run.pending:
                run.look(LOOK_INTERVAL_S)
                (on_change or (lambda each: None))(forecast)
        except KeyboardInterrupt:
            run.stop()
            raise
        return run.failures


class _Run:
    """The jobs that are under way. pending: Ray's reference of each -> its name."""

    def __init__(self, ray: Any, board: Any, forecast: Forecast, pending: dict[Any, str]) -> None:
        self._ray, self._board, self._forecast, self.pending = ray, board, forecast, pending
        self._begun: dict[str, float] = {}
        self.failures: list[Failure] = []

    def look(self, seconds: float) -> None:
        """Take in what has been reported; wait for an end for up to some seconds."""
        ready, _ = self._ray.wait(list(self.pending), timeout=seconds)
        for name, report in self._ray.get(self._board.take.remote()).items():
            begun = self._begun.setdefault(name, time.monotonic() - report.cpu_s)
            self._forecast.report(name, report.share, report.cpu_s, time.monotonic() - begun)
        for reference in ready:
            self._take_end(self.pending.pop(reference), reference)

    def _take_end(self, name: str, reference: Any) -> None:
        try:
            last = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            lines = str(error).strip().splitlines()
            last = Report("failed", 0.0, 0.0, lines[-1] if lines else type(error).__name__)
        self._forecast.end(name, is_done=last.kind == "done")
        if last.kind == "failed":
            self.failures.append(Failure(name, last.error))

    def stop(self) -> None:
        """Have the jobs save and end; those that take too long are left to Ray, which ends them with the connection."""
        self._ray.get(self._board.stop.remote())
        deadline = time.monotonic() + STOP_PATIENCE_S
        begun = [reference for reference, name in self.pending.items() if name in self._begun]
        for reference in self.pending.keys() - set(begun):
            self._ray.cancel(reference)
        if begun:
            self._ray.wait(begun, num_returns=len(begun), timeout=deadline - time.monotonic())
