"""The results that are shipped, in `data/paper/*.jsonl`, as the claims of the paper are decided from them.

environment.jsonl  what `checks` found
every other file   finished trials, see `export`
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marsexplorer.paper.curves import Record
from marsexplorer.paper.export import read_exported

FOLDER = Path(__file__).resolve().parents[2] / "data" / "paper"
CHECKS_FILE = "environment.jsonl"
Line = dict[str, Any]


@dataclass(frozen=True)
class Results:
    """Everything that is shipped.

    checks     claim -> the line of its check
    records    finished trials
    """

    checks: dict[str, Line] = field(default_factory=dict)
    records: list[Record] = field(default_factory=list)

    def trials(self, **wanted: Any) -> list[Record]:
        """Return the finished trials with these values (algorithm, variant, level, size), by seed."""
        found = [each for each in self.records if all(getattr(each.trial, name) == value for name, value in wanted.items())]
        return sorted(found, key=lambda record: record.trial.seed)

    def finals(self, name: str, **wanted: Any) -> NDArray[np.float64]:
        """Return a column of the curve at its end for each seed: float64[seeds]."""
        return np.array([record.curve[name][-1] for record in self.trials(**wanted)], np.float64)


def read(folder: Path = FOLDER) -> Results:
    """Return what lies in the folder, the shipped one by default; ValueError for a file that holds no such results."""
    results = Results()
    for path in sorted(folder.glob("*.jsonl")):
        if path.name == CHECKS_FILE:
            lines = (json.loads(text) for text in path.read_text().splitlines())
            results.checks.update({line["claim"]: line for line in lines})
        else:
            results.records.extend(read_exported(path))
    return results
