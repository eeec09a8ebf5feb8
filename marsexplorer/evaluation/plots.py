"""Plots of an evaluation: coverage against steps, and heat maps.

These are figures 7 and 6 of Koutras et al. 2021. They are made without pyplot, so they share no
global state; the same table gives the same bytes. They need results with traces.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, count
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import EpisodeTrace, Result
from marsexplorer.evaluation.table import EvaluationTable
from marsexplorer.files import replace_whole

PLOT_COLOURS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000",
)  # fmt: skip
"""Colours that colour-blind people can tell apart (Okabe and Ito)."""

POLICY_LINE_STYLES = ("-", "--", "-.", ":")
SHOWN_SHARE = 0.99
"""Share of the explored episodes that have ended at the right edge of a coverage plot."""


def save_plots(table: EvaluationTable, folder: Path) -> list[Path]:
    """Write a coverage plot a configuration and a heat map a policy; return the paths.

    They are coverage-LEVEL-ROWSxCOLS.png and heat-POLICY.png. Configurations that differ in
    something else, and policies in files of one name, get -2, -3, ... behind their names.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figures = [
        (f"coverage-{config.level}-{config.rows}x{config.cols}", coverage_figure(table, config))
        for config in table.configs
    ]
    policies = dict.fromkeys(row.policy for row in table.rows)
    figures += [(f"heat-{Path(policy).stem}", heat_figure(table, policy)) for policy in policies]
    paths: list[Path] = []
    for name, figure in figures:
        names = chain([name], (f"{name}-{number}" for number in count(2)))
        path = next(path for free in names if (path := folder / f"{free}.png") not in paths)
        paths.append(_save(figure, path))
    return paths


def coverage_figure(table: EvaluationTable, config: EnvConfig) -> Figure:
    """Plot coverage against moves, each policy's mean and 5th to 95th percentile."""
    policies = dict.fromkeys(result.policy for result in table.results)
    groups = {policy: _results(table, config, policy) for policy in policies}
    figure = Figure(figsize=(7.2, 4.5), layout="constrained")
    axes = figure.add_subplot()
    moves = _shown_moves([result for results in groups.values() for result in results])
    for number, (policy, results) in enumerate(groups.items()):
        curves = 100 * coverage_curves(results, moves)
        steps, colour = np.arange(moves + 1), PLOT_COLOURS[number % len(PLOT_COLOURS)]
        low, high = np.percentile(curves, (5, 95), axis=0)
        axes.fill_between(steps, low, high, color=colour, alpha=0.15, linewidth=0)
        style, name = POLICY_LINE_STYLES[number % len(POLICY_LINE_STYLES)], Path(policy).stem
        axes.plot(steps, curves.mean(axis=0), color=colour, linestyle=style, label=name)
    axes.axhline(100 * config.beta, color="0.4", linewidth=0.8, linestyle=(0, (1, 2)))
    axes.set(xlabel="moves", ylabel="coverage (%)", xlim=(0, moves), ylim=(0, 101))
    title = f"{_title(config)}, {len(table.seeds)} terrains: mean and 5th to 95th percentile"
    axes.set_title(title, fontsize=10)
    axes.legend(loc="lower right", frameon=False)
    axes.grid(color="0.9")
    return figure


def heat_figure(table: EvaluationTable, policy: str) -> Figure:
    """Plot visits in blue and obstacles found in green, a panel a configuration."""
    configs = [config for config in table.configs if _results(table, config, policy)]
    columns = min(4, len(configs))
    lines = -(-len(configs) // columns)
    figure = Figure(figsize=(2.9 * columns + 0.4, 3.2 * lines + 0.5), layout="constrained")
    panels = figure.subplots(lines, columns, squeeze=False).flatten()
    for axes, config in zip(panels, configs, strict=False):
        visits, obstacles = heat_maps(_results(table, config, policy), config)
        _draw_heat(axes, visits, obstacles)
        axes.set_title(_title(config), fontsize=9)
    for axes in panels[len(configs) :]:
        axes.set_axis_off()
    title = f"blue visits, green obstacles found, {len(table.seeds)} terrains each"
    figure.suptitle(f"{Path(policy).stem}: {title}", fontsize=10)
    return figure


def _shown_moves(results: Sequence[Result]) -> int:
    """The moves at which the plot ends.

    Episodes that never explore their terrain do not compress the others.
    """
    explored = [result.steps for result in results if result.outcome == "explored"]
    ends = sorted(explored or [result.steps for result in results])
    return max(1, ends[min(len(ends) - 1, int(SHOWN_SHARE * len(ends)))])


def coverage_curves(results: Sequence[Result], moves: int) -> NDArray[np.float64]:
    """Coverage (0..1) after 0..moves moves, float64[episodes, moves + 1].

    A curve stays level after its episode.
    """
    curves = np.zeros((len(results), moves + 1))
    for curve, result in zip(curves, results, strict=True):
        discovered = _trace(result).discovered[: moves + 1]
        curve[: len(discovered)] = discovered
        curve[len(discovered) :] = discovered[-1]
        curve /= result.cells
    return curves


def heat_maps(
    results: Sequence[Result], config: EnvConfig
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(visits, obstacles) of each cell, int64[rows, cols].

    Moves that ended on a cell, where the start counts once an episode; and episodes in which an
    obstacle was known there at the end.
    """
    visits, obstacles = np.zeros(config.n, np.int64), np.zeros(config.n, np.int64)
    for result in results:
        trace = _trace(result)
        visits += np.bincount(trace.path, minlength=config.n)
        obstacles += np.bincount(np.array(trace.obstacles, np.int64), minlength=config.n)
    return visits.reshape(config.rows, config.cols), obstacles.reshape(config.rows, config.cols)


def _draw_heat(axes: Axes, visits: NDArray[np.int64], obstacles: NDArray[np.int64]) -> None:
    """Draw both maps over each other; the square root keeps rare visits visible."""
    for counts, colour in ((visits, (0.03, 0.19, 0.55)), (obstacles, (0.0, 0.43, 0.17))):
        layer = np.zeros((*counts.shape, 4))
        layer[..., :3] = colour
        layer[..., 3] = np.sqrt(counts / max(1, counts.max())) * (0.95 if counts is visits else 0.6)
        axes.imshow(layer, interpolation="nearest")
    axes.set_xticks([])
    axes.set_yticks([])


def _save(figure: Figure, path: Path) -> Path:
    with replace_whole(path) as unfinished:
        figure.savefig(unfinished, format="png", dpi=120, metadata={"Software": None})
    return path


def _trace(result: Result) -> EpisodeTrace:
    if result.trace is None:
        raise ValueError("plots need traces: evaluate(..., traces=True)")
    return result.trace


def _results(table: EvaluationTable, config: EnvConfig, policy: str) -> list[Result]:
    key = (config.hash, policy)
    return [result for result in table.results if (result.config_hash, result.policy) == key]


def _title(config: EnvConfig) -> str:
    return f"level {config.level}, {config.rows}x{config.cols}"
