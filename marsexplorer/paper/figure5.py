"""Figure 5 of Koutras et al. 2021: how PPO learns on each of the 12 levels, and how hard the levels are for others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from marsexplorer.paper.curves import Record, band, draw_band, save_figure, set_moves_axis
from marsexplorer.paper.figure4 import ROWS, seeds_text

TOPOLOGIES = (1, 2, 3)
LINES: dict[tuple[int, int], tuple[str, Any]] = {
    (1, 1): ("#0072B2", "-"),
    (1, 2): ("#0072B2", "--"),
    (2, 1): ("#D55E00", "-"),
    (2, 2): ("#D55E00", "--"),
}
"""(morphology, bonus) -> colour by morphology, dashes where no bonus is paid."""


def draw(records: Sequence[Record], folder: Path) -> list[Path]:
    """Draw figure5-VARIANT.png for each variant into a folder and return the paths."""
    variants = sorted({record.trial.variant for record in records})
    return [
        save_figure(
            levels_figure([record for record in records if record.trial.variant == variant], variant),
            folder / f"figure5-{variant}.png",
        )
        for variant in variants
    ]


def levels_figure(records: Sequence[Record], variant: str) -> Figure:
    """Plot score, coverage and completion in training against moves: a column for each d_t, a line for each d_m and d_b."""
    figure = Figure(figsize=(10.5, 7.6), layout="constrained")
    panels = figure.subplots(len(ROWS), len(TOPOLOGIES), squeeze=False, sharex=True, sharey="row")
    for column, topology in enumerate(TOPOLOGIES):
        panels[0, column].set_title(f"topology $d_t$ = {topology}", fontsize=11)
        for row, name in enumerate(ROWS):
            _draw_panel(panels[row, column], records, topology, name)
            panels[row, column].set_ylabel(ROWS[name] if column == 0 else "")
        panels[-1, column].set_xlabel("moves (logarithmic)")
    for axes in panels[1:].flat:
        axes.set_ylim(-0.02, 1.02)
    set_moves_axis(panels[0, 0])
    handles = [
        Line2D([], [], color=colour, linestyle=style, label=f"$d_m$ = {morphology}, {'bonus' if bonus == 1 else 'no bonus'}")
        for (morphology, bonus), (colour, style) in LINES.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    figure.suptitle(f"PPO ({variant}) on the 12 levels: {seeds_text(records)}", fontsize=11)
    return figure


def _draw_panel(axes: Axes, records: Sequence[Record], topology: int, name: str) -> None:
    for (morphology, bonus), (colour, style) in LINES.items():
        level = f"{topology}-{morphology}-{bonus}"
        found = band([record for record in records if record.trial.level == level], name, "moves")
        if found is not None:
            draw_band(axes, found, color=colour, linestyle=style)
    axes.grid(color="0.92")
