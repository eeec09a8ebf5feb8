"""How long jobs will take: their own forecasts at first, corrected by what has been measured in this run."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from marsexplorer.paper.job import Job

PRIOR_CPU_S = 30.0
"""CPU seconds of a kind of job after which what was measured counts as much as the forecast."""

LONG_DONE = 1.0 - 1e-9


@dataclass
class Course:
    """How far a job has come.

    kind      of jobs that are right or wrong in their forecasts together
    forecast  CPU seconds of the whole job, as it says itself
    before    share of the job that was done before this run, 0..1; None until it is known
    share     share that is done, 0..1
    cpu_s     CPU seconds that this run has spent on it
    wall_s    seconds that a process of this run has spent on it
    is_ended  whether no process works on it any more and none will
    """

    kind: str
    forecast: float
    before: float | None = None
    share: float = 0.0
    cpu_s: float = 0.0
    wall_s: float = 0.0
    is_ended: bool = False

    @property
    def expected(self) -> float:
        """CPU seconds that this run should have spent so far, by the job's own forecast."""
        return self.forecast * max(0.0, self.share - (self.before or 0.0))


@dataclass
class Forecast:
    """What is known of the jobs of a run; `courses` are by the jobs' names, in the order in which they begin."""

    workers: int
    courses: dict[str, Course] = field(default_factory=dict)

    @classmethod
    def of(cls, jobs: Sequence[Job], folder: Path, workers: int) -> Forecast:
        """Return the forecast before anything has been done in this run; jobs that are done count as nothing."""
        courses = {}
        for job in jobs:
            is_done, is_begun = job.is_done(folder), (folder / job.name).exists()
            course = Course(
                _kind(job), job.forecast, before=1.0 if is_done else None if is_begun else 0.0
            )
            course.share, course.is_ended = float(is_done), is_done
            courses[job.name] = course
        return cls(workers, courses)

    def report(self, name: str, share: float, cpu_s: float, wall_s: float) -> None:
        """Take in how far a job has come: its share (0..1) and what this run has spent on it (seconds)."""
        course = self.courses[name]
        if course.before is None:
            course.before = share
        course.share, course.cpu_s, course.wall_s = share, cpu_s, wall_s

    def end(self, name: str, is_done: bool) -> None:
        """Take in that a job has ended, well or not."""
        course = self.courses[name]
        course.is_ended = True
        if is_done:
            course.share = 1.0

    @property
    def done(self) -> int:
        """Jobs that are done."""
        return sum(course.is_ended and course.share > LONG_DONE for course in self.courses.values())

    @property
    def cpu_spent(self) -> float:
        """CPU seconds of this run so far."""
        return sum(course.cpu_s for course in self.courses.values())

    @property
    def cpu_left(self) -> float:
        """CPU seconds to go, about."""
        return sum(self._left().values())

    @property
    def seconds_left(self) -> float:
        """Seconds to go, about: the jobs in their order on as many workers, each as slow as those measured here."""
        left = list(self._left().values())
        free = [0.0] * max(1, self.workers)
        for seconds in left:
            heapq.heapreplace(free, free[0] + seconds)
        return max(free) * self._slowness()

    def _left(self) -> dict[str, float]:
        """Return the CPU seconds to go of each job that has not ended."""
        open_courses = {
            name: course for name, course in self.courses.items() if not course.is_ended
        }
        overall = _ratio(self.courses.values(), 1.0)
        ratios = {}
        for kind in {course.kind for course in open_courses.values()}:
            ratios[kind] = _ratio(
                (course for course in self.courses.values() if course.kind == kind), overall
            )
        return {
            name: ratios[each.kind] * each.forecast * (1.0 - each.share)
            for name, each in open_courses.items()
        }

    def _slowness(self) -> float:
        """Return how many seconds a CPU second takes: more than one where other programs use the cores too."""
        cpu, wall = self.cpu_spent, sum(course.wall_s for course in self.courses.values())
        return max(1.0, (wall + PRIOR_CPU_S) / (cpu + PRIOR_CPU_S))


def _ratio(courses: Iterable[Course], otherwise: float) -> float:
    """Return measured over forecast CPU seconds; `otherwise` while little has been measured."""
    measured = expected = 0.0
    for course in courses:
        measured, expected = measured + course.cpu_s, expected + course.expected
    return (measured + PRIOR_CPU_S * otherwise) / (expected + PRIOR_CPU_S)


def _kind(job: Job) -> str:
    return f"{type(job).__name__} {getattr(job, 'algorithm', '')} {getattr(job, 'variant', '')}"


def duration(seconds: float) -> str:
    """Return a duration in words, such as `40 seconds`, `26 minutes` or `7.4 hours`."""
    if seconds < 90:
        count = max(1, round(seconds)) if seconds < 10 else 10 * max(1, round(seconds / 10))
        return f"{count} second{'s' if count != 1 else ''}"
    return f"{round(seconds / 60)} minutes" if seconds < 100 * 60 else f"{seconds / 3600:.1f} hours"
