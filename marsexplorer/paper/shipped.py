"""The results that are shipped, as they stand in `data/paper/*.jsonl`: one JSON object a line, told apart by its `kind`.

Lines of the kinds "trial", "curve" and "result" are logs of trials (see `trial`), one after the other, or a "trial" has its
curve and result in it, as `export` writes them; a "check" is what `checks` found; figures 6 and 7 have kinds of their own.
"""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FOLDER = Path(__file__).resolve().parents[2] / "data" / "paper"
Line = dict[str, Any]


@dataclass(frozen=True)
class TrainedRun:
    """The log of one trial: its first line, its curve, and its result when it has ended."""

    head: Line
    curve: list[Line] = field(default_factory=list)
    result: list[Line] = field(default_factory=list)

    @property
    def trial(self) -> Line:
        """Algorithm, variant, level, size, seed, moves."""
        trial: Line = self.head["trial"]
        return trial

    def at(self, axis: str, limit: float) -> Line:
        """Return the last line of the curve whose `axis` (moves or cpu_s) is at most the limit; the first where none is."""
        return next((line for line in reversed(self.curve) if line[axis] <= limit), self.curve[0])


@dataclass(frozen=True)
class Results:
    """Everything that is shipped: runs, checks by claim, and all other lines by kind."""

    runs: list[TrainedRun]
    checks: dict[str, Line]
    lines: dict[str, list[Line]]

    def ended(self, **wanted: Any) -> list[TrainedRun]:
        """Return the ended runs whose trial has these values, by seed."""
        found = [
            run
            for run in self.runs
            if run.result and run.curve and all(run.trial[name] == value for name, value in wanted.items())
        ]
        return sorted(found, key=lambda run: int(run.trial["seed"]))

    def finals(self, name: str, **wanted: Any) -> NDArray[np.float64]:
        """Return a figure at the end of the curve for each seed: float64[seeds]."""
        return np.array([run.curve[-1][name] for run in self.ended(**wanted)], np.float64)


def read(folder: Path = FOLDER) -> Results:
    """Return what lies in the folder; ValueError, with the file and the line, where a line is none of ours."""
    runs: list[TrainedRun] = []
    checks: dict[str, Line] = {}
    lines: dict[str, list[Line]] = defaultdict(list)
    for path in sorted(folder.glob("*.jsonl")):
        for number, text in enumerate(path.read_text().splitlines(), 1):
            line = json.loads(text)
            kind = line.get("kind") if isinstance(line, dict) else None
            if not isinstance(kind, str):
                raise ValueError(f"{path}, line {number}: expected an object with a `kind`, got {text[:80]}")
            if kind == "check":
                checks[line["claim"]] = line
            elif kind == "trial":
                runs.append(_run_of(line))
            elif kind in ("curve", "result"):
                getattr(runs[-1], kind).append(line)
            else:
                lines[kind].append(line)
    return Results(runs, checks, dict(lines))


def _run_of(line: Line) -> TrainedRun:
    """Return the run that a line of kind "trial" begins: only begun in a log, whole where `export` wrote it."""
    if "curve" not in line:
        return TrainedRun(line)
    rows = zip(*line["curve"].values(), strict=True)
    return TrainedRun(line, [dict(zip(line["curve"], row, strict=True)) for row in rows], [line["result"]])
