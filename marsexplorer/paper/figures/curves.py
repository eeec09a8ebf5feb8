"""Learning curves: read from the logs of trials, thinned, averaged over seeds.

Everything that is drawn and tabulated goes through `Record`, which has a curve of at most POINTS points. The export has the
same records, so that figures and tables from it are those from the logs.

Seeds are averaged on a common grid of GRID points between the latest first point and the earliest last point of the seeds; each
seed's curve is interpolated linearly between its own points, and none is extrapolated. Over moves the grid is even in the
logarithm, because the algorithms' moves differ thirtyfold at equal CPU time; over CPU seconds it is even. The band is the 95 %
t interval of the mean over seeds.

A curve begins where EPISODES_PER_LINE episodes have ended: before, the mean is of those episodes that happened to be short. The
curve of a trial that never got so far is kept whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from marsexplorer.evaluation.intervals import t_interval
from marsexplorer.paper.trial import ENDINGS, EPISODES_PER_LINE, Trial, read_log

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
