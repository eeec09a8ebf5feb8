"""Figure 6 of the paper: where policies go on the 12 levels, which obstacles they find, and whether they sweep in a U.

`jobs` says what is played, `draw` makes the pictures from the results alone:

    figure6-POLICY.png     a map for each level: blue cells for visits, green squares for obstacles found
    figure6-quadrants.png  how often each policy makes a U, and never goes back, beside the walks that nobody trained
    figure6.md             the same numbers as a table
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize, PowerNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from marsexplorer.config import LEVELS
from marsexplorer.evaluation import RULES
from research.paper.episodes.play import EPISODES, Line, can_play, read_results
from research.paper.episodes.quadrants import (
    Rate,
    Visits,
    course_rates,
    map_of,
    obstacles_of,
)
from research.paper.episodes.walks import NULLS, NullWalks
from research.paper.figures.drawing import (
    INK,
    LINE_COLOUR,
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

FIGURE = 6
POLICIES = ("ppo", "ppo-paper", *RULES)
"""What is drawn unless others are named."""

DIFFICULTIES = tuple(name for name in LEVELS if name != "random")
"""The 12 levels of section 3.3."""

LEVEL_PLACE = "{level}"
"""What stands for the level in the path of policies that were trained on one level each."""

BLUE, GREEN, RED = "#08306b", "#00692c", "#c1121f"
"""Of visits, obstacles, and blind spots; cells without anything are SAND."""


def jobs(
    policies: Sequence[str] = POLICIES,
    levels: Sequence[str] = DIFFICULTIES,
    episodes: int = EPISODES,
    size: int = 21,
) -> list[Job]:
    """Return the jobs of the figure: each policy on each level, and the walks of the null.

    policies  names or paths; "{level}" in a path stands for the level, for policies that were trained on one each

    PolicyNotFoundError and PolicyFileError for policies that cannot be loaded, ValueError when two have the same name or one
    does not take the size.
    """
    plays = []
    for policy in policies:
        for level in levels:
            label = (
                Path(policy.replace(f"-{LEVEL_PLACE}", "")).stem if LEVEL_PLACE in policy else ""
            )
            play = Visits(policy.replace(LEVEL_PLACE, level), level, size, episodes, label=label)
            if not can_play(play.policy, play.config):
                raise ValueError(
                    f"{policy} cannot play {size}x{size}; choose policies that can, or their size"
                )
            plays.append(play)
    if len({play.name for play in plays}) < len(plays):
        raise ValueError(f"each policy needs a name of its own, got {', '.join(policies)}")
    return [*plays, *(NullWalks(kind, size) for kind in NULLS)]


def draw(results: Path, pictures: Path | None = None) -> list[Path]:
    """Draw the pictures and write the table from the results in a folder, into another or the same; return their paths.

    FileNotFoundError when the folder has no results of the figure.
    """
    pictures = pictures or results
    pictures.mkdir(parents=True, exist_ok=True)
    lines = read_results(results, FIGURE)
    plays, nulls = (
        [line for line in lines if "policy" in line],
        [line for line in lines if "null" in line],
    )
    nulls.sort(key=lambda line: list(NULLS).index(line["null"]))
    policies = in_order([line["policy"] for line in plays])
    drawn = [
        save(heat_figure(_own(plays, policy)), pictures / f"figure6-{policy}.png")
        for policy in policies
    ]
    if plays:
        drawn.append(save(quadrants_figure(plays, nulls), pictures / "figure6-quadrants.png"))
    return [*drawn, save_text(table(plays, nulls), pictures / "figure6.md")]


def heat_figure(lines: Sequence[Line]) -> Figure:
    """Draw the maps of one policy, all on the same scales; levels on which it did the same share a panel."""
    groups = merge_levels(lines)
    own = {line["level"]: line for line in lines}
    columns = 4 if len(groups) > 6 else min(3, len(groups))
    if columns == 3:  # a row for each size of the obstacles
        groups = sorted(
            groups, key=lambda levels: (LEVELS[levels[0]].morphology, LEVELS[levels[0]].topology)
        )
    rows = -(-len(groups) // columns)
    panel = 9.6 / columns
    figure = new_figure(9.6, (panel + 0.38) * rows + 1.55)
    panels = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    visits, most_found = _visits_scale(lines), max(_most(lines, "found"), 1e-9)
    for axes, levels in zip(panels, groups, strict=False):
        _draw_maps(axes, own[levels[0]], levels, visits, (most_found, 72 * panel / 26))
    for axes in panels[len(groups) :]:
        axes.set_axis_off()
    _key_to_maps(figure, panels.tolist(), visits, (most_found, 72 * panel / 26))
    first = lines[0]
    heading(
        figure,
        f"Where {first['policy']} goes, and the obstacles that it finds",
        f"{first['episodes']} held-out terrains of each level, {first['rows']} x {first['cols']}; the rover starts in the "
        "north-west corner.\nLevels that differ in the bonus alone have the same terrains.",
    )
    return figure


def merge_levels(lines: Sequence[Line]) -> list[tuple[str, ...]]:
    """Return the levels of some results in groups: levels on the same terrains on which every policy did the same.

    That is so for every policy that is not trained for the level: the bonus changes no terrain.
    """
    groups: dict[tuple[int, int], list[str]] = {}
    for level in sorted({line["level"] for line in lines}, key=list(LEVELS).index):
        groups.setdefault((LEVELS[level].topology, LEVELS[level].morphology), []).append(level)
    merged: list[tuple[str, ...]] = []
    for levels in groups.values():
        done = {
            level: {line["policy"]: line["visits"] for line in lines if line["level"] == level}
            for level in levels
        }
        is_same = all(done[level] == done[levels[0]] for level in levels)
        merged += [tuple(levels)] if is_same else [(level,) for level in levels]
    return merged


def quadrants_figure(plays: Sequence[Line], nulls: Sequence[Line]) -> Figure:
    """Draw the rates of both measures for each level and policy, with the null in rows of its own below."""
    groups = merge_levels(plays)
    row_of = {levels[0]: number for number, levels in enumerate(groups)}
    policies = in_order([line["policy"] for line in plays])
    colours = colours_of(policies)
    figure = new_figure(9.6, 0.15 * len(groups) * (len(policies) + 1) + 0.3 * len(nulls) + 2.0)
    panels = figure.subplots(1, 2, sharey=True)
    null_rows = [len(groups) - 0.1 + 0.5 * number for number in range(len(nulls))]
    for axes, which, title in zip(
        panels, (0, 1), ("Visits the quadrants in a U", "A U, and never goes back"), strict=True
    ):
        for line in (each for each in plays if each["level"] in row_of):
            at = (
                row_of[line["level"]]
                + (policies.index(line["policy"]) + 0.5) / (len(policies) + 1)
                - 0.5
            )
            _draw_rate(axes, course_rates(line)[which], at, colours[line["policy"]])
        for at, line in zip(null_rows, nulls, strict=True):
            _draw_rate(axes, course_rates(line)[which], at, INK, "D")
        if nulls:
            axes.axhline(len(groups) - 0.5, color=SOFT_INK, linewidth=0.8)
        plain(axes, title)
        axes.grid(visible=False, axis="y")
        axes.set(xlim=(-0.03, 1.03), xlabel="share of episodes, with its 95 % interval")
        axes.xaxis.set_major_formatter(lambda value, _: f"{100 * value:.0f} %")
        for number in range(0, len(groups), 2):
            axes.axhspan(number - 0.5, number + 0.5, color=SAND, zorder=0, linewidth=0)
    panels[0].set_yticks(
        [*range(len(groups)), *null_rows],
        [*(_level_words(levels) for levels in groups), *(NULLS[line["null"]] for line in nulls)],
    )
    panels[0].set_ylim((null_rows or [len(groups) - 0.8])[-1] + 0.4, -0.6)
    for policy in policies:
        panels[0].plot([], [], "o", color=colours[policy], markersize=5, label=policy)
    if nulls:
        panels[0].plot(
            [],
            [],
            "D",
            color=INK,
            markersize=4,
            label="walks that nobody trained, without obstacles",
        )
    figure.legend(loc="outside lower left", ncols=5, frameon=False, fontsize=8.5, labelcolor=INK)
    heading(figure, "The first order of the Hilbert curve", _explanation(plays))
    return figure


def table(plays: Sequence[Line], nulls: Sequence[Line]) -> str:
    """Return the numbers as a table in Markdown."""
    text = "| walk | level | explored | moves | U | U without going back | obstacles found | distance | blind spots |\n"
    text += "|---|---|---|---|---|---|---|---|---|\n"
    for policy in in_order([line["policy"] for line in plays]):
        for line in _own(plays, policy):
            found = obstacles_of(line)
            explored = line["outcomes"].get("explored", 0) / line["played"]
            rates = " | ".join(map(_rate_text, course_rates(line)))
            text += f"| {policy} | {line['level']} | {per_cent(explored)} | {line['steps']:.1f} | {rates} | "
            text += f"{100 * found.found_share:.1f} % | {found.distance:.3f} | {len(found.blind_spots)} |\n"
    for line in nulls:
        moves = "" if line["moves"] is None else f"{line['moves']:.1f}"
        text += f"| {NULLS[line['null']]} | none | | {moves} | {' | '.join(map(_rate_text, course_rates(line)))} | | | |\n"
    return text


def _own(lines: Sequence[Line], policy: str) -> list[Line]:
    """Return the results of a policy in the order of the levels."""
    names = list(LEVELS)
    return sorted(
        (line for line in lines if line["policy"] == policy),
        key=lambda line: names.index(line["level"]),
    )


def _level_words(levels: Sequence[str]) -> str:
    return f"level {levels[0]}" if len(levels) == 1 else f"levels {', '.join(levels)}"


def _explanation(plays: Sequence[Line]) -> str:
    return (
        f"{plays[0]['episodes']} held-out terrains of each level. A U goes from the start's quadrant to a neighbour, to the "
        "opposite one, to the last.\nA walk that enters each quadrant once can hardly do anything else: there are two such "
        "orders, and both are a U."
    )


def _rate_text(rate: Rate) -> str:
    if rate.low == rate.share == rate.high:
        return f"{100 * rate.share:.1f} % (all {rate.total})"
    return f"{100 * rate.share:.1f} % ({100 * rate.low:.1f} to {100 * rate.high:.1f})"


def _draw_rate(axes: Axes, rate: Rate, at: float, colour: str, marker: str = "o") -> None:
    axes.plot([rate.low, rate.high], [at, at], color=colour, linewidth=1.4, solid_capstyle="round")
    axes.plot(
        rate.share,
        at,
        marker,
        color=colour,
        markersize=4.5,
        markeredgecolor="white",
        markeredgewidth=0.5,
    )


def _most(lines: Sequence[Line], name: str) -> float:
    """Return the largest count of a map, per episode."""
    return float(max(map_of(line, name).max() / max(1, line["played"]) for line in lines))


def _visits_scale(lines: Sequence[Line]) -> PowerNorm:
    """Return a scale for visits per episode that keeps seldom visited cells visible."""
    return PowerNorm(0.6, 0, max(_most(lines, "visits"), 1e-9))


def _fading() -> Colormap:
    """Return the colours of visits, from those of a cell without any."""
    return LinearSegmentedColormap.from_list("visits", [SAND, "#9db8d9", "#3f6fb0", BLUE])


def _draw_maps(
    axes: Axes, line: Line, levels: Sequence[str], visits: Normalize, size: tuple[float, float]
) -> None:
    """Draw visits as cells, obstacles found as squares on them, the borders of the quadrants, and a cross on a blind spot.

    size  the most obstacles found on a cell, per episode, and the side of their square in points
    """
    rows, cols, played = line["rows"], line["cols"], max(1, line["played"])
    obstacles = obstacles_of(line)
    axes.imshow(
        map_of(line, "visits") / played, cmap=_fading(), norm=visits, interpolation="nearest"
    )
    found = map_of(line, "found") / played
    row, col = np.nonzero(found)
    _draw_squares(axes, col, row, found[row, col], size)
    axes.axhline(rows / 2 - 0.5, color=INK, linewidth=0.5, linestyle=(0, (2, 3)))
    axes.axvline(cols / 2 - 0.5, color=INK, linewidth=0.5, linestyle=(0, (2, 3)))
    if obstacles.blind_spots:
        row, col = np.divmod(np.array(obstacles.blind_spots), cols)
        axes.plot(col, row, "x", color=RED, markersize=0.8 * size[1], markeredgewidth=1.1)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(LINE_COLOUR)
    makes_u, never_goes_back = (per_cent(rate.share) for rate in course_rates(line))
    axes.set_title(
        _level_words(levels), loc="left", fontsize=9, fontweight="bold", color=INK, pad=4
    )
    text = f"U {makes_u}, without going back {never_goes_back}\n"
    text += f"{per_cent(obstacles.found_share)} of the obstacles found, {line['steps']:.0f} moves"
    axes.set_xlabel(text, fontsize=8, color=SOFT_INK, labelpad=4)


def _draw_squares(
    axes: Axes,
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    shares: NDArray[np.float64],
    size: tuple[float, float],
) -> None:
    """Draw a square for each share; its area is in proportion. size: the largest share, and the side for it in points."""
    most, side = size
    axes.scatter(
        x, y, s=shares / most * side**2, marker="s", color=GREEN, linewidths=0.3, edgecolors="white"
    )


def _key_to_maps(
    figure: Figure, panels: Sequence[Axes], visits: Normalize, size: tuple[float, float]
) -> None:
    """Put the colours of visits and the squares of obstacles below the panels."""
    bar = figure.colorbar(
        ScalarMappable(visits, _fading()),
        ax=panels,
        location="bottom",
        shrink=0.45,
        anchor=(0.0, 0.0),
        aspect=36,
        pad=0.02,
    )
    bar.set_label("visits of a cell, per episode", fontsize=8, color=SOFT_INK)
    bar.ax.tick_params(labelsize=7.5, colors=SOFT_INK, length=0)
    bar.outline.set_visible(False)
    for share in (0.05, 0.2, 0.5):
        if share <= size[0]:
            area = share / size[0] * size[1] ** 2
            panels[0].scatter([], [], s=area, marker="s", color=GREEN, label=f"{100 * share:.0f} %")
    panels[0].scatter([], [], s=30, marker="x", color=RED, label="most obstacles here are missed")
    legend = figure.legend(
        loc="lower right", ncols=4, frameon=False, fontsize=8, labelcolor=SOFT_INK, title_fontsize=8, columnspacing=1.2,
        title="an obstacle found on the cell, share of the episodes", alignment="left", borderaxespad=0.8,
    )  # fmt: skip
    legend.get_title().set_color(SOFT_INK)
