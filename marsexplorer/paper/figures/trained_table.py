"""The table of trained policies on held-out terrains: a row for each algorithm, variant and level, means over seeds."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from marsexplorer.evaluation.intervals import t_interval
from marsexplorer.files import to_cell, write_whole
from marsexplorer.paper.figures.curves import NAMES, TITLES, Record, count_text, grouped

MEASURES = ("score", "coverage", "completion", "steps", "ratio")


@dataclass(frozen=True)
class Mean:
    """A mean over seeds with its 95 % t interval; low and high are None for a single seed."""

    mean: float
    low: float | None
    high: float | None

    @classmethod
    def of(cls, values: Sequence[float]) -> Mean:
        """Return the mean of at least one value."""
        array = np.array(values, np.float64)
        if len(array) < 2:
            return cls(float(array.mean()), None, None)
        low, high = t_interval(array)
        return cls(float(array.mean()), float(low), float(high))

    def text(self, digits: int, unit: str = "") -> str:
        """Return it with half of its interval, such as `0.912 ± 0.020`."""
        if self.high is None:
            return f"{self.mean:.{digits}f}{unit}"
        return f"{self.mean:.{digits}f} ± {self.high - self.mean:.{digits}f}{unit}"


@dataclass(frozen=True)
class Row:
    """The policies of all seeds of one algorithm, variant and level, on terrains kept for evaluation.

    moves, cpu_minutes  of the training and measurement of one seed, means
    score               normalized; coverage and completion are shares, 0..1
    steps               to 99 %, an unfinished episode counting `max_steps`
    ratio               of those to the better frontier rule's on the same terrains
    """

    algorithm: str
    variant: str
    level: str
    size: int
    seeds: int
    moves: float
    cpu_minutes: float
    terrains: int
    score: Mean
    coverage: Mean
    completion: Mean
    steps: Mean
    ratio: Mean


def rows_of(records: Sequence[Record]) -> list[Row]:
    """Return the rows, by variant in the order of TITLES, the others after them by name, then algorithm, then level."""
    rank = {variant: place for place, variant in enumerate(TITLES)}
    by_variant = sorted(
        grouped(records).items(),
        key=lambda each: (rank.get(each[0][1], len(rank)), each[0][1], *each[0]),
    )
    return [_row(group) for _, group in by_variant]


def _row(group: Sequence[Record]) -> Row:
    trial, results = group[0].trial, [record.result for record in group]
    means = {
        name: Mean.of([result[name] for result in results]) for name in MEASURES if name != "ratio"
    }
    ratio = Mean.of([result["steps"] / result["best_rule_steps"] for result in results])
    return Row(
        trial.algorithm,
        trial.variant,
        trial.level,
        trial.size,
        len(group),
        float(np.mean([result["moves"] for result in results])),
        float(np.mean([result["cpu_s"] for result in results])) / 60,
        trial.terrains,
        **means,
        ratio=ratio,
    )


TABLE_COLUMNS = (
    "algorithm",
    "variant",
    "level",
    "seeds",
    "moves",
    "CPU min",
    "score",
    "coverage",
    "completion",
    "steps",
    "to rule",
)


def cells_of(row: Row) -> list[str]:
    """Return a row as text, under TABLE_COLUMNS."""
    shares = [_percent(each) for each in (row.coverage, row.completion)]
    begun = [
        NAMES.get(row.algorithm, row.algorithm),
        row.variant,
        row.level,
        str(row.seeds),
        count_text(row.moves),
    ]
    return [
        *begun,
        f"{row.cpu_minutes:.1f}",
        row.score.text(3),
        *shares,
        row.steps.text(0),
        row.ratio.text(2),
    ]


def _percent(share: Mean) -> str:
    low, high = (None if end is None else 100 * end for end in (share.low, share.high))
    return Mean(100 * share.mean, low, high).text(0, " %")


def write_table(rows: Sequence[Row], path: Path) -> list[Path]:
    """Write `path`.csv and `path`.jsonl and return them; intervals stand in columns of their own, empty for one seed."""
    flat = [_flat(row) for row in rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(flat[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: to_cell(value) for name, value in row.items()} for row in flat)
    lines = "".join(json.dumps(line) + "\n" for line in flat)
    paths = []
    for suffix, content in ((".csv", text.getvalue()), (".jsonl", lines)):
        paths.append(path.with_suffix(suffix))
        with write_whole(paths[-1]) as file:
            file.write(content.encode())
    return paths


def _flat(row: Row) -> dict[str, str | float | None]:
    """Return a row with each mean in three columns: NAME, NAME_low, NAME_high."""
    flat: dict[str, str | float | None] = {}
    for name, value in asdict(row).items():
        if isinstance(value, dict):
            flat |= {name: round(value["mean"], 5)}
            flat |= {
                f"{name}_{end}": None if value[end] is None else round(value[end], 5)
                for end in ("low", "high")
            }
        else:
            flat[name] = round(value, 3) if isinstance(value, float) else value
    return flat
