"""The results that are shipped, in `data/paper/*.jsonl`, as the claims of the paper are decided from them.

environment.jsonl               what `checks` found
figure5-*.jsonl                 how hard the levels are, see `difficulty`
figure6-*.jsonl, figure7-*.jsonl  episodes of policies and walks of the null, see `visits`, `null` and `scale`
every other file                finished trials, see `export`
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from marsexplorer.paper.episodes.play import Line, read_lines
from marsexplorer.paper.figures.curves import Record
from marsexplorer.paper.figures.export import read_exported

FOLDER = Path(__file__).resolve().parents[3] / "data" / "paper"
CHECKS_FILE = "environment.jsonl"


@dataclass(frozen=True)
class Results:
    """Everything that is shipped.

    checks     claim -> the line of its check
    records    finished trials
    plays      figure (5, 6 or 7) -> results of policies
    walks      results of the walks of figure 6 that nobody trained
    """

    checks: dict[str, Line] = field(default_factory=dict)
    records: list[Record] = field(default_factory=list)
    plays: dict[int, list[Line]] = field(default_factory=lambda: {5: [], 6: [], 7: []})
    walks: list[Line] = field(default_factory=list)

    def trials(self, **wanted: Any) -> list[Record]:
        """Return the longest finished trials with these values (algorithm, variant, level, size), by seed."""
        found = [
            each
            for each in self.records
            if all(getattr(each.trial, name) == value for name, value in wanted.items())
        ]
        longest = max((record.trial.moves for record in found), default=0)
        return sorted(
            (each for each in found if each.trial.moves == longest),
            key=lambda record: record.trial.seed,
        )


def read(folder: Path = FOLDER) -> Results:
    """Return what lies in the folder, the shipped one by default; ValueError for a file that holds no such results."""
    results = Results()
    for path in sorted(folder.glob("*.jsonl")):
        if path.name == CHECKS_FILE:
            results.checks.update({line["claim"]: line for line in read_lines(path)})
        elif path.name.startswith(("figure5-", "figure6-", "figure7-")):
            for line in read_lines(path):
                kept = results.plays[line["figure"]] if "policy" in line else results.walks
                kept.append(line)
        else:
            results.records.extend(read_exported(path))
    return results
