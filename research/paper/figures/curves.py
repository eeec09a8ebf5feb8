"""Learning curves: read from the logs of trials, thinned, averaged over seeds.

Everything that is drawn and tabulated goes through `Record`, which has a curve of at most POINTS
points. The export has the same records, so that figures and tables from it are those from the logs.

Seeds are averaged on a common grid of GRID points between the latest first point and the earliest
last point of the seeds; each seed's curve is interpolated linearly between its own points, and none
is extrapolated. Over moves the grid is even in the logarithm, because the algorithms' moves differ
thirtyfold at equal CPU time; over CPU seconds it is even. The band is the 95 % t interval of the
mean over seeds.

A curve begins where EPISODES_PER_LINE episodes have ended: before, the mean is of those episodes
that happened to be short. The curve of a trial that never got so far is kept whole.

The export is small JSON Lines, with lines of two kinds:

    settings  "id"; "settings" and "versions" as they were logged, once for all trials that share
              them
    trial     "trial" (the fields of the Trial), "settings" (an id), "curve" (columns of at most
              POINTS points), "result"
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from marsexplorer.files import to_cell
from marsexplorer.intervals import Floats, t_interval
from research.paper.jobs import Line, read_lines, write_lines, write_text
from research.paper.tables import Estimate
from research.paper.trial import ENDINGS, EPISODES_PER_LINE, Trial, names_processor

POINTS = 50
GRID = 100
COLUMNS = ("moves", "cpu_s", "score", "coverage", *ENDINGS)
"""Of a thinned curve."""
DIGITS = {"moves": 0, "cpu_s": 1}
"""Decimals that are kept; OTHER_DIGITS of the other columns, which are shares."""
OTHER_DIGITS = 4

NAMES = {"ppo": "PPO", "a2c": "A2C", "rainbow": "Rainbow", "sac": "SAC"}
TITLES = {"paper": "the letter of the paper", "works": "as it works", "tuned": "tuned"}
"""Variant -> the title of its column."""
BAND_ALPHA = 0.18

SEEDS = 3
"""Fewest seeds that an interval is drawn of and a verdict given on."""

Kind = tuple[str, str, str, int, int]
"""(algorithm, variant, level, size, moves) of trials, whose seeds are averaged."""


@dataclass(frozen=True)
class Record:
    """A finished trial, JSON-ready.

    trial     the fields of the Trial
    settings  and versions: as logged, the hardware among the versions
    curve     COLUMNS -> numbers, all of one length, at most POINTS; None where no episode had ended
              yet
    result    on held-out terrains, as logged
    """

    trial: Trial
    settings: dict[str, Any]
    versions: dict[str, Any]
    curve: dict[str, list[float | None]]
    result: dict[str, Any]

    @property
    def kind(self) -> Kind:
        """The kind of its trial."""
        trial = self.trial
        return trial.algorithm, trial.variant, trial.level, trial.size, trial.moves


def read_records(folder: Path) -> list[Record]:
    """The finished trials whose folders are in `folder`, by name."""
    logs = (read_lines(path) for path in sorted(folder.glob("*/log.jsonl")))
    return [record_of(lines) for lines in logs if lines and lines[-1]["kind"] == "result"]


def record_of(lines: Sequence[Line]) -> Record:
    """The record of a finished trial from the lines of its log.

    The curve keeps its first full and its last line.
    """
    head, *curve, result = lines
    curve = [line for line in curve if line["episodes"] >= EPISODES_PER_LINE] or curve
    places = np.linspace(0, len(curve) - 1, min(POINTS, len(curve))).round()
    points = [curve[number] for number in dict.fromkeys(places.astype(int))]
    columns = {name: [_rounded(name, point.get(name)) for point in points] for name in COLUMNS}
    result = {name: content for name, content in result.items() if name != "kind"}
    versions = head["versions"] | {"hardware": head["hardware"]}
    return Record(Trial(**head["trial"]), head["settings"], versions, columns, result)


def _rounded(name: str, number: float | None) -> float | None:
    if number is None:
        return None
    digits = DIGITS.get(name, OTHER_DIGITS)
    return round(number, digits) if digits else int(number)


@dataclass(frozen=True)
class Band:
    """A mean over seeds on a grid, float64[GRID]; low and high None for one seed."""

    x: Floats
    mean: Floats
    low: Floats | None
    high: Floats | None
    seeds: int


def band(records: Sequence[Record], column: str, against: str) -> Band | None:
    """The mean of a column over seeds against "moves" or "cpu_s".

    None if no seed has two points.
    """
    curves = (points_of(record, column, against) for record in records)
    seeds = [points for points in curves if len(points[0]) >= 2]
    if not seeds:
        return None
    first, last = max(x[0] for x, _ in seeds), min(x[-1] for x, _ in seeds)
    if first >= last:
        return None
    grid = np.geomspace(first, last, GRID) if against == "moves" else np.linspace(first, last, GRID)
    values = np.stack([np.interp(grid, x, y) for x, y in seeds], -1)
    low, high = t_interval(values) if len(seeds) > 1 else (None, None)
    return Band(grid, values.mean(-1), low, high, len(seeds))


def points_of(record: Record, column: str, against: str) -> tuple[Floats, Floats]:
    """(x, y) of a curve's column against "moves" or "cpu_s" where known.

    float64[points] each
    """
    x, y = (np.array(record.curve[name], np.float64) for name in (against, column))
    is_known = ~np.isnan(x + y)  # None became NaN
    return x[is_known], y[is_known]


def is_timed(record: Record) -> bool:
    """Whether a training's CPU time is known: on one kind of machine, without a GPU.

    Times of different trainings can be compared where they are `is_timed_alike`.
    """
    return record.curve["cpu_s"][-1] is not None


def is_timed_alike(records: Sequence[Record]) -> bool:
    """Whether CPU times can be compared: all known, and of one logged processor."""
    machines = {record.versions.get("hardware") for record in records}
    return (
        all(map(is_timed, records)) and len(machines) == 1 and all(map(names_processor, machines))
    )


def chosen(records: Iterable[Record], **wanted: Any) -> list[Record]:
    """The records of the trials with these values (algorithm, variant, level, ...)."""
    return [record for record in records if wanted.items() <= vars(record.trial).items()]


def longest(records: Iterable[Record]) -> list[Record]:
    """The longest of some trials by seed.

    Of lengths with SEEDS seeds if there are, else of any.
    """
    lengths: dict[int, list[Record]] = {}
    for record in sorted(records, key=lambda record: record.trial.seed):
        lengths.setdefault(record.trial.moves, []).append(record)
    enough = {moves: trials for moves, trials in lengths.items() if len(trials) >= SEEDS} or lengths
    return enough[max(enough)] if enough else []


def grouped(records: Iterable[Record]) -> dict[Kind, list[Record]]:
    """The records by kind, each list by seed."""
    groups: dict[Kind, list[Record]] = {}
    for record in sorted(records, key=lambda record: record.trial.seed):
        groups.setdefault(record.kind, []).append(record)
    return groups


def draw_curves(
    axes: Axes, records: Sequence[Record], column: str, against: str, unit: float = 1, **style: Any
) -> None:
    """Draw the trials of one kind: mean, interval, and points of other seeds.

    Points are of longer trainings, or of fewer seeds than SEEDS.

    unit  what one on the x axis stands for
    """
    main = longest(records)
    mean_band = band(main, column, against) if len(main) >= SEEDS else None
    if mean_band is not None and mean_band.low is not None and mean_band.high is not None:
        axes.plot(mean_band.x / unit, mean_band.mean, **style)
        surface = {"color": style["color"], "alpha": BAND_ALPHA, "linewidth": 0}
        axes.fill_between(mean_band.x / unit, mean_band.low, mean_band.high, **surface)
    for record in records:
        if mean_band is None or record.trial.moves > main[0].trial.moves:
            x, y = points_of(record, column, against)
            axes.plot(x / unit, y, ".", color=style["color"], markersize=2.5)


def set_moves_axis(axes: Axes) -> None:
    """Make the x axis logarithmic in moves, with labels such as `10 k` and `1 M`."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(10))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda moves, _: count_text(moves)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(which="minor", length=0)


def count_text(count: float) -> str:
    """A number of moves in short, such as `240 k` or `5 M`."""
    for size, letter in ((1e6, " M"), (1e3, " k")):
        if count >= size:
            return f"{count / size:.3g}{letter}"
    return f"{count:.0f}"


def write_records(records: Sequence[Record], path: Path) -> Path:
    """Write records to a file, settings before their first trial; return its path."""
    lines: list[Line] = []
    ids: dict[str, int] = {}
    for record in records:
        common = {"settings": record.settings, "versions": record.versions}
        key = json.dumps(common, sort_keys=True)
        if key not in ids:
            ids[key] = len(ids)
            lines.append({"kind": "settings", "id": ids[key], **common})
        shared = {"settings": ids[key], "curve": record.curve, "result": record.result}
        lines.append({"kind": "trial", "trial": vars(record.trial), **shared})
    return write_lines(path, lines)


def add_records(records: Sequence[Record], path: Path) -> Path:
    """Write records to a file beside those that it has; return its path.

    New trials of a kind replace all of that kind in the file, so that no mean is taken over
    trainings of two runs. ValueError if the file was not written by `write_records`.
    """
    new = {record.kind for record in records}
    others = [record for record in read_exported(path) if record.kind not in new]
    every = grouped([*others, *records])
    return write_records(
        [record for kind in sorted(every, key=_rank) for record in every[kind]], path
    )


def _rank(kind: Kind) -> tuple[Any, ...]:
    """The sorting key of kinds: figure 4's columns in their order, then by name."""
    algorithm, variant, *place_of_kind = kind
    columns = list(TITLES)
    place = columns.index(variant) if variant in columns else len(columns)
    return place, variant, algorithm, *place_of_kind


def read_exported(path: Path) -> list[Record]:
    """The records of a file that `write_records` wrote, none if there is no file.

    ValueError if it is another's.
    """
    records, settings = [], {}
    try:
        for line in read_lines(path):
            if line["kind"] == "settings":
                settings[line["id"]] = line["settings"], line["versions"]
            else:
                trial, common = Trial(**line["trial"]), settings[line["settings"]]
                records.append(Record(trial, *common, line["curve"], line["result"]))
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is no file of trials that --export wrote") from error
    return records


@dataclass(frozen=True)
class Row:
    """One algorithm, variant and level: the policies of all seeds, held-out terrains.

    moves, cpu_minutes  of the training and measurement of one seed, means; NaN minutes beside an
                        accelerator
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
    score: Estimate
    coverage: Estimate
    completion: Estimate
    steps: Estimate
    ratio: Estimate


def rows_of(records: Sequence[Record]) -> list[Row]:
    """The rows by variant in the order of TITLES, then algorithm, then level.

    Other variants come after, by name.
    """
    groups = grouped(records)
    return [_row(groups[kind]) for kind in sorted(groups, key=_rank)]


def _row(group: Sequence[Record]) -> Row:
    def column(name: str) -> Floats:
        return np.array([record.result[name] for record in group], np.float64)  # NaN for None

    measured = (column(name) for name in ("score", "coverage", "completion", "steps"))
    moves, minutes = (float(column(name).mean()) for name in ("moves", "cpu_s"))
    ratio = np.divide(column("steps"), column("best_rule_steps"))
    trial, means = group[0].trial, (Estimate.of(values) for values in (*measured, ratio))
    return Row(*group[0].kind[:4], len(group), moves, minutes / 60, trial.terrains, *means)


TABLE_COLUMNS = (
    *("algorithm", "variant", "level", "seeds", "moves", "CPU min", "terrains"),
    *("score", "coverage", "completion", "steps", "to rule"),
)


def cells_of(row: Row) -> list[str]:
    """A row as text, under TABLE_COLUMNS."""
    name = NAMES.get(row.algorithm, row.algorithm)
    spent = "" if isnan(row.cpu_minutes) else f"{row.cpu_minutes:.1f}"
    shares = row.coverage.percent(), row.completion.percent()
    return [
        *(name, row.variant, row.level, str(row.seeds), count_text(row.moves), spent),
        str(row.terrains),
        *(row.score.text(3), *shares, row.steps.text(0), row.ratio.text(2)),
    ]


def write_table(rows: Sequence[Row], path: Path) -> list[Path]:
    """Write `path`.csv and `path`.jsonl and return them.

    Intervals have columns of their own, empty for one seed.
    """
    flat = [_flat(row) for row in rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(flat[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: to_cell(cell) for name, cell in row.items()} for row in flat)
    return [
        write_text(path.with_suffix(".csv"), text.getvalue()),
        write_lines(path.with_suffix(".jsonl"), flat),
    ]


def _flat(row: Row) -> Line:
    """A row with each mean in three columns: NAME, NAME_low, NAME_high."""
    flat: Line = {}
    for name, cell in vars(row).items():
        if isinstance(cell, Estimate):
            names = (name, f"{name}_low", f"{name}_high")
            numbers = (None if isnan(number) else round(number, 5) for number in astuple(cell))
            flat |= zip(names, numbers, strict=True)
        else:
            flat[name] = round(cell, 3) if isinstance(cell, float) else cell
    flat["cpu_minutes"] = None if isnan(row.cpu_minutes) else flat["cpu_minutes"]
    return flat
