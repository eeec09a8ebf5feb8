"""Figure 5 of Koutras et al. 2021: how PPO learns on each of the 12 levels, and how hard the levels are without learning.

figure5-VARIANT.png             score, coverage and completion in training against moves: a column for each d_t
figure5-difficulty-VARIANT.png  what the trained policies reach on held-out terrains, and the moves that the rules and the
                                informed search need there
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from marsexplorer.evaluation import RULES
from research.informed import INFORMED
from research.paper.episodes.play import TERRAINS, Line, read_results
from research.paper.figures.curves import (
    TITLES,
    Mean,
    Record,
    band,
    draw_band,
    rows_of,
    set_moves_axis,
)
from research.paper.figures.drawing import SOFT_INK, colours_of, heading, new_figure, plain, save
from research.paper.figures.figure4 import ROWS, seeds_text

TOPOLOGIES = (1, 2, 3)
LINES: dict[tuple[int, int], tuple[str, Any]] = {
    (1, 1): ("#0072B2", "-"),
    (1, 2): ("#0072B2", "--"),
    (2, 1): ("#D55E00", "-"),
    (2, 2): ("#D55E00", "--"),
}
"""(d_m, d_b) -> colour by morphology, dashes where no bonus is paid."""
BONUS_NAMES = {1: "with bonus", 2: "without bonus"}
MEASURED = {"score": "normalized score", "completion": "completion", "steps": "moves to 99 %"}
"""What the picture of the difficulty has on held-out terrains."""
OFFSETS = {1: -0.12, 2: 0.12}
"""d_b -> where its points stand beside the middle of their level."""


def read_difficulty(folder: Path) -> list[Line]:
    """Return what the rules and the informed search reached on the levels, as far as it lies in a folder."""
    try:
        return read_results(folder, 5)
    except FileNotFoundError:
        return []


def draw(records: Sequence[Record], difficulty: Sequence[Line], folder: Path) -> list[Path]:
    """Draw the pictures for each variant of trials, at least one, into a folder and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for variant in sorted({record.trial.variant for record in records}):
        own = [record for record in records if record.trial.variant == variant]
        paths.append(save(levels_figure(own, variant), folder / f"figure5-{variant}.png"))
        paths.append(
            save(
                difficulty_figure(own, variant, difficulty),
                folder / f"figure5-difficulty-{variant}.png",
            )
        )
    return paths


def levels_figure(records: Sequence[Record], variant: str) -> Figure:
    """Plot score, coverage and completion in training against moves: a column for each d_t, a line for each d_m and d_b."""
    figure = new_figure(9.6, 8.0)
    panels = figure.subplots(len(ROWS), len(TOPOLOGIES), squeeze=False, sharex=True, sharey="row")
    for column, topology in enumerate(TOPOLOGIES):
        for row, name in enumerate(ROWS):
            axes = panels[row, column]
            _draw_panel(axes, records, topology, name)
            axes.set_ylabel(ROWS[name] if column == 0 else "")
            axes.set_xlabel("moves made in training (logarithmic)" if row == len(ROWS) - 1 else "")
            plain(axes, f"topology d_t = {topology}" if row == 0 else "")
            axes.set_ylim(-0.02, 1.02)
            set_moves_axis(axes)
    handles = [
        Line2D(
            [],
            [],
            color=colour,
            linestyle=style,
            linewidth=1.8,
            label=f"d_m = {morphology}, {BONUS_NAMES[bonus]}",
        )
        for (morphology, bonus), (colour, style) in LINES.items()
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=8.5
    )
    text = f"{seeds_text(records)}. As played in training: means of the last 100 episodes."
    heading(figure, f"PPO on the 12 levels, {TITLES.get(variant, variant)}", text)
    return figure


def _draw_panel(axes: Axes, records: Sequence[Record], topology: int, name: str) -> None:
    for (morphology, bonus), (colour, style) in LINES.items():
        level = f"{topology}-{morphology}-{bonus}"
        found = band([record for record in records if record.trial.level == level], name, "moves")
        if found is not None:
            draw_band(axes, found, color=colour, linestyle=style)


def difficulty_figure(
    records: Sequence[Record], variant: str, difficulty: Sequence[Line]
) -> Figure:
    """Plot what the trained policies reach on held-out terrains of each kind, and the moves that others need there."""
    limit = records[0].trial.config.limit
    figure = new_figure(7.6, 7.6)
    panels = figure.subplots(len(MEASURED), 1, sharex=True)
    for axes, (name, words) in zip(panels, MEASURED.items(), strict=True):
        for row in rows_of(records):
            kind, bonus = row.level[:-2], int(row.level[-1])
            colour, _ = LINES[int(kind[-1]), bonus]
            filled = colour if bonus == 1 else "white"
            _draw_mean(
                axes,
                list(TERRAINS).index(kind) + OFFSETS[bonus],
                getattr(row, name),
                colour,
                filled,
            )
        axes.set_ylabel(words)
        plain(axes)
    for line in difficulty:
        _draw_reference(panels[-1], line)
    for axes in panels[:-1]:
        axes.set_ylim(-0.06, 1.06)
    panels[-1].set_ylim(bottom=0)
    panels[-1].set_xticks(
        range(len(TERRAINS)), [f"d_t {kind[0]}, d_m {kind[-1]}" for kind in TERRAINS]
    )
    figure.legend(
        handles=_handles(difficulty),
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=8.5,
    )
    text = (
        f"{seeds_text(records)}, on held-out terrains; an unfinished episode counts {limit} moves.\n"
        "Bars: what the rules need there, and a search that is shown the map, means over terrains."
    )
    heading(figure, f"How hard the levels are: PPO, {TITLES.get(variant, variant)}", text)
    return figure


def _draw_mean(axes: Axes, at: float, mean: Mean, colour: str, filled: str) -> None:
    if mean.low is not None and mean.high is not None:
        axes.plot([at, at], [mean.low, mean.high], color=colour, linewidth=1.4)
    axes.plot(at, mean.mean, "o", color=colour, markerfacecolor=filled, markersize=5.5)


def _draw_reference(axes: Axes, line: Line) -> None:
    """Draw the moves of a rule or of the informed search as a bar across its kind of terrain."""
    at, mean = list(TERRAINS).index(line["level"][:-2]), line["steps_to_99"]["mean"]
    axes.plot(
        [at - 0.34, at + 0.34],
        [mean, mean],
        color=colours_of([line["policy"]])[line["policy"]],
        linewidth=1.8,
    )


def _handles(difficulty: Sequence[Line]) -> list[Line2D]:
    handles = [
        Line2D(
            [],
            [],
            linestyle="",
            marker="o",
            color=colour,
            markerfacecolor=colour if bonus == 1 else "white",
            label=words,
        )
        for (morphology, bonus), (colour, _) in LINES.items()
        if (words := f"PPO, d_m = {morphology}, {BONUS_NAMES[bonus]}")
    ]
    found = {line["policy"] for line in difficulty}
    colours = colours_of(sorted(found))
    names = [name for name in (*RULES, INFORMED) if name in found]
    return [
        *handles,
        *(
            Line2D([], [], color=colours.get(name, SOFT_INK), linewidth=1.8, label=name)
            for name in names
        ),
    ]
