"""Shared by the pictures of the paper's figures: colours, type, equal files."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from itertools import cycle
from pathlib import Path
from textwrap import wrap
from typing import Any

from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from marsexplorer.config import LEVELS
from research.informed.informed import INFORMED
from research.paper.jobs import Line, write_text
from research.paper.tables import Estimate

FIXED_COLOURS = {
    "ppo-earlier": "#0072B2",
    "ppo": "#000000",
    "ppo-paper": "#CC79A7",
    "frontier-utility": "#E69F00",
    "frontier-cost": "#D55E00",
    INFORMED: "#4D4D4D",
}
"""Policies in the order of drawing, in colours that colour-blind people can tell apart."""

ALGORITHM_COLOURS = {"ppo": "#0072B2", "a2c": "#56B4E9", "rainbow": "#009E73", "sac": "#882255"}
"""Of the four algorithms' learning curves, and of policies trained by them, in every figure."""

SPARE_COLOURS = ("#332288", "#999933", "#661100", "#AA4499")
"""Of any other policies, one after the other."""

NESTED_WIDTHS = (3.6, 2.7, 1.8, 0.9)
"""Of lines, points, in the order in which they are drawn: where they lie upon each other all can
be seen.
"""

PLACES = re.compile(r' (?:d|x|y)="[^"]*"')
DIGITS = re.compile(r"(\.\d\d)\d+")

INK, SOFT_INK, LINE_COLOUR, SAND = "#1f2328", "#59636e", "#d8dde3", "#f6f1ea"
"""Text, lesser text, thin lines, and quiet surfaces."""


def in_order(names: Iterable[str]) -> list[str]:
    """The different names: those of FIXED_COLOURS first, then the others as they came."""
    distinct = dict.fromkeys(names)
    return [name for name in FIXED_COLOURS if name in distinct] + [
        name for name in distinct if name not in FIXED_COLOURS
    ]


def colours_of(names: Iterable[str]) -> dict[str, str]:
    """A colour for each policy; one of A2C, Rainbow or SAC has its algorithm's."""
    colours, spare = dict(FIXED_COLOURS), cycle(SPARE_COLOURS)
    for name in in_order(names):
        algorithm = name.split("-")[0]
        trained = ALGORITHM_COLOURS[algorithm] if algorithm in ("a2c", "rainbow", "sac") else ""
        if name not in colours:
            colours[name] = trained or next(spare)
    return colours


def sorted_lines(lines: Sequence[Line]) -> list[Line]:
    """Results of policies by size, level in the order of LEVELS, policy `in_order`."""
    levels, policies = list(LEVELS), in_order(line["policy"] for line in lines)
    return sorted(
        lines,
        key=lambda line: (
            line["rows"],
            levels.index(line["level"]),
            policies.index(line["policy"]),
        ),
    )


def new_figure(width: float, height: float) -> Figure:
    """An empty white figure, inches, with its own layout and no shared state."""
    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def plain(axes: Axes, title: str = "") -> None:
    """Give axes a quiet frame, a thin grid, and a title at the left."""
    axes.set_title(title, loc="left", fontsize=9.5, color=INK, fontweight="bold")
    axes.grid(color=LINE_COLOUR, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, colors=SOFT_INK, length=0)
    axes.xaxis.label.set(fontsize=8.5, color=SOFT_INK)
    axes.yaxis.label.set(fontsize=8.5, color=SOFT_INK)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(LINE_COLOUR)


def line_of(label: str, colour: str, **style: Any) -> Line2D:
    """A line for a legend; `style` is matplotlib's."""
    return Line2D([], [], color=colour, label=label, **style)


def legend(figure: Figure, handles: Sequence[Artist], columns: int, place: str = "center") -> None:
    """Put a legend below everything; `place` is "left" or "center"."""
    style: dict[str, Any] = {"loc": f"outside lower {place}", "frameon": False, "fontsize": 8.5}
    if place == "left":
        style["labelcolor"] = INK
    figure.legend(handles=handles, ncols=columns, **style)


def draw_interval(
    axes: Axes, estimate: Estimate, at: float, marker: str, colour: str, sizes: Sequence[float]
) -> None:
    """Draw a mean and its interval along the x axis.

    sizes  of its line, of the marker and of the marker's edge, points
    """
    line, size, edge = sizes
    axes.plot(
        [estimate.low, estimate.high],
        [at, at],
        color=colour,
        linewidth=line,
        solid_capstyle="round",
    )
    border: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": edge}
    axes.plot(estimate.mean, at, marker, color=colour, markersize=size, **border)


def shade_rows(axes: Axes, rows: int) -> None:
    """Shade every other row of axes with rows at 0, 1, ..., without grid lines."""
    axes.grid(visible=False, axis="y")
    for number in range(0, rows, 2):
        axes.axhspan(number - 0.5, number + 0.5, color=SAND, zorder=0, linewidth=0)


def heading(figure: Figure, title: str, text: str) -> None:
    """Put a title above everything, and a text below it; long lines are broken."""
    width, height = figure.get_size_inches()
    title, text = (
        "\n".join(part for line in words.splitlines() for part in wrap(line, int(width / size)))
        for words, size in ((title, 0.115), (text, 0.066))
    )
    below = 0.22 * title.count("\n")
    bold: dict[str, Any] = {"fontsize": 13, "fontweight": "bold", "color": INK}
    soft: dict[str, Any] = {"fontsize": 8.5, "linespacing": 1.35, "color": SOFT_INK}
    for down, words, style in ((0.08, title, bold), (0.36 + below, text, soft)):
        figure.text(0.1 / width, 1 - down / height, words, va="top", **style)
    engine = figure.get_layout_engine()
    assert isinstance(engine, ConstrainedLayoutEngine)
    engine.set(rect=(0, 0, 1, 1 - (0.48 + below + 0.16 * len(text.splitlines())) / height))


def save(figure: Figure, path: Path) -> Path:
    """Write a whole picture, and its folder; the same figure gives the same bytes.

    Places are rounded to a hundredth of a point, which halves the file.
    """
    drawn = io.StringIO()
    with rc_context({"svg.hashsalt": "marsexplorer"}):
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None})
    return write_text(path, PLACES.sub(lambda place: DIGITS.sub(r"\1", place[0]), drawn.getvalue()))
