"""Figure 4 of Koutras et al. 2021: learning curves of the four algorithms.

figure4-moves.svg    score, coverage and completion in training against moves, and how the last
                     episodes ended
figure4-cpu.svg      the same against CPU time, of the trainings whose time is known; it tells
                     whether they can be compared
figure4-endings.svg  how episodes ended, all along
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter

from research.paper.figures.curves import (
    NAMES,
    SEEDS,
    TITLES,
    Record,
    band,
    chosen,
    draw_curves,
    grouped,
    is_timed,
    is_timed_alike,
    longest,
    set_moves_axis,
)
from research.paper.figures.drawing import (
    ALGORITHM_COLOURS,
    INK,
    NESTED_WIDTHS,
    SOFT_INK,
    heading,
    legend,
    line_of,
    new_figure,
    plain,
    save,
)
from research.paper.tables import per_cent

ROWS = {"score": "normalized score", "coverage": "coverage", "explored": "completion"}
AXES = {"moves": "moves made in training (logarithmic)", "cpu_s": "CPU minutes of training"}
UNALIKE = "Trainings ran on machines, and beside other work, that are not known to be the same."
"""The sentence about CPU times that are not `is_timed_alike`."""
ENDINGS = {
    "explored": "explored",
    "timed_out": "out of time",
    "collided": "hit an obstacle",
    "out_of_bounds": "left the grid",
}
ENDING_COLOURS = {
    "explored": "#44AA99",
    "timed_out": "#DDDDDD",
    "collided": "#CC6677",
    "out_of_bounds": "#DDCC77",
}
"""Not those of the algorithms (Tol's muted scheme)."""
HUMAN_STYLE: dict[str, Any] = {"color": SOFT_INK, "linewidth": 1.2, "linestyle": (0, (6, 2))}
MAX_COLUMNS = 2
LEAST_LABELLED = 0.12
"""Share from which a part of a bar has its number in it."""


@dataclass(frozen=True)
class HumanLevel:
    """The mean score of the people of a closed study, with its interval if it has one."""

    study: str
    players: int
    mean: float
    low: float | None
    high: float | None


def draw(records: Sequence[Record], folder: Path, human: HumanLevel | None = None) -> list[Path]:
    """Draw the pictures of trials, at least one, into a folder; return their paths."""
    pictures = {
        "moves": curves_figure(records, "moves", human),
        "endings": endings_figure(records),
    }
    if timed := [record for record in records if is_timed(record)]:
        pictures["cpu"] = curves_figure(timed, "cpu_s", human)
    return [save(figure, folder / f"figure4-{name}.svg") for name, figure in pictures.items()]


def shown_variants(records: Sequence[Record]) -> list[str]:
    """The variants with a column: "paper" and "works", or the first two by name."""
    variants = {record.trial.variant for record in records}
    return ([name for name in TITLES if name in variants] or sorted(variants))[:MAX_COLUMNS]


def shown_algorithms(records: Sequence[Record]) -> list[str]:
    """The algorithms of some trials in the order in which they are drawn."""
    algorithms = {record.trial.algorithm for record in records}
    return [name for name in NAMES if name in algorithms]


def curves_figure(
    records: Sequence[Record], against: str, human: HumanLevel | None = None
) -> Figure:
    """Plot the measures in training against "moves" or "cpu_s", a column a variant."""
    variants, algorithms = shown_variants(records), shown_algorithms(records)
    last_row, heights = len(ROWS) - 1, [*(1 for _ in ROWS), 0.1 + 0.13 * len(algorithms)]
    figure = new_figure(4.6 * len(variants) + 0.4, 8.6 + 0.26 * len(algorithms))
    grid = figure.add_gridspec(len(heights), len(variants), height_ratios=heights)
    shared: dict[str, Axes] = {}
    for column, variant in enumerate(variants):
        variant_records, is_first = chosen(records, variant=variant), column == 0
        for row, name in enumerate(ROWS):
            of_row = {"sharex": shared.get("x"), "sharey": shared.get(name)}
            axes = figure.add_subplot(grid[row, column], **of_row)
            shared.setdefault("x", axes)
            shared.setdefault(name, axes)
            _draw_panel(axes, variant_records, name, against, human)
            axes.set_xlabel(AXES[against] if row == last_row else "")
            axes.set_ylabel(ROWS[name] if is_first else "")
            plain(axes, TITLES.get(variant, variant) if row == 0 else "")
            axes.tick_params(labelbottom=row == last_row, labelleft=is_first)
        below = figure.add_subplot(grid[len(ROWS), column])
        _draw_last_endings(below, variant_records, algorithms, is_labelled=is_first)
    if against == "cpu_s":
        shared["x"].set_xlim(left=0)  # last: it ends the automatic choice of the other end
    _add_legend(figure, algorithms, human)
    shown = [record for record in records if record.trial.variant in variants]
    text = f"{seeds_text(shown)}. As played in training: means of the last 100 episodes.\nBelow: how the last of them ended."
    title = (
        f"Learning on {place_of(records)}, against {'moves' if against == 'moves' else 'CPU time'}"
    )
    if against == "cpu_s" and not is_timed_alike(shown):
        text += f"\n{UNALIKE}"
    heading(figure, title, text)
    return figure


def place_of(records: Sequence[Record]) -> str:
    """The level and size of some trials in words."""
    trial = records[0].trial
    return f"level {trial.level}, {trial.size}x{trial.size}"


def _draw_panel(
    axes: Axes, records: Sequence[Record], name: str, against: str, human: HumanLevel | None
) -> None:
    unit = 60 if against == "cpu_s" else 1
    for algorithm, width in zip(NAMES, NESTED_WIDTHS, strict=True):
        style = {"color": ALGORITHM_COLOURS[algorithm], "linewidth": width}
        draw_curves(axes, chosen(records, algorithm=algorithm), name, against, unit, **style)
    if human is not None and name == "score":
        axes.axhline(human.mean, **HUMAN_STYLE)
        if human.low is not None and human.high is not None:
            axes.axhspan(human.low, human.high, color=SOFT_INK, alpha=0.15, linewidth=0)
    if against == "moves":
        set_moves_axis(axes)
    axes.set_ylim(-0.02, 1.02)


def _draw_last_endings(
    axes: Axes, records: Sequence[Record], algorithms: Sequence[str], is_labelled: bool
) -> None:
    """Draw a bar for each algorithm: how the last episodes ended, means over seeds."""
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7.5, "color": INK}
    for place, algorithm in enumerate(algorithms):
        left, trials = 0.0, longest(chosen(records, algorithm=algorithm))
        for name in ENDINGS:
            ends = (record.curve[name][-1] for record in trials)
            shares = [end for end in ends if end is not None]
            share = float(np.mean(shares)) if shares else 0.0
            axes.barh(place, share, left=left, color=ENDING_COLOURS[name], height=0.72)
            if share >= LEAST_LABELLED:
                axes.text(left + share / 2, place, per_cent(share), **style)
            left += share
    plain(axes)
    axes.grid(visible=False)
    axes.set(xlim=(0, 1), xticks=(0, 0.25, 0.5, 0.75), ylim=(len(algorithms) - 0.4, -0.6))
    names = [NAMES[name] for name in algorithms] if is_labelled else []
    axes.set_yticks(range(len(algorithms)), names)
    axes.xaxis.set_major_formatter(PercentFormatter(1, symbol=" %"))
    axes.set_xlabel("share of the last episodes")


def _add_legend(figure: Figure, algorithms: Sequence[str], human: HumanLevel | None) -> None:
    """Add a row for the lines and one for the endings."""
    lines: list[Line2D | Patch] = [
        line_of(NAMES[algorithm], ALGORITHM_COLOURS[algorithm], linewidth=width)
        for algorithm, width in zip(NAMES, NESTED_WIDTHS, strict=True)
        if algorithm in algorithms
    ]
    if human is not None:
        label = f"{human.players} people (study {human.study})"
        lines.append(Line2D([], [], label=label, **HUMAN_STYLE))
    nothing = Line2D([], [], linestyle="", label=" ")
    pairs = zip_longest(lines, ending_patches(), fillvalue=nothing)
    handles = [handle for pair in pairs for handle in pair]  # a legend is filled column by column
    legend(figure, handles, len(handles) // 2)


def ending_patches() -> list[Patch]:
    """The colours of the endings for a legend."""
    return [Patch(color=ENDING_COLOURS[name], label=label) for name, label in ENDINGS.items()]


def seeds_text(records: Sequence[Record]) -> str:
    """A sentence about lines, surfaces and points, by how many seeds there are."""
    counts = sorted(len(group) for group in grouped(records).values())
    enough, words = [count for count in counts if count >= SEEDS], []
    if enough:
        seeds = f"{enough[0]}" if enough[0] == enough[-1] else f"{enough[0]} to {enough[-1]}"
        words.append(f"means of {seeds} seeds with their 95 % t intervals")
    if counts[0] < SEEDS:
        words.append(f"points: seeds of which there are fewer than {SEEDS}")
    text = "; ".join(words)
    return text[0].upper() + text[1:]


def endings_figure(records: Sequence[Record]) -> Figure:
    """Plot how episodes ended in training, as stacked shares against moves.

    A row for each variant, a column for each algorithm.
    """
    variants, algorithms = shown_variants(records), shown_algorithms(records)
    figure = new_figure(2.3 * len(algorithms) + 0.7, 2.2 * len(variants) + 1.3)
    panels = figure.subplots(len(variants), len(algorithms), squeeze=False, sharey=True)
    for row, variant in enumerate(variants):
        for column, algorithm in enumerate(algorithms):
            axes = panels[row, column]
            _draw_endings(axes, longest(chosen(records, algorithm=algorithm, variant=variant)))
            axes.set_xlabel("moves (logarithmic)" if row == len(variants) - 1 else "")
            title = f"{TITLES.get(variant, variant)}\nshare of episodes"
            axes.set_ylabel(title if column == 0 else "")
            plain(axes, NAMES[algorithm] if row == 0 else "")
    legend(figure, ending_patches(), len(ENDINGS))
    text = "Means over seeds of the last 100 episodes."
    heading(figure, f"How episodes ended in training on {place_of(records)}", text)
    return figure


def _draw_endings(axes: Axes, records: Sequence[Record]) -> None:
    bands = {
        name: shares for name in ENDINGS if (shares := band(records, name, "moves")) is not None
    }
    axes.set_ylim(0, 1)
    if not bands:
        return
    x = next(iter(bands.values())).x
    axes.stackplot(
        x,
        [shares.mean for shares in bands.values()],
        colors=[ENDING_COLOURS[name] for name in bands],
    )
    set_moves_axis(axes)
    axes.set_xlim(x[0], x[-1])
