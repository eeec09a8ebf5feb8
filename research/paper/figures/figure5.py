"""Figure 5 of Koutras et al. 2021: PPO on the 12 levels, and their difficulty.

figure5-VARIANT.svg             score, coverage and completion in training against moves: a column
                                for each d_t
figure5-difficulty-VARIANT.svg  the trained policies on held-out terrains, and the moves that the
                                rules and the informed search need there
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from marsexplorer.evaluation import RULES
from research.informed.informed import INFORMED
from research.paper.episodes.play import TERRAINS, read_results
from research.paper.figures.curves import (
    TITLES,
    Record,
    chosen,
    draw_curves,
    rows_of,
    set_moves_axis,
)
from research.paper.figures.drawing import (
    NESTED_WIDTHS,
    colours_of,
    heading,
    legend,
    line_of,
    new_figure,
    plain,
    save,
)
from research.paper.figures.figure4 import ROWS, seeds_text
from research.paper.jobs import Line

TOPOLOGIES = (1, 2, 3)
COLOURS = {(1, 1): "#0072B2", (1, 2): "#56B4E9", (2, 1): "#D55E00", (2, 2): "#E69F00"}
"""(d_m, d_b) -> colour by morphology, lighter where no bonus is paid."""
BONUS_NAMES = {1: "with bonus", 2: "without bonus"}
MEASURED = {"score": "normalized score", "completion": "completion", "steps": "moves to 99 %"}
"""The measures of the picture of the difficulty, on held-out terrains."""
OFFSETS = {1: -0.12, 2: 0.12}
"""d_b -> where its points stand beside the middle of their level."""


def draw(records: Sequence[Record], source: Path, folder: Path) -> list[Path]:
    """Draw the pictures for each variant of trials, at least one; return their paths.

    Args:
        records: The trials.
        source: Folder of the results of the rules and the informed search, if there are any.
        folder: Of the pictures.
    """
    paths, difficulty = [], []
    with suppress(FileNotFoundError):
        difficulty = read_results(source, 5)
    for variant in sorted({record.trial.variant for record in records}):
        variant_records = chosen(records, variant=variant)
        pictures = {
            "": levels_figure(variant_records),
            "difficulty-": difficulty_figure(variant_records, difficulty),
        }
        for name, figure in pictures.items():
            paths.append(save(figure, folder / f"figure5-{name}{variant}.svg"))
    return paths


def levels_figure(records: Sequence[Record]) -> Figure:
    """Plot the measures in training against moves, a column for each d_t.

    A line for each d_m and d_b.

    records  of one variant
    """
    figure = new_figure(9.6, 8.0)
    panels = figure.subplots(len(ROWS), len(TOPOLOGIES), squeeze=False, sharex=True, sharey="row")
    for column, topology in enumerate(TOPOLOGIES):
        for row, name in enumerate(ROWS):
            axes = panels[row, column]
            for ((m, b), colour), width in zip(COLOURS.items(), NESTED_WIDTHS, strict=True):
                level_records = chosen(records, level=f"{topology}-{m}-{b}")
                draw_curves(axes, level_records, name, "moves", color=colour, linewidth=width)
            axes.set_ylabel(ROWS[name] if column == 0 else "")
            axes.set_xlabel("moves made in training (logarithmic)" if row == len(ROWS) - 1 else "")
            plain(axes, f"topology d_t = {topology}" if row == 0 else "")
            axes.set_ylim(-0.02, 1.02)
            set_moves_axis(axes)
    handles = [
        line_of(f"d_m = {m}, {BONUS_NAMES[b]}", colour, linewidth=width)
        for ((m, b), colour), width in zip(COLOURS.items(), NESTED_WIDTHS, strict=True)
    ]
    legend(figure, handles, len(handles))
    text = f"{seeds_text(records)}. As played in training: means of the last 100 episodes."
    heading(figure, f"PPO on the 12 levels, {title_of(records)}", text)
    return figure


def title_of(records: Sequence[Record]) -> str:
    """The title of some trials' variant."""
    variant = records[0].trial.variant
    return TITLES.get(variant, variant)


def difficulty_figure(records: Sequence[Record], difficulty: Sequence[Line]) -> Figure:
    """Plot the trained policies on each kind of terrain, and the moves of others.

    records  of one variant
    """
    limit = records[0].trial.config.limit
    figure = new_figure(7.6, 7.6)
    panels = figure.subplots(len(MEASURED), 1, sharex=True)
    kinds = list(TERRAINS)
    for axes, (name, words) in zip(panels, MEASURED.items(), strict=True):
        for row in rows_of(records):
            kind, bonus = row.level[:-2], int(row.level[-1])
            at, mean = kinds.index(kind) + OFFSETS[bonus], getattr(row, name)
            colour = COLOURS[int(kind[-1]), bonus]
            axes.plot([at, at], [mean.low, mean.high], color=colour, linewidth=1.4)
            axes.plot(at, mean.mean, markersize=5.5, color=colour, **_point(colour, bonus))
        axes.set_ylabel(words)
        plain(axes)
    colours = colours_of(line["policy"] for line in difficulty)
    names = [name for name in (*RULES, INFORMED) if name in {line["policy"] for line in difficulty}]
    widths = dict(zip(names, NESTED_WIDTHS, strict=False))
    for line in sorted(
        difficulty, key=lambda result: -widths[result["policy"]]
    ):  # a bar for each kind of terrain
        at, mean = kinds.index(line["level"][:-2]), line["steps_to_99"]["mean"]
        ends, colour = [at - 0.34, at + 0.34], colours[line["policy"]]
        bar: dict[str, Any] = {"linewidth": widths[line["policy"]], "zorder": 1}
        panels[-1].plot(ends, [mean, mean], color=colour, **bar)
    for axes in panels[:-1]:
        axes.set_ylim(-0.06, 1.06)
    panels[-1].set_ylim(bottom=0)
    panels[-1].set_xticks(range(len(kinds)), [f"d_t {kind[0]}, d_m {kind[-1]}" for kind in kinds])
    handles = [
        line_of(f"PPO, d_m = {m}, {BONUS_NAMES[b]}", colour, **_point(colour, b))
        for (m, b), colour in COLOURS.items()
    ]
    bars = [line_of(name, colours[name], linewidth=widths[name]) for name in names]
    legend(figure, handles + bars, 3)
    text = (
        f"{seeds_text(records)}, on held-out terrains; an unfinished episode counts {limit} moves.\n"
        "Bars: what the rules need there, and a search that is shown the map, means over terrains."
    )
    heading(figure, f"How hard the levels are: PPO, {title_of(records)}", text)
    return figure


def _point(colour: str, bonus: int) -> dict[str, Any]:
    """The style of a level's points: hollow if no bonus is paid."""
    return {"linestyle": "", "marker": "o", "markerfacecolor": colour if bonus == 1 else "white"}
