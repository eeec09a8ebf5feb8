"""Figure 4 of Koutras et al. 2021: learning curves of the four algorithms, with what a score alone does not tell.

Two pictures have the same panels, one over moves and one over CPU seconds: score, coverage and completion as they were in
training, a column for each variant. A third shows how episodes ended.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from marsexplorer.paper.curves import (
    COLOURS,
    LINE_STYLES,
    NAMES,
    TITLES,
    Band,
    Record,
    band,
    draw_band,
    grouped,
    save_figure,
    set_moves_axis,
)

ROWS = {"score": "normalized score", "coverage": "coverage", "explored": "completion"}
AXES = {"moves": "moves (logarithmic)", "cpu_s": "CPU minutes"}
ENDING_NAMES = {
    "explored": "explored (99 %)",
    "timed_out": "out of time",
    "collided": "drove into an obstacle",
    "out_of_bounds": "drove off the grid",
}
ENDING_COLOURS = {"explored": "#44AA99", "timed_out": "#DDDDDD", "collided": "#CC6677", "out_of_bounds": "#DDCC77"}
"""Not those of the algorithms (Tol's muted scheme)."""
MAX_COLUMNS = 2
HUMAN_COLOUR = "#444444"


@dataclass(frozen=True)
class HumanLevel:
    """The mean normalized score of the people of a closed study, with its interval where there is one."""

    study: str
    players: int
    mean: float
    low: float | None
    high: float | None


def shown_variants(records: Sequence[Record]) -> list[str]:
    """Return the variants that have a column: "paper" and "works" where they are, otherwise the first two by name."""
    found = {record.trial.variant for record in records}
    return ([name for name in TITLES if name in found] or sorted(found))[:MAX_COLUMNS]


def draw(records: Sequence[Record], folder: Path, human: HumanLevel | None = None) -> list[Path]:
    """Draw figure4-moves.png, figure4-cpu.png and figure4-endings.png into a folder and return their paths."""
    pictures = {
        "figure4-moves": curves_figure(records, "moves", human),
        "figure4-cpu": curves_figure(records, "cpu_s", human),
        "figure4-endings": endings_figure(records),
    }
    return [save_figure(figure, folder / f"{name}.png") for name, figure in pictures.items()]


def curves_figure(records: Sequence[Record], against: str, human: HumanLevel | None = None) -> Figure:
    """Plot score, coverage and completion in training against "moves" or "cpu_s", a column for each variant."""
    variants, groups = shown_variants(records), grouped(records)
    figure = Figure(figsize=(4.4 * len(variants) + 0.6, 8.2), layout="constrained")
    panels = figure.subplots(len(ROWS), len(variants), squeeze=False, sharex=True, sharey="row")
    for column, variant in enumerate(variants):
        panels[0, column].set_title(TITLES.get(variant, variant), fontsize=12)
        for row, name in enumerate(ROWS):
            axes = panels[row, column]
            for algorithm in NAMES:
                own = [record for key, group in groups.items() if key[:2] == (algorithm, variant) for record in group]
                found = band(own, name, against)
                if found is not None:
                    _draw(axes, found, algorithm, against)
            axes.grid(color="0.92")
            axes.set_ylabel(ROWS[name] if column == 0 else "")
        panels[-1, column].set_xlabel(AXES[against])
    for axes in panels[0]:
        _draw_human(axes, human)
    for axes in panels[1:].flat:
        axes.set_ylim(-0.02, 1.02)
    if against == "moves":
        set_moves_axis(panels[0, 0])
    _add_legend(figure, records, human)
    figure.suptitle(f"Learning on level {_place(records)}: {seeds_text(records)}", fontsize=11)
    return figure


def _draw(axes: Axes, found: Band, algorithm: str, against: str) -> None:
    if against == "cpu_s":
        found = Band(found.x / 60, found.mean, found.low, found.high, found.seeds)
    draw_band(axes, found, color=COLOURS[algorithm], linestyle=LINE_STYLES[algorithm])


def _draw_human(axes: Axes, human: HumanLevel | None) -> None:
    if human is None:
        return
    axes.axhline(human.mean, color=HUMAN_COLOUR, linewidth=1.2, linestyle=(0, (6, 2)))
    if human.low is not None and human.high is not None:
        axes.axhspan(human.low, human.high, color=HUMAN_COLOUR, alpha=0.12, linewidth=0)


def _add_legend(figure: Figure, records: Sequence[Record], human: HumanLevel | None) -> None:
    found = {record.trial.algorithm for record in records}
    handles = [
        Line2D([], [], color=COLOURS[name], linestyle=LINE_STYLES[name], linewidth=2, label=label)
        for name, label in NAMES.items()
        if name in found
    ]
    if human is not None:
        label = f"people ({human.players} players, study {human.study})"
        handles.append(Line2D([], [], color=HUMAN_COLOUR, linewidth=1.2, linestyle=(0, (6, 2)), label=label))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)


def seeds_text(records: Sequence[Record]) -> str:
    """Return what a line and its surface are, in words, by how many seeds there are."""
    counts = {len(group) for group in grouped(records).values()}
    if counts == {1}:
        return "one seed, so no interval"
    if len(counts) == 1:
        return f"mean of {counts.pop()} seeds and its 95 % t interval"
    return f"means of {min(counts)} to {max(counts)} seeds and their 95 % t intervals (none for one seed)"


def _place(records: Sequence[Record]) -> str:
    trial = records[0].trial
    return f"{trial.level}, {trial.size}x{trial.size}"


def endings_figure(records: Sequence[Record]) -> Figure:
    """Plot how episodes ended in training, as stacked shares against moves: a row for each variant, a column an algorithm."""
    variants, groups = shown_variants(records), grouped(records)
    algorithms = [name for name in NAMES if any(record.trial.algorithm == name for record in records)]
    figure = Figure(figsize=(2.3 * len(algorithms) + 0.7, 2.4 * len(variants) + 0.9), layout="constrained")
    panels = figure.subplots(len(variants), len(algorithms), squeeze=False, sharey=True)
    for row, variant in enumerate(variants):
        for column, algorithm in enumerate(algorithms):
            axes = panels[row, column]
            own = [record for key, group in groups.items() if key[:2] == (algorithm, variant) for record in group]
            _draw_endings(axes, own)
            axes.set_title(NAMES[algorithm] if row == 0 else "", fontsize=11)
            axes.set_xlabel("moves" if row == len(variants) - 1 else "")
        panels[row, 0].set_ylabel(f"{TITLES.get(variant, variant)}\nshare of episodes")
    handles = [Patch(color=ENDING_COLOURS[name], label=label) for name, label in ENDING_NAMES.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=9)
    figure.suptitle(f"How episodes ended in training on level {_place(records)}, means over seeds", fontsize=11)
    return figure


def _draw_endings(axes: Axes, records: Sequence[Record]) -> None:
    bands = {name: found for name in ENDING_NAMES if (found := band(records, name, "moves")) is not None}
    axes.set_ylim(0, 1)
    if not bands:
        axes.set_axis_off()
        return
    x = next(iter(bands.values())).x
    axes.stackplot(x, [found.mean for found in bands.values()], colors=[ENDING_COLOURS[name] for name in bands])
    set_moves_axis(axes)
    axes.set_xlim(x[0], x[-1])
