"""Figure 6 of the paper: where policies go on the 12 levels, and whether in a U.

`jobs` lists what is played, `draw` makes the pictures from the results:

    figure6-POLICY.svg     a map for each level: blue cells for visits, green squares for obstacles
                           found
    figure6-quadrants.svg  how often each policy makes a U, and never goes back, beside the
                           untrained walks
    figure6.md             the same numbers as a table
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from marsexplorer.config import LEVELS
from marsexplorer.evaluation import RULES
from research.paper.episodes.play import (
    DIFFICULTIES,
    EPISODES,
    can_play,
    read_results,
    with_own_names,
)
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
from research.paper.tables import markdown_table, per_cent

FIGURE = 6
POLICIES = ("ppo", *RULES)
"""The policies that are drawn unless others are named."""

LEVEL_PLACE = "{level}"
"""The place of the level in the path of policies that were trained on one level each."""

BLUE, GREEN, RED = "#08306b", "#00692c", "#c1121f"
"""Of visits, obstacles, and blind spots; cells without anything are SAND."""
HALF_CELL = 0.45
"""Of the largest square on a map, cells."""
INTERVAL = (1.4, 4.5, 0.5)


def jobs(
    policies: Sequence[str] = POLICIES,
    levels: Sequence[str] = DIFFICULTIES,
    episodes: int = EPISODES,
    size: int = 21,
) -> list[Job]:
    """The jobs of the figure: each policy on each level, and the walks of the null.

    Args:
        policies: Names or paths; "{level}" in a path stands for the level, for policies that were
            trained on one each.
        levels: Names in LEVELS.
        episodes: Of each policy on each level.
        size: Side of the square grid, cells.

    Raises:
        PolicyNotFoundError: If there is no such policy.
        PolicyFileError: If a policy's file cannot be played.
        ValueError: If two policies have the same name or one does not take the size.
    """
    plays = []
    for policy in policies:
        # an empty label takes the name of the file
        label = Path(policy.replace(f"-{LEVEL_PLACE}", "")).stem if LEVEL_PLACE in policy else ""
        for level in levels:
            play = Visits(policy.replace(LEVEL_PLACE, level), level, size, episodes, label=label)
            if not can_play(play.policy, play.config):
                raise ValueError(
                    f"{policy} cannot play {size}x{size}; choose policies that can, or their size"
                )
            plays.append(play)
    return [*with_own_names(plays), *(NullWalks(kind, size) for kind in NULLS)]


def draw(results: Path, pictures: Path) -> list[Path]:
    """Draw the pictures and write the table from a folder's results; return the paths.

    FileNotFoundError when the folder has no results of the figure.
    """
    lines = read_results(results, FIGURE)
    plays = sorted_lines([line for line in lines if "policy" in line])
    nulls = [line for kind in NULLS for line in lines if line.get("null") == kind]
    text = write_text(pictures / "figure6.md", f"{table(plays, nulls)}\n")
    drawn = {policy: heat_figure(results) for policy, results in by_policy(plays).items()}
    if plays:
        drawn["quadrants"] = quadrants_figure(plays, nulls)
    return [
        *(save(figure, pictures / f"figure6-{name}.svg") for name, figure in drawn.items()),
        text,
    ]


def by_policy(plays: Sequence[Line]) -> dict[str, list[Line]]:
    """Policy -> its results, in the order in which policies are drawn."""
    policies = in_order(line["policy"] for line in plays)
    return {policy: [line for line in plays if line["policy"] == policy] for policy in policies}


def heat_figure(lines: Sequence[Line]) -> Figure:
    """Draw the maps of one policy on the same scales; equal levels share a panel."""
    groups = merge_levels(lines)
    by_level = {line["level"]: line for line in lines}
    columns = 4 if len(groups) > 6 else min(3, len(groups))
    if columns == 3:  # a row for each size of the obstacles
        groups.sort(key=lambda levels: (levels[0][2], levels[0]))
    rows = -(-len(groups) // columns)
    panel = 9.6 / columns
    figure = new_figure(9.6, (panel + 0.38) * rows + 1.55)
    panels = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    visits = PowerNorm(0.6, 0, _most(lines, "visits"))  # keeps seldom visited cells visible
    square = _most(lines, "found"), HALF_CELL * 2 * 72 * panel / (lines[0]["cols"] + 1.5)
    for axes, levels in zip(panels, groups, strict=False):
        _draw_maps(axes, by_level[levels[0]], levels, visits, square)
    for axes in panels[len(groups) :]:
        axes.set_axis_off()
    _key_to_maps(figure, panels.tolist(), visits, square)
    first = lines[0]
    heading(
        figure,
        f"Where {first['policy']} goes, and the obstacles that it finds",
        f"{first['episodes']} held-out terrains of each level, {first['rows']} x {first['cols']}; the rover starts in the "
        "north-west corner.\nLevels that differ in the bonus alone have the same terrains.",
    )
    return figure


def merge_levels(lines: Sequence[Line]) -> list[tuple[str, ...]]:
    """Group levels on the same terrains on which every policy did the same.

    That is so for every policy that is not trained for the level: the bonus changes no terrain.
    """
    groups: dict[str, list[str]] = {}
    for level in sorted({line["level"] for line in lines}, key=list(LEVELS).index):
        done = {line["policy"]: line["visits"] for line in lines if line["level"] == level}
        groups.setdefault(f"{level[:3]} {sorted(done.items())}", []).append(level)
    return [tuple(levels) for levels in groups.values()]


def quadrants_figure(plays: Sequence[Line], nulls: Sequence[Line]) -> Figure:
    """Draw the rates of both measures for each level and policy, the null below."""
    groups, policies = merge_levels(plays), list(by_policy(plays))
    row_of = {levels[0]: number for number, levels in enumerate(groups)}
    colours = colours_of(policies)
    figure = new_figure(9.6, 0.15 * len(groups) * (len(policies) + 1) + 0.3 * len(nulls) + 2.0)
    panels = figure.subplots(1, 2, sharey=True)
    null_rows = [len(groups) - 0.1 + 0.5 * number for number in range(len(nulls))]
    titles = ("Visits the quadrants in a U", "A U, and never goes back")
    for measure, (axes, title) in enumerate(zip(panels, titles, strict=True)):
        for line in (play for play in plays if play["level"] in row_of):
            policy = line["policy"]
            aside = (policies.index(policy) + 0.5) / (len(policies) + 1) - 0.5
            rate, at = course_rates(line)[measure], row_of[line["level"]] + aside
            draw_interval(axes, rate, at, "o", colours[policy], INTERVAL)
        for at, line in zip(null_rows, nulls, strict=True):
            draw_interval(axes, course_rates(line)[measure], at, "D", INK, INTERVAL)
        if nulls:
            axes.axhline(len(groups) - 0.5, color=SOFT_INK, linewidth=0.8)
        plain(axes, title)
        shade_rows(axes, len(groups))
        axes.set(xlim=(-0.03, 1.03), xlabel="share of episodes, with its 95 % interval")
        axes.xaxis.set_major_formatter(lambda share, _: per_cent(share))
    names = [*map(_level_words, groups), *(NULLS[line["null"]] for line in nulls)]
    panels[0].set_yticks([*range(len(groups)), *null_rows], names)
    panels[0].set_ylim((null_rows or [len(groups) - 0.8])[-1] + 0.4, -0.6)
    points = {"linestyle": "", "marker": "o", "markersize": 5}
    handles = [line_of(policy, colours[policy], **points) for policy in policies]
    if nulls:
        words = "walks that nobody trained, without obstacles"
        handles.append(line_of(words, INK, linestyle="", marker="D", markersize=4))
    legend(figure, handles, 5, "left")
    heading(
        figure,
        "The first order of the Hilbert curve",
        f"{plays[0]['episodes']} held-out terrains of each level. A U goes from the start's quadrant to a neighbour, to the "
        "opposite one, to the last.\nA walk that enters each quadrant once can hardly do anything else: there are two such "
        "orders, and both are a U.",
    )
    return figure


def table(plays: Sequence[Line], nulls: Sequence[Line]) -> str:
    """The numbers as a table in Markdown."""
    rows = []
    for line in (play for results in by_policy(plays).values() for play in results):
        obstacles, explored = (
            obstacles_of(line),
            line["outcomes"].get("explored", 0) / line["played"],
        )
        first = (line["policy"], line["level"], per_cent(explored), f"{line['steps']:.1f}")
        last = (per_cent(obstacles.found_share, 1), f"{obstacles.distance:.3f}")
        rows.append(
            [*first, *map(_rate_text, course_rates(line)), *last, str(len(obstacles.blind_spots))]
        )
    for line in nulls:
        moves = "" if line["moves"] is None else f"{line['moves']:.1f}"
        rates = map(_rate_text, course_rates(line))
        rows.append([NULLS[line["null"]], "none", "", moves, *rates, "", "", ""])
    columns = ("walk", "level", "explored", "moves", "U", "U without going back")
    return markdown_table((*columns, "obstacles found", "distance", "blind spots"), rows)


def _level_words(levels: Sequence[str]) -> str:
    return f"level {levels[0]}" if len(levels) == 1 else f"levels {', '.join(levels)}"


def _rate_text(rate: Rate) -> str:
    share, low, high = (f"{100 * number:.1f}" for number in (rate.mean, rate.low, rate.high))
    return f"{share} % (all {rate.total})" if low == high else f"{share} % ({low} to {high})"


def _most(lines: Sequence[Line], name: str) -> float:
    """The largest count of a map, per episode; a little above 0 if there is none."""
    most = max(map_of(line, name).max() / max(1, line["played"]) for line in lines)
    return max(float(most), 1e-9)


def _fading() -> Colormap:
    """The colours of visits, from those of a cell without any."""
    return LinearSegmentedColormap.from_list("visits", [SAND, "#9db8d9", "#3f6fb0", BLUE])


def _draw_maps(
    axes: Axes, line: Line, levels: Sequence[str], visits: Normalize, square: tuple[float, float]
) -> None:
    """Draw visits as cells and the obstacles found as squares on them.

    The borders of the quadrants are dashed lines, and a blind spot has a cross.

    square  the most obstacles found on a cell, per episode, and the side of their square in points:
            areas are in proportion
    """
    rows, cols, played = line["rows"], line["cols"], max(1, line["played"])
    obstacles, (most, side) = obstacles_of(line), square
    shown = map_of(line, "visits") / played
    axes.imshow(shown, cmap=_fading(), norm=visits, interpolation="nearest")
    discovered = map_of(line, "found") / played
    row, col = np.nonzero(discovered)
    half = HALF_CELL * np.sqrt(discovered[row, col] / most)
    x, y = np.stack([col - half, col + half]), np.stack([row - half, row + half])
    corners = np.stack([x[[0, 1, 1, 0, 0]].T, y[[0, 0, 1, 1, 0]].T], axis=2).reshape(-1, 2)
    codes = np.tile([Outline.MOVETO, *3 * [Outline.LINETO], Outline.CLOSEPOLY], len(half))
    style: dict[str, Any] = {"facecolor": GREEN, "edgecolor": "white", "linewidth": 0.3}
    axes.add_patch(PathPatch(Outline(corners, codes), **style))  # one shape: a small file
    axes.axhline(rows / 2 - 0.5, color=INK, linewidth=0.5, linestyle=(0, (2, 3)))
    axes.axvline(cols / 2 - 0.5, color=INK, linewidth=0.5, linestyle=(0, (2, 3)))
    if obstacles.blind_spots:
        row, col = np.divmod(np.array(obstacles.blind_spots), cols)
        axes.plot(col, row, "x", color=RED, markersize=0.8 * side, markeredgewidth=1.1)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(LINE_COLOUR)
    makes_u, never_goes_back = (per_cent(rate.mean) for rate in course_rates(line))
    title = _level_words(levels)
    axes.set_title(title, loc="left", fontsize=9, fontweight="bold", color=INK, pad=4)
    text = f"U {makes_u}, without going back {never_goes_back}\n"
    text += f"{per_cent(obstacles.found_share)} of the obstacles found, {line['steps']:.0f} moves"
    axes.set_xlabel(text, fontsize=8, color=SOFT_INK, labelpad=4)


def _key_to_maps(
    figure: Figure, panels: Sequence[Axes], visits: Normalize, square: tuple[float, float]
) -> None:
    """Put the colours of visits and the squares of obstacles below the panels."""
    style: dict[str, Any] = {"location": "bottom", "anchor": (0.0, 0.0), "pad": 0.02}
    style |= {"shrink": 0.45, "aspect": 36}
    bar = figure.colorbar(ScalarMappable(visits, _fading()), ax=panels, **style)
    bar.set_label("visits of a cell, per episode", fontsize=8, color=SOFT_INK)
    bar.ax.tick_params(labelsize=7.5, colors=SOFT_INK, length=0)
    bar.outline.set_visible(False)
    for share in (0.05, 0.2, 0.5):
        if share <= square[0]:
            area, label = share / square[0] * square[1] ** 2, per_cent(share)
            panels[0].scatter([], [], area, marker="s", color=GREEN, label=label)
    panels[0].scatter([], [], 30, marker="x", color=RED, label="most obstacles here are missed")
    legend = figure.legend(
        loc="lower right",
        ncols=4,
        frameon=False,
        fontsize=8,
        labelcolor=SOFT_INK,
        title_fontsize=8,
        columnspacing=1.2,
        title="an obstacle found on the cell, share of the episodes",
        alignment="left",
        borderaxespad=0.8,
    )
    legend.get_title().set_color(SOFT_INK)
