"""Learning curves: read from the logs of trials, thinned, averaged over seeds.

Everything that is drawn and tabulated goes through `Record`, which has a curve of at most POINTS points. The export has the
same records, so that figures and tables from it are those from the logs.

Seeds are averaged on a common grid of GRID points between the latest first point and the earliest last point of the seeds; each
seed's curve is interpolated linearly between its own points, and none is extrapolated. Over moves the grid is even in the
logarithm, because the algorithms' moves differ thirtyfold at equal CPU time; over CPU seconds it is even. The band is the 95 %
t interval of the mean over seeds.

A curve begins where EPISODES_PER_LINE episodes have ended: before, the mean is of those episodes that happened to be short. The
curve of a trial that never got so far is kept whole.

The export is small JSON Lines, with lines of two kinds:

    settings  "id"; "settings" and "versions" as they were logged, once for all trials that share them
    trial     "trial" (the fields of the Trial), "settings" (an id), "curve" (columns of at most POINTS points), "result"
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from marsexplorer.evaluation.intervals import t_interval
from marsexplorer.files import to_cell, write_whole
from research.paper.trial import ENDINGS, EPISODES_PER_LINE, Trial, read_log

POINTS = 50
GRID = 100
COLUMNS = ("moves", "cpu_s", "score", "coverage", *ENDINGS)
"""Of a thinned curve."""
DIGITS = {"moves": 0, "cpu_s": 1}
"""Decimals that are kept; OTHER_DIGITS of the other columns, which are shares."""
OTHER_DIGITS = 4

NAMES = {"ppo": "PPO", "a2c": "A2C", "rainbow": "Rainbow", "sac": "SAC"}
LINE_STYLES: dict[str, Any] = {"ppo": "-", "a2c": "--", "rainbow": "-.", "sac": (0, (1, 1.2))}
TITLES = {"paper": "the letter of the paper", "works": "as it works", "tuned": "tuned"}
"""Variant -> what its column is called."""
BAND_ALPHA = 0.18

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Record:
    """What is kept of a finished trial, JSON-ready.

    trial     the fields of the Trial
    settings  and versions: as logged
    curve     COLUMNS -> numbers, all of one length, at most POINTS; None where no episode had ended yet
    result    on held-out terrains, as logged
    """

    trial: Trial
    settings: dict[str, Any]
    versions: dict[str, Any]
    curve: dict[str, list[float | None]]
    result: dict[str, Any]

    @property
    def group(self) -> tuple[str, str, str, int]:
        """What seeds are averaged over: (algorithm, variant, level, size)."""
        trial = self.trial
        return trial.algorithm, trial.variant, trial.level, trial.size


def read_records(folder: Path) -> list[Record]:
    """Return the finished trials whose folders lie in `folder`, by name."""
    logs = (read_log(path) for path in sorted(folder.glob("*/log.jsonl")))
    return [
        record_of(lines)
        for lines in logs
        if lines and lines[0].get("kind") == "trial" and lines[-1]["kind"] == "result"
    ]


def record_of(lines: Sequence[dict[str, Any]]) -> Record:
    """Return the record of a finished trial from the lines of its log; the curve keeps its first full and its last line."""
    head, *curve, result = lines
    curve = [line for line in curve if line["episodes"] >= EPISODES_PER_LINE] or curve
    kept = sorted(
        {round(number) for number in np.linspace(0, len(curve) - 1, min(POINTS, len(curve)))}
    )
    columns = {
        name: [_rounded(name, curve[number].get(name)) for number in kept] for name in COLUMNS
    }
    result = {name: value for name, value in result.items() if name != "kind"}
    return Record(Trial(**head["trial"]), head["settings"], head["versions"], columns, result)


def _rounded(name: str, value: float | None) -> float | None:
    if value is None:
        return None
    digits = DIGITS.get(name, OTHER_DIGITS)
    return round(value, digits) if digits else int(value)


@dataclass(frozen=True)
class Band:
    """A mean over seeds on a grid; each array is float64[GRID]. low and high are None for a single seed."""

    x: Floats
    mean: Floats
    low: Floats | None
    high: Floats | None
    seeds: int


def band(records: Sequence[Record], column: str, against: str) -> Band | None:
    """Return the mean of a column over seeds against "moves" or "cpu_s"; None where no seed has two points."""
    seeds = [
        points for record in records if len((points := _points(record, column, against))[0]) >= 2
    ]
    if not seeds:
        return None
    first, last = max(x[0] for x, _ in seeds), min(x[-1] for x, _ in seeds)
    if first >= last:
        return None
    grid = np.geomspace(first, last, GRID) if against == "moves" else np.linspace(first, last, GRID)
    values = np.stack([np.interp(grid, x, y) for x, y in seeds], -1)
    low, high = t_interval(values) if len(seeds) > 1 else (None, None)
    return Band(grid, values.mean(-1), low, high, len(seeds))


def _points(record: Record, column: str, against: str) -> tuple[Floats, Floats]:
    pairs = zip(record.curve[against], record.curve[column], strict=True)
    known = [(x, y) for x, y in pairs if x is not None and y is not None]
    return np.array([x for x, _ in known], np.float64), np.array([y for _, y in known], np.float64)


def grouped(records: Iterable[Record]) -> dict[tuple[str, str, str, int], list[Record]]:
    """Return the records by what seeds are averaged over, each list by seed."""
    groups: dict[tuple[str, str, str, int], list[Record]] = {}
    for record in sorted(records, key=lambda each: each.trial.seed):
        groups.setdefault(record.group, []).append(record)
    return groups


def draw_band(axes: Axes, found: Band, unit: float = 1.0, **style: Any) -> None:
    """Draw a mean as a line and its interval as a surface; `unit` is what one on the x axis stands for."""
    axes.plot(found.x / unit, found.mean, linewidth=1.8, **style)
    if found.low is not None and found.high is not None:
        axes.fill_between(
            found.x / unit,
            found.low,
            found.high,
            color=style["color"],
            alpha=BAND_ALPHA,
            linewidth=0,
        )


def set_moves_axis(axes: Axes) -> None:
    """Make the x axis one of moves on a logarithmic scale, with labels such as `10 k` and `1 M`."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(10))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: count_text(value)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(which="minor", length=0)


def count_text(count: float) -> str:
    """Return a number of moves in short, such as `240 k` or `5 M`."""
    for size, letter in ((1e6, " M"), (1e3, " k")):
        if count >= size:
            return f"{count / size:.3g}{letter}"
    return f"{count:.0f}"


def write_records(records: Sequence[Record], path: Path) -> Path:
    """Write records to a file, the settings before the first trial that has them; return its path."""
    lines: list[dict[str, Any]] = []
    known: dict[str, int] = {}
    for record in records:
        common = {"settings": record.settings, "versions": record.versions}
        key = json.dumps(common, sort_keys=True)
        if key not in known:
            known[key] = len(known)
            lines.append({"kind": "settings", "id": known[key], **common})
        own = {
            "trial": vars(record.trial),
            "settings": known[key],
            "curve": record.curve,
            "result": record.result,
        }
        lines.append({"kind": "trial", **own})
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_whole(path) as file:
        file.write(
            "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines).encode()
        )
    return path


def add_records(records: Sequence[Record], path: Path) -> Path:
    """Write records to a file beside those that it has; return its path.

    A kind of trial is an algorithm, variant, level and size. All trials of a kind in the file make way for new ones of that
    kind, so that no mean is taken over trainings of two runs. ValueError when the file was not written by `write_records`.
    """
    new = {_kind_of(record.trial) for record in records}
    old = read_exported(path) if path.is_file() else []
    kept = [record for record in old if _kind_of(record.trial) not in new]
    return write_records(
        sorted([*kept, *records], key=lambda record: (_place_of(record.trial), record.trial.seed)),
        path,
    )


def _kind_of(trial: Trial) -> tuple[str, str, str, int]:
    return trial.variant, trial.algorithm, trial.level, trial.size


def _place_of(trial: Trial) -> tuple[int, tuple[str, str, str, int]]:
    """Return what kinds are sorted by: the columns of figure 4 first, in their order, then the others by name."""
    columns = list(TITLES)
    return columns.index(trial.variant) if trial.variant in columns else len(columns), _kind_of(
        trial
    )


def read_exported(path: Path) -> list[Record]:
    """Return the records of a file that `write_records` wrote; ValueError when it is none."""
    records, settings = [], {}
    try:
        for text in path.read_text().splitlines():
            line = json.loads(text)
            if line["kind"] == "settings":
                settings[line["id"]] = line
            else:
                common = settings[line["settings"]]
                trial = Trial(**line["trial"])
                records.append(
                    Record(
                        trial, common["settings"], common["versions"], line["curve"], line["result"]
                    )
                )
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is no file of trials that --export wrote") from error
    return records


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
