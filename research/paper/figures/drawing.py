"""What the pictures of the paper's figures share: colours, type, and files that come out the same each time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from marsexplorer.files import replace_whole, write_whole
from research.informed import INFORMED

ORDER = ("ppo-earlier", "ppo", "ppo-paper", "frontier-utility", "frontier-cost", INFORMED)
"""Policies that are always drawn in this order and in the same colours; others follow."""

FIXED_COLOURS = ("#0072B2", "#000000", "#CC79A7", "#E69F00", "#D55E00", "#4D4D4D")
"""Of the policies in ORDER; colour-blind people can tell them apart."""

ALGORITHM_COLOURS = {"ppo": "#0072B2", "a2c": "#56B4E9", "rainbow": "#009E73", "sac": "#882255"}
"""Of the four algorithms' learning curves, and of the policies that `python -m research.paper` trained, in every figure."""

SPARE_COLOURS = ("#332288", "#999933", "#661100", "#AA4499")
"""Of any other policies, one after the other."""

INK, SOFT_INK, LINE_COLOUR, SAND = "#1f2328", "#59636e", "#d8dde3", "#f6f1ea"
"""Text, lesser text, thin lines, and quiet surfaces."""

DPI = 160


def in_order(names: Sequence[str]) -> list[str]:
    """Return the different names: those in ORDER first, then the others as they came."""
    known = dict.fromkeys(names)
    return [
        *(name for name in ORDER if name in known),
        *(name for name in known if name not in ORDER),
    ]


def colours_of(names: Sequence[str]) -> dict[str, str]:
    """Return a colour for each policy; what was trained by A2C, Rainbow or SAC has its algorithm's, as in figure 4."""
    algorithms = {name: name.split("-")[0] for name in names}
    trained = {
        name: ALGORITHM_COLOURS[each]
        for name, each in algorithms.items()
        if each in ("a2c", "rainbow", "sac")
    }
    fixed = dict(zip(ORDER, FIXED_COLOURS, strict=True)) | trained
    others = [name for name in in_order(names) if name not in fixed]
    return fixed | {
        name: SPARE_COLOURS[number % len(SPARE_COLOURS)] for number, name in enumerate(others)
    }


def new_figure(width: float, height: float) -> Figure:
    """Return an empty white figure, inches; it is laid out by itself and shares no state with others."""
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


def heading(figure: Figure, title: str, text: str) -> None:
    """Put a title above everything, and below it what the picture shows, in lines that are broken by hand."""
    height = figure.get_figheight()
    figure.text(
        0.1 / figure.get_figwidth(),
        1 - 0.08 / height,
        title,
        va="top",
        fontsize=13,
        fontweight="bold",
        color=INK,
    )
    figure.text(
        0.1 / figure.get_figwidth(),
        1 - 0.36 / height,
        text,
        va="top",
        fontsize=8.5,
        color=SOFT_INK,
        linespacing=1.35,
    )
    engine = figure.get_layout_engine()
    assert isinstance(engine, ConstrainedLayoutEngine)
    engine.set(rect=(0, 0, 1, 1 - (0.48 + 0.16 * len(text.splitlines())) / height))


def save(figure: Figure, path: Path) -> Path:
    """Write a picture whole; the same figure gives the same bytes."""
    with replace_whole(path) as unfinished:
        figure.savefig(unfinished, format="png", dpi=DPI, metadata={"Software": None})
    return path


def save_text(text: str, path: Path) -> Path:
    """Write a text whole."""
    with write_whole(path) as file:
        file.write(text.encode())
    return path


def per_cent(share: float) -> str:
    """Return a share in whole per cent; what is not quite 0 or 1 does not become 0 or 100."""
    rounded = round(100 * share)
    if rounded == 100 and share < 1:
        return ">99 %"
    return "<1 %" if rounded == 0 and share > 0 else f"{rounded} %"
