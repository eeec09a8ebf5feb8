"""Figure 7 of the paper: coverage against moves on larger grids, moves to 99 %.

All policies play the same terrains. `jobs` lists what is played, `draw` makes the pictures from the
results:

    figure7-coverage.svg  coverage against moves: a panel for each level and size
    figure7-steps.svg     moves to 99 %, and the share of them that the last per cents take
    figure7-shares.svg    moves to 50, 75, 90, 95 and 99 %, relative to a rule; only if that rule
                          played
    figure7.md            the same numbers as tables
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from marsexplorer.config import LEVELS, EnvConfig
from marsexplorer.evaluation import RULES
from marsexplorer.intervals import t_quantile
from research.informed.informed import INFORMED
from research.paper.episodes.play import EPISODES, can_play, read_results, with_own_names
from research.paper.episodes.scale import (
    KNEE,
    PER_CENT,
    Coverage,
    compare,
    group_by_place,
    scale_rows,
    steps_of,
)
from research.paper.figures.drawing import (
    SOFT_INK,
    colours_of,
    draw_interval,
    heading,
    in_order,
    legend,
    line_of,
    new_figure,
    plain,
    save,
    shade_rows,
    sorted_lines,
)
from research.paper.jobs import Job, Line, write_text
from research.paper.tables import Estimate, markdown_table, per_cent

FIGURE = 7
WIDTH = 9.6
"""Of every picture, inches."""
POLICIES = ("ppo", *RULES, INFORMED)
"""The policies that are drawn unless others are named."""

PLACES = ("random", "2-2-1")
"""Levels: ours, and the paper's."""

SIZES = (21, 42, 84)
"""Sides; the paper has 42 and 84."""

SHOWN_SHARE = 0.97
"""Share of all episodes that have ended at the right edge of a panel."""

REFERENCE = "frontier-cost"
"""The rule that moves to a share are relative to."""

CONSTANT_PACE = (99 - KNEE) / 99
"""Share of the last per cents where coverage grows at a constant pace."""
INTERVAL = (2, 5, 0.6)
DOTTED = (0, (1, 2))


def jobs(
    policies: Sequence[str] = POLICIES,
    levels: Sequence[str] = PLACES,
    sizes: Sequence[int] = SIZES,
    episodes: int = EPISODES,
) -> list[Job]:
    """The jobs of the figure: each policy on each level and size that it can play.

    Args:
        policies: Names or paths; "informed" stands for the search that is shown the true map.
        levels: Names in LEVELS.
        sizes: Sides of square grids, cells.
        episodes: Of each policy on each level and size.

    Raises:
        PolicyNotFoundError: If there is no such policy.
        PolicyFileError: If a policy's file cannot be played.
        ValueError: If two policies have the same name.
    """
    plays = [
        Coverage(policy, level, size, episodes)
        for size in sizes
        for level in levels
        for policy in policies
        if can_play(policy, EnvConfig.of(level, size))
    ]
    return [*with_own_names(plays)]


def draw(results: Path, pictures: Path) -> list[Path]:
    """Draw the pictures and write the table from a folder's results; return the paths.

    FileNotFoundError when the folder has no results of the figure.
    """
    lines = sorted_lines(read_results(results, FIGURE))
    text = write_text(pictures / "figure7.md", f"{table(lines)}\n\n{shares_table(lines)}\n")
    drawn = {"coverage": coverage_figure(lines), "steps": steps_figure(lines)}
    if any(line["policy"] == REFERENCE for line in lines):
        drawn["shares"] = shares_figure(lines)
    return [
        *(save(figure, pictures / f"figure7-{name}.svg") for name, figure in drawn.items()),
        text,
    ]


def coverage_figure(lines: Sequence[Line]) -> Figure:
    """Draw each policy's mean coverage with its interval, a panel a level and size."""
    figure, panels = _panels(lines, 2.6, 1.3, "moves")
    colours = colours_of(line["policy"] for line in lines)
    for axes, group in panels:
        edge = _right_edge([*group.values()])
        for (policy, line), width in zip(
            group.items(), np.linspace(3.2, 0.8, len(group)), strict=True
        ):
            _draw_curve(axes, line, colours[policy], float(width), edge)
        axes.axhline(99, color=SOFT_INK, linewidth=0.8, linestyle=DOTTED)
        axes.set(xlim=(0, edge), ylim=(0, 102))
        axes.yaxis.set_major_formatter(lambda share, _: f"{share:.0f} %")
    _legend(figure, in_order(line["policy"] for line in lines))
    heading(
        figure,
        "Coverage against moves",
        f"Mean over {lines[0]['episodes']} held-out terrains, the same for all; an episode keeps what it had at its end.\n"
        "Band: 95 % interval of the mean. Dotted: 99 %. Lines that lie upon each other are of different widths.",
    )
    return figure


def steps_figure(lines: Sequence[Line]) -> Figure:
    """Draw the moves to 99 % and the share of the last per cents, a column a size."""
    levels, sizes = _places(lines)
    policies = in_order(line["policy"] for line in lines)
    colours = colours_of(policies)
    figure = new_figure(WIDTH, 0.2 * len(levels) * (len(policies) + 1) * 2 + 2.2)
    panels = figure.subplots(2, len(sizes), squeeze=False, sharey=True)
    for size, steps, shares in zip(sizes, *panels, strict=True):
        for row in (row for row in scale_rows(lines) if row.size == size):
            aside = policies.index(row.policy) - (len(policies) - 1) / 2
            at = levels.index(row.level) + aside * 0.8 / len(policies)
            for axes, estimate in ((steps, row.steps), (shares, row.last_share)):
                draw_interval(axes, estimate, at, "o", colours[row.policy], INTERVAL)
        shares.axvline(CONSTANT_PACE, color=SOFT_INK, linewidth=0.8, linestyle=DOTTED)
        plain(steps, f"{size} x {size}: moves to 99 % (logarithmic)")
        plain(shares, f"{size} x {size}: share from {KNEE} % on")
        for axes in (steps, shares):
            shade_rows(axes, len(levels))
        steps.set_xscale("log")
        steps.xaxis.set_major_locator(LogLocator(10, (1, 1.5, 2, 3, 5, 7)))
        steps.xaxis.set_major_formatter(lambda moves, _: f"{moves:,.0f}")
        steps.xaxis.set_minor_locator(NullLocator())
        shares.set(xlim=(0, 0.62))
        shares.xaxis.set_major_formatter(lambda share, _: per_cent(share))
        steps.set_yticks(range(len(levels)), [f"level {level}" for level in levels])
    panels[0][0].set_ylim(len(levels) - 0.5, -0.5)
    _legend(figure, policies)
    heading(
        figure,
        "Moves to 99 %, and the knee",
        "Means over terrains with their 95 % intervals; an episode that ends otherwise counts the limit.\n"
        f"Below, for episodes that reach 99 %, the share of their moves made after {KNEE} % were known. "
        f"Dotted: {per_cent(CONSTANT_PACE)}, a constant pace.",
    )
    return figure


def shares_figure(lines: Sequence[Line]) -> Figure:
    """Draw the moves to each share of PER_CENT over those of REFERENCE.

    A panel for each level and size.
    """
    figure, panels = _panels(lines, 2.4, 1.5, "coverage")
    names = in_order(line["policy"] for line in lines)
    policies = [name for name in names if name != REFERENCE]
    colours = colours_of(names)
    for axes, group in panels:
        for policy in (name for name in group if name != REFERENCE):
            # intervals do not cover each other
            aside = 0.08 * (policies.index(policy) - (len(policies) - 1) / 2)
            ratios = [compare(group[policy], group.get(REFERENCE), share) for share in PER_CENT]
            by_place = {at + aside: ratio for at, ratio in enumerate(ratios) if ratio.is_known}
            _draw_ratios(axes, by_place, policy, colours[policy])
        axes.axhline(1, color=colours[REFERENCE], linewidth=1.5)
        axes.set_xticks(range(len(PER_CENT)), [f"{share} %" for share in PER_CENT])
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(10, (0.5, 0.7, 1, 1.5, 2, 3, 4)))
        axes.yaxis.set_major_formatter(lambda ratio, _: f"{ratio:.3g}")
        axes.yaxis.set_minor_locator(NullLocator())
    _legend(figure, [*policies, REFERENCE])
    heading(
        figure,
        f"Moves to a share of the cells, over those of {REFERENCE}",
        "Ratios of means on the same terrains with their 95 % intervals, logarithmic. Below the line: fewer moves.",
    )
    return figure


def table(lines: Sequence[Line]) -> str:
    """The numbers as a table in Markdown."""
    rows = [
        [
            *(row.policy, row.level, str(row.size), str(row.terrains), per_cent(row.completion)),
            *(row.steps.span("{:.1f}"), row.to_rule.span("{:.3f}"), row.to_informed.span("{:.3f}")),
            row.last_share.percent(1),
        ]
        for row in scale_rows(lines)
    ]
    moves = ("moves to 99 %", "to rule", "to informed", "from 90 % on")
    return markdown_table(("policy", "level", "size", "terrains", "explored", *moves), rows)


def shares_table(lines: Sequence[Line]) -> str:
    """The mean moves to each share, and their ratio to REFERENCE's, as Markdown."""
    rows = []
    for (level, size), group in group_by_place(lines).items():
        for policy, line in group.items():
            cells = [_share_text(line, group.get(REFERENCE), share) for share in PER_CENT]
            rows.append([policy, level, str(size), *cells])
    return markdown_table(("policy", "level", "size", *(f"{share} %" for share in PER_CENT)), rows)


def _share_text(line: Line, reference: Line | None, share: int) -> str:
    moves = f"{np.nanmean(steps_of(line, share)):.1f}"
    if line["policy"] == REFERENCE or reference is None:
        return moves
    return f"{moves}: {compare(line, reference, share).span('{:.2f}')}"


def _places(lines: Sequence[Line]) -> tuple[list[str], list[int]]:
    """The levels of some results in the order of LEVELS, and the sizes."""
    levels = {line["level"] for line in lines}
    return [level for level in LEVELS if level in levels], sorted({line["rows"] for line in lines})


def _panels(
    lines: Sequence[Line], height: float, rest: float, xlabel: str
) -> tuple[Figure, list[tuple[Axes, dict[str, Line]]]]:
    """A figure with a panel a level and size, and the panels with results, by policy.

    height  of a row of panels, and rest: of what is above and below, inches
    """
    levels, sizes = _places(lines)
    places, filled = group_by_place(lines), []
    figure = new_figure(WIDTH, height * len(levels) + rest)
    panels = figure.subplots(len(levels), len(sizes), squeeze=False, sharey=True)
    for level, row in zip(levels, panels, strict=True):
        for size, axes in zip(sizes, row, strict=True):
            plain(axes, f"level {level}, {size} x {size}")
            if (level, size) in places:
                filled.append((axes, places[level, size]))
            else:
                _leave_empty(axes)
    for axes in panels[-1]:
        axes.set_xlabel(xlabel)
    return figure, filled


def _leave_empty(axes: Axes) -> None:
    """Write in a panel that there are no results for it."""
    style: dict[str, Any] = {"ha": "center", "fontsize": 8.5, "color": SOFT_INK}
    axes.text(0.5, 0.5, "no results here", transform=axes.transAxes, **style)
    axes.set_xticks([])
    axes.grid(visible=False)


def _draw_curve(axes: Axes, line: Line, colour: str, width: float, edge: float) -> None:
    mean, sd = (100 * np.array([*line[name], line[name][-1]]) for name in ("mean", "sd"))
    moves = line["stride"] * np.arange(len(mean))
    moves[-1] = 10 * moves[-2] + 1
    end = int(np.searchsorted(moves, edge)) + 1
    step = max(1, end // 80)
    shown = np.append(np.arange(0, end, step), min(end, len(moves) - 1))
    moves, mean, sd = moves[shown], mean[shown], sd[shown]
    half = sd * t_quantile(line["played"] - 1) / np.sqrt(line["played"])
    high = np.minimum(mean + half, 100)
    axes.fill_between(moves, mean - half, high, color=colour, alpha=0.2, linewidth=0)
    axes.plot(moves, mean, _style(line["policy"]), color=colour, linewidth=width)


def _draw_ratios(axes: Axes, ratios: dict[float, Estimate], policy: str, colour: str) -> None:
    """Draw a line through the ratios, each at its place, with their intervals."""
    lows, highs = ([getattr(ratio, end) for ratio in ratios.values()] for end in ("low", "high"))
    axes.vlines([*ratios], lows, highs, color=colour, linewidth=2)
    means = [ratio.mean for ratio in ratios.values()]
    axes.plot([*ratios], means, f"{_style(policy)}o", color=colour, markersize=4, linewidth=1.3)


def _style(policy: str) -> str:
    return "--" if policy == INFORMED else "-"


def _right_edge(lines: Sequence[Line]) -> float:
    """The moves at a panel's right edge, of policies that explore nearly all terrains."""
    steps = [
        steps_of(line)
        for line in lines
        if line["outcomes"].get("explored", 0) >= 0.9 * line["played"]
    ]
    all_steps = np.concatenate(steps) if steps else np.array([1.0])
    return float(np.nanquantile(all_steps, SHOWN_SHARE))


def _legend(figure: Figure, policies: Sequence[str]) -> None:
    colours = colours_of(policies)
    names = {INFORMED: "informed search (shown the true map)"}
    handles = [
        line_of(names.get(policy, policy), colours[policy], linestyle=_style(policy), linewidth=2)
        for policy in policies
    ]
    legend(figure, handles, min(6, len(policies)), "left")
