"""Figure 7 of the paper: coverage against moves on larger grids, and the moves to 99 %, for all policies on the same terrains.

`jobs` says what is played, `draw` makes the pictures from the results alone:

    figure7-coverage.png  coverage against moves: a panel for each level and size
    figure7-steps.png     moves to 99 %, and the share of them that the last per cents take
    figure7.md            the same numbers as a table
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from marsexplorer.config import LEVELS, EnvConfig
from marsexplorer.evaluation import INFORMED, RULES
from marsexplorer.evaluation.intervals import t_quantile
from marsexplorer.paper.drawing import (
    INK,
    SOFT_INK,
    colours_of,
    heading,
    in_order,
    new_figure,
    per_cent,
    plain,
    save,
    save_text,
)
from marsexplorer.paper.gathered import read_results
from marsexplorer.paper.job import Job
from marsexplorer.paper.play import EPISODES, Line, can_play
from marsexplorer.paper.scale import KNEE, Coverage, Estimate, group_by_place, scale_rows, steps_of

FIGURE = 7
POLICIES = ("ppo", *RULES, INFORMED)
"""What is drawn unless others are named."""

PLACES = ("random", "2-2-1")
"""Levels: ours, and the paper's."""

SIZES = (21, 42, 84)
"""Sides; the paper has 42 and 84."""

SHOWN_SHARE = 0.97
"""Share of all episodes that have ended at the right edge of a panel."""

CONSTANT_PACE = (99 - KNEE) / 99
"""Share of the last per cents where coverage grows at a constant pace."""


def jobs(
    policies: Sequence[str] = POLICIES,
    levels: Sequence[str] = PLACES,
    sizes: Sequence[int] = SIZES,
    episodes: int = EPISODES,
) -> list[Job]:
    """Return the jobs of the figure: each policy on each level and size that it can play.

    policies  names or paths; "informed" stands for the search that is shown the true map

    PolicyNotFoundError and PolicyFileError for policies that cannot be loaded, ValueError when two have the same name.
    """
    plays = [
        Coverage(policy, level, size, episodes)
        for size in sizes
        for level in levels
        for policy in policies
        if can_play(policy, EnvConfig.of(level, size))
    ]
    if len({play.name for play in plays}) < len(plays):
        raise ValueError(f"each policy needs a name of its own, got {', '.join(policies)}")
    return list(plays)


def draw(results: Path, pictures: Path | None = None) -> list[Path]:
    """Draw the pictures and write the table from the results in a folder, into another or the same; return their paths.

    FileNotFoundError when the folder has no results of the figure.
    """
    pictures = pictures or results
    pictures.mkdir(parents=True, exist_ok=True)
    lines = read_results(results, FIGURE)
    return [
        save(coverage_figure(lines), pictures / "figure7-coverage.png"),
        save(steps_figure(lines), pictures / "figure7-steps.png"),
        save_text(table(lines), pictures / "figure7.md"),
    ]


def coverage_figure(lines: Sequence[Line]) -> Figure:
    """Draw each policy's mean coverage, its 95 % interval and one standard deviation, a panel for each level and size."""
    places, levels, sizes = _places(lines)
    policies = in_order([line["policy"] for line in lines])
    colours = colours_of(policies)
    figure = new_figure(3.5 * len(sizes) + 0.3, 2.75 * len(levels) + 1.25)
    panels = figure.subplots(len(levels), len(sizes), squeeze=False, sharey=True)
    for level, row in zip(levels, panels, strict=True):
        for size, axes in zip(sizes, row, strict=True):
            group = places.get((level, size), {})
            for policy in (each for each in policies if each in group):
                _draw_curve(axes, group[policy], colours[policy])
            axes.axhline(99, color=SOFT_INK, linewidth=0.8, linestyle=(0, (1, 2)))
            plain(axes, f"level {level}, {size} x {size}")
            axes.set(xlim=(0, _right_edge(list(group.values()))), ylim=(0, 102))
            axes.yaxis.set_major_formatter(lambda value, _: f"{value:.0f} %")
    figure.supxlabel("moves", fontsize=8.5, color=SOFT_INK)
    _legend(figure, policies, colours)
    heading(
        figure,
        "Coverage against moves",
        f"Mean over {lines[0]['episodes']} held-out terrains, the same for all. Dark band: 95 % interval of the mean. "
        "Light band: one standard deviation. Dotted: 99 %.",
    )
    return figure


def steps_figure(lines: Sequence[Line]) -> Figure:
    """Draw the moves to 99 % and the share of the last per cents, a column for each size."""
    rows = scale_rows(lines)
    _, levels, sizes = _places(lines)
    policies = in_order([row.policy for row in rows])
    colours = colours_of(policies)
    figure = new_figure(3.5 * len(sizes) + 0.3, 0.17 * len(levels) * len(policies) * 2 + 2.6)
    panels = figure.subplots(2, len(sizes), squeeze=False, sharey=True)
    for size, steps, shares in zip(sizes, *panels, strict=True):
        for row in (each for each in rows if each.size == size):
            at = levels.index(row.level) + (policies.index(row.policy) - (len(policies) - 1) / 2) * 0.8 / len(policies)
            _draw_estimate(steps, row.steps, at, colours[row.policy])
            _draw_estimate(shares, row.last_share, at, colours[row.policy])
        shares.axvline(CONSTANT_PACE, color=SOFT_INK, linewidth=0.8, linestyle=(0, (1, 2)))
        plain(steps, f"{size} x {size}: moves to 99 %")
        plain(shares, f"{size} x {size}: share from {KNEE} % on")
        steps.set_xlim(left=0)
        shares.set(xlim=(0, 0.62))
        shares.xaxis.set_major_formatter(lambda value, _: f"{100 * value:.0f} %")
        steps.set_yticks(range(len(levels)), [f"level {level}" for level in levels])
    panels[0][0].set_ylim(len(levels) - 0.5, -0.5)
    _legend(figure, policies, colours)
    heading(
        figure,
        "Moves to 99 %, and the knee",
        f"Means over terrains with 95 % intervals. Below: the share of the moves to 99 % made after {KNEE} % are known. "
        f"Dotted: {per_cent(CONSTANT_PACE)}, a constant pace.",
    )
    return figure


def table(lines: Sequence[Line]) -> str:
    """Return the numbers as a table in Markdown."""
    text = "| policy | level | size | terrains | explored | moves to 99 % | to rule | to informed | from 90 % on |\n"
    text += "|---|---|---|---|---|---|---|---|---|\n"
    names, policies = list(LEVELS), in_order([line["policy"] for line in lines])
    for row in sorted(scale_rows(lines), key=lambda row: (row.size, names.index(row.level), policies.index(row.policy))):
        ratios = " | ".join(_estimate_text(each, "{:.3f}") for each in (row.to_rule, row.to_informed))
        text += f"| {row.policy} | {row.level} | {row.size} | {row.terrains} | {per_cent(row.completion)} | "
        text += f"{_estimate_text(row.steps, '{:.1f}')} | {ratios} | {_estimate_text(row.last_share, '{:.1%}')} |\n"
    return text


def _places(lines: Sequence[Line]) -> tuple[dict[tuple[str, int], dict[str, Line]], list[str], list[int]]:
    """Return the results by level and size, the levels in the order of LEVELS, and the sizes."""
    groups = group_by_place(lines)
    levels = [level for level in LEVELS if any(place[0] == level for place in groups)]
    return groups, levels, sorted({size for _, size in groups})


def _estimate_text(estimate: Estimate | None, form: str) -> str:
    if estimate is None:
        return ""
    mean, low, high = (form.format(each) for each in (estimate.mean, estimate.low, estimate.high))
    return mean if low == high else f"{mean} ({low} to {high})"


def _draw_curve(axes: Axes, line: Line, colour: str) -> None:
    mean, sd = 100 * np.array(line["mean"]), 100 * np.array(line["sd"])
    moves = line["stride"] * np.arange(len(mean))
    moves, mean, sd = (np.append(each, end) for each, end in ((moves, 10 * moves[-1] + 1), (mean, mean[-1]), (sd, sd[-1])))
    half = sd * t_quantile(line["played"] - 1) / np.sqrt(line["played"])
    for width, alpha in ((sd, 0.10), (half, 0.28)):
        axes.fill_between(moves, mean - width, mean + width, color=colour, alpha=alpha, linewidth=0)
    axes.plot(moves, mean, color=colour, linewidth=1.5, linestyle="--" if line["policy"] == INFORMED else "-")


def _draw_estimate(axes: Axes, estimate: Estimate | None, at: float, colour: str) -> None:
    if estimate is not None:
        axes.plot([estimate.low, estimate.high], [at, at], color=colour, linewidth=2, solid_capstyle="round")
        axes.plot(estimate.mean, at, "o", color=colour, markersize=5, markeredgecolor="white", markeredgewidth=0.6)


def _right_edge(lines: Sequence[Line]) -> float:
    """Return the moves at the right edge of a panel, of the policies that explore at least half of their terrains."""
    steps = [steps_of(line) for line in lines if 2 * line["outcomes"].get("explored", 0) >= line["played"]]
    found = np.concatenate(steps) if steps else np.array([1.0])
    return float(np.nanquantile(found, SHOWN_SHARE))


def _legend(figure: Figure, policies: Sequence[str], colours: dict[str, str]) -> None:
    axes = figure.axes[0]
    for policy in policies:
        name = "informed search (shown the true map)" if policy == INFORMED else policy
        axes.plot([], [], "--" if policy == INFORMED else "-", color=colours[policy], linewidth=2, label=name)
    figure.legend(loc="outside lower left", ncols=min(6, len(policies)), frameon=False, fontsize=8.5, labelcolor=INK)
