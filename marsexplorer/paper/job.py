"""A job: the unit of work of `marsexplorer paper`, which a process or a machine of a cluster does alone on one core."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

OnProgress = Callable[[float], None]
"""Called with the share of a job that is done, 0..1."""


class Job(Protocol):
    """One training or one evaluation: picklable, resumable, with files of its own.

    A job writes under `folder / name` alone, and each of its files appears whole. `run` may be stopped at any moment, by
    KeyboardInterrupt or by a kill; run again it goes on, to the same result as if it had not been stopped.
    """

    @property
    def name(self) -> str:
        """Return the name of its folder, unlike any other job's; it tells what the job is of."""

    @property
    def forecast(self) -> float:
        """Return about how many CPU seconds the whole job takes."""

    def is_done(self, folder: Path) -> bool:
        """Return whether the whole result lies under `folder / name`."""

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        """Do what is left of the job."""
