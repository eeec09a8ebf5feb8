"""Figure 7 of the paper: coverage against moves on larger grids, and the moves to 99 %, for all policies on the same terrains.

`jobs` says what is played, `draw` makes the pictures from the results alone:

    figure7-coverage.png  coverage against moves: a panel for each level and size
    figure7-steps.png     moves to 99 %, and the share of them that the last per cents take
    figure7-shares.png    moves to 50, 75, 90, 95 and 99 %, relative to a rule; without that rule there is no such picture
    figure7.md            the same numbers as tables
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from marsexplorer.config import LEVELS, EnvConfig
from marsexplorer.evaluation import RULES
from marsexplorer.evaluation.intervals import t_quantile
from research.informed import INFORMED
from research.paper.episodes.play import EPISODES, Line, can_play, read_results
from research.paper.episodes.scale import (
    KNEE,
    PER_CENT,
    Coverage,
    Estimate,
    compare,
    group_by_place,
    scale_rows,
    steps_of,
)
from research.paper.figures.drawing import (
    INK,
    SAND,
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
from research.paper.jobs import Job

FIGURE = 7
WIDTH = 9.6
"""Of every picture, inches."""
POLICIES = ("ppo", *RULES, INFORMED)
"""What is drawn unless others are named."""

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
    drawn = [
        save(coverage_figure(lines), pictures / "figure7-coverage.png"),
        save(steps_figure(lines), pictures / "figure7-steps.png"),
    ]
    if any(line["policy"] == REFERENCE for line in lines):
        drawn.append(save(shares_figure(lines), pictures / "figure7-shares.png"))
    return [*drawn, save_text(f"{table(lines)}\n{shares_table(lines)}", pictures / "figure7.md")]


def coverage_figure(lines: Sequence[Line]) -> Figure:
    """Draw each policy's mean coverage, its 95 % interval and one standard deviation, a panel for each level and size."""
    places, levels, sizes = _places(lines)
    policies = in_order([line["policy"] for line in lines])
    colours = colours_of(policies)
    figure = new_figure(WIDTH, 2.6 * len(levels) + 1.3)
    panels = figure.subplots(len(levels), len(sizes), squeeze=False, sharey=True)
    for level, row in zip(levels, panels, strict=True):
        for size, axes in zip(sizes, row, strict=True):
            group = places.get((level, size), {})
            for policy in (each for each in policies if each in group):
                _draw_curve(axes, group[policy], colours[policy])
            plain(axes, f"level {level}, {size} x {size}")
            if not group:
                _leave_empty(axes)
                continue
            axes.axhline(99, color=SOFT_INK, linewidth=0.8, linestyle=(0, (1, 2)))
            axes.set(xlim=(0, _right_edge(list(group.values()))), ylim=(0, 102))
            axes.yaxis.set_major_formatter(lambda value, _: f"{value:.0f} %")
    for axes in panels[-1]:
        axes.set_xlabel("moves")
    _legend(figure, policies, colours)
    heading(
        figure,
        "Coverage against moves",
        f"Mean over {lines[0]['episodes']} held-out terrains, the same for all; an episode keeps what it had at its end.\n"
        "Dark band: 95 % interval of the mean. Light band: one standard deviation. Dotted: 99 %.",
    )
    return figure


def steps_figure(lines: Sequence[Line]) -> Figure:
    """Draw the moves to 99 % and the share of the last per cents, a column for each size."""
    rows = scale_rows(lines)
    _, levels, sizes = _places(lines)
    policies = in_order([row.policy for row in rows])
    colours = colours_of(policies)
    figure = new_figure(WIDTH, 0.2 * len(levels) * (len(policies) + 1) * 2 + 2.2)
    panels = figure.subplots(2, len(sizes), squeeze=False, sharey=True)
    for size, steps, shares in zip(sizes, *panels, strict=True):
        for row in (each for each in rows if each.size == size):
            at = levels.index(row.level) + (
                policies.index(row.policy) - (len(policies) - 1) / 2
            ) * 0.8 / len(policies)
            _draw_estimate(steps, row.steps, at, colours[row.policy])
            _draw_estimate(shares, row.last_share, at, colours[row.policy])
        shares.axvline(CONSTANT_PACE, color=SOFT_INK, linewidth=0.8, linestyle=(0, (1, 2)))
        plain(steps, f"{size} x {size}: moves to 99 %")
        plain(shares, f"{size} x {size}: share from {KNEE} % on")
        for axes in (steps, shares):
            axes.grid(visible=False, axis="y")
            for number in range(0, len(levels), 2):
                axes.axhspan(number - 0.5, number + 0.5, color=SAND, zorder=0, linewidth=0)
        steps.set_xlim(left=0)
        shares.set(xlim=(0, 0.62))
        shares.xaxis.set_major_formatter(lambda value, _: f"{100 * value:.0f} %")
        steps.set_yticks(range(len(levels)), [f"level {level}" for level in levels])
    panels[0][0].set_ylim(len(levels) - 0.5, -0.5)
    _legend(figure, policies, colours)
    heading(
        figure,
        "Moves to 99 %, and the knee",
        "Means over terrains with their 95 % intervals; an episode that ends otherwise counts the limit.\n"
        f"Below, for episodes that reach 99 %, the share of their moves made after {KNEE} % were known. "
        f"Dotted: {per_cent(CONSTANT_PACE)}, a constant pace.",
    )
    return figure


def shares_figure(lines: Sequence[Line]) -> Figure:
    """Draw the moves to each share of PER_CENT over those of REFERENCE, a panel for each level and size."""
    places, levels, sizes = _places(lines)
    policies = [
        policy for policy in in_order([line["policy"] for line in lines]) if policy != REFERENCE
    ]
    colours = colours_of([*policies, REFERENCE])
    figure = new_figure(WIDTH, 2.4 * len(levels) + 1.5)
    panels = figure.subplots(len(levels), len(sizes), squeeze=False, sharey=True)
    for level, row in zip(levels, panels, strict=True):
        for size, axes in zip(sizes, row, strict=True):
            group = places.get((level, size), {})
            for policy in (each for each in policies if each in group):
                aside = 0.08 * (
                    policies.index(policy) - (len(policies) - 1) / 2
                )  # intervals do not cover each other
                found = (
                    (at, compare(group[policy], group.get(REFERENCE), share))
                    for at, share in enumerate(PER_CENT)
                )
                ratios = [(at + aside, ratio) for at, ratio in found]
                _draw_ratios(
                    axes,
                    [(at, ratio) for at, ratio in ratios if ratio is not None],
                    policy,
                    colours[policy],
                )
            plain(axes, f"level {level}, {size} x {size}")
            if not group:
                _leave_empty(axes)
                continue
            axes.axhline(1, color=colours[REFERENCE], linewidth=1.5)
            axes.set_xticks(range(len(PER_CENT)), [f"{share} %" for share in PER_CENT])
    for axes in panels[-1]:
        axes.set_xlabel("coverage")
    _legend(figure, [*policies, REFERENCE], colours)
    heading(
        figure,
        f"Moves to a share of the cells, over those of {REFERENCE}",
        "Ratios of means on the same terrains with their 95 % intervals. Below the line: fewer moves.",
    )
    return figure


def table(lines: Sequence[Line]) -> str:
    """Return the numbers as a table in Markdown."""
    text = "| policy | level | size | terrains | explored | moves to 99 % | to rule | to informed | from 90 % on |\n"
    text += "|---|---|---|---|---|---|---|---|---|\n"
    names, policies = list(LEVELS), in_order([line["policy"] for line in lines])
    for row in sorted(
        scale_rows(lines),
        key=lambda row: (row.size, names.index(row.level), policies.index(row.policy)),
    ):
        ratios = " | ".join(
            _estimate_text(each, "{:.3f}") for each in (row.to_rule, row.to_informed)
        )
        text += f"| {row.policy} | {row.level} | {row.size} | {row.terrains} | {per_cent(row.completion)} | "
        text += f"{_estimate_text(row.steps, '{:.1f}')} | {ratios} | {_estimate_text(row.last_share, '{:.1%}')} |\n"
    return text


def shares_table(lines: Sequence[Line]) -> str:
    """Return the mean moves to each share of PER_CENT, and their ratio to those of REFERENCE, as a table in Markdown."""
    text = f"| policy | level | size | {' | '.join(f'{share} %' for share in PER_CENT)} |\n"
    text += f"|---|---|---|{'---|' * len(PER_CENT)}\n"
    places, levels, sizes = _places(lines)
    policies = in_order([line["policy"] for line in lines])
    for size in sizes:
        for level in levels:
            group = places.get((level, size), {})
            for policy in (each for each in policies if each in group):
                text += f"| {policy} | {level} | {size} | "
                text += (
                    " | ".join(
                        _share_text(group[policy], group.get(REFERENCE), share)
                        for share in PER_CENT
                    )
                    + " |\n"
                )
    return text


def _share_text(line: Line, reference: Line | None, share: int) -> str:
    moves = f"{np.nanmean(steps_of(line, share)):.1f}"
    if line["policy"] == REFERENCE or reference is None:
        return moves
    return f"{moves}: {_estimate_text(compare(line, reference, share), '{:.2f}')}"


def _places(
    lines: Sequence[Line],
) -> tuple[dict[tuple[str, int], dict[str, Line]], list[str], list[int]]:
    """Return the results by level and size, the levels in the order of LEVELS, and the sizes."""
    groups = group_by_place(lines)
    levels = [level for level in LEVELS if any(place[0] == level for place in groups)]
    return groups, levels, sorted({size for _, size in groups})


def _estimate_text(estimate: Estimate | None, form: str) -> str:
    if estimate is None:
        return ""
    mean, low, high = (form.format(each) for each in (estimate.mean, estimate.low, estimate.high))
    return mean if low == high else f"{mean} ({low} to {high})"


def _leave_empty(axes: Axes) -> None:
    """Say in a panel that there are no results for it."""
    axes.text(
        0.5,
        0.5,
        "no results here",
        transform=axes.transAxes,
        ha="center",
        fontsize=8.5,
        color=SOFT_INK,
    )
    axes.set_xticks([])
    axes.grid(visible=False)


def _draw_curve(axes: Axes, line: Line, colour: str) -> None:
    mean, sd = 100 * np.array(line["mean"]), 100 * np.array(line["sd"])
    moves = line["stride"] * np.arange(len(mean))
    moves, mean, sd = (
        np.append(each, end)
        for each, end in ((moves, 10 * moves[-1] + 1), (mean, mean[-1]), (sd, sd[-1]))
    )
    half = sd * t_quantile(line["played"] - 1) / np.sqrt(line["played"])
    for width, alpha in ((sd, 0.10), (half, 0.28)):
        axes.fill_between(
            moves,
            mean - width,
            np.minimum(mean + width, 100),
            color=colour,
            alpha=alpha,
            linewidth=0,
        )
    axes.plot(
        moves,
        mean,
        color=colour,
        linewidth=1.5,
        linestyle="--" if line["policy"] == INFORMED else "-",
    )


def _draw_estimate(axes: Axes, estimate: Estimate | None, at: float, colour: str) -> None:
    if estimate is not None:
        axes.plot(
            [estimate.low, estimate.high],
            [at, at],
            color=colour,
            linewidth=2,
            solid_capstyle="round",
        )
        axes.plot(
            estimate.mean,
            at,
            "o",
            color=colour,
            markersize=5,
            markeredgecolor="white",
            markeredgewidth=0.6,
        )


def _draw_ratios(
    axes: Axes, ratios: Sequence[tuple[float, Estimate]], policy: str, colour: str
) -> None:
    """Draw a line through the ratios, each at its place, with their intervals."""
    at, found = [place for place, _ in ratios], [ratio for _, ratio in ratios]
    means = [ratio.mean for ratio in found]
    axes.vlines(
        at,
        [ratio.low for ratio in found],
        [ratio.high for ratio in found],
        color=colour,
        linewidth=2,
    )
    axes.plot(
        at, means, "--o" if policy == INFORMED else "-o", color=colour, markersize=4, linewidth=1.3
    )


def _right_edge(lines: Sequence[Line]) -> float:
    """Return the moves at the right edge of a panel, of the policies that explore at least half of their terrains."""
    steps = [
        steps_of(line)
        for line in lines
        if 2 * line["outcomes"].get("explored", 0) >= line["played"]
    ]
    found = np.concatenate(steps) if steps else np.array([1.0])
    return float(np.nanquantile(found, SHOWN_SHARE))


def _legend(figure: Figure, policies: Sequence[str], colours: dict[str, str]) -> None:
    axes = figure.axes[0]
    for policy in policies:
        name = "informed search (shown the true map)" if policy == INFORMED else policy
        axes.plot(
            [],
            [],
            "--" if policy == INFORMED else "-",
            color=colours[policy],
            linewidth=2,
            label=name,
        )
    figure.legend(
        loc="outside lower left",
        ncols=min(6, len(policies)),
        frameon=False,
        fontsize=8.5,
        labelcolor=INK,
    )
