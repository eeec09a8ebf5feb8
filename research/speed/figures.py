"""One measured number, and all of a run as JSON."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable
from dataclasses import asdict, dataclass

from marsexplorer.config import CORE_VERSION


@dataclass(frozen=True)
class Figure:
    """One number as it was measured.

    group   core, gymnasium, threads, memory, start or peers
    name    what was measured; `at` the size of the terrain where there are several
    value   in `unit`; None when it could not be measured, and `note` says why
    target  what it should reach: at least that, or at most when `at_most`
    """

    group: str
    name: str
    value: float | None
    unit: str
    at: str = ""
    target: float | None = None
    at_most: bool = False
    note: str = ""

    @property
    def verdict(self) -> str:
        """Return `reached`, `missed`, or nothing where there is no target or no value."""
        if self.target is None or self.value is None:
            return ""
        is_reached = self.value <= self.target if self.at_most else self.value >= self.target
        return "reached" if is_reached else "missed"


def to_json(figures: Iterable[Figure]) -> str:
    """A run as JSON: versions, machine, load before it, figures with their verdicts."""
    document = {
        "core_version": CORE_VERSION,
        "machine": platform.machine(),
        "python": platform.python_version(),
        "processors": os.cpu_count(),
        "figures": [{**asdict(figure), "verdict": figure.verdict} for figure in figures],
    }
    return json.dumps(document, indent=1)
