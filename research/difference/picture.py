"""Draw paths of the authors' videos and of trained policies, and a curve."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from marsexplorer.observation import DISPLACEMENTS
from research.difference.answers import DATA, read_stored
from research.difference.design import Training
from research.paper.figures.drawing import LINE_COLOUR, SAND, new_figure, plain, save
from research.paper.jobs import read_lines
from research.paper.tables import per_cent

VIDEOS = DATA.parent / "videos.jsonl"
"""What the frames of the three videos show: the blocked cells, and the rover's cells one after
the other.
"""
CURVE = DATA.with_name("cleanrl.csv")
"""Of one training by `examples/cleanrl_ppo.py --preset videos`."""
NAME, CURVE_NAME = "paths", "cleanrl"
COLOURS = ("#0072B2", "#D55E00", "#009E73")
SIDE, EPISODES = 21, 3
PANELS = (
    ("the authors' videos", None),
    ("their world, full passes", ("code", "code", "full")),
    ("their world, light passes", ("code", "code", "light")),
    ("the text's world, light passes", ("text", "text", "light")),
)
"""Title, and (world, estimates, passes) of trainings in which leaving is free."""
Path2D = Sequence[tuple[int, int]]


def paths_of(kind: tuple[str, str, str]) -> list[list[Path2D]]:
    """Return the first paths of each seed on terrains kept apart, from the corner on."""
    records, (world, estimates, passes) = read_stored(), kind
    paths: list[list[Path2D]] = []
    for seed in range(EPISODES):
        result = records[Training(world, estimates, "free", seed, passes=passes)].result
        assert result is not None
        paths.append([walk(actions) for actions in result["actions"][:EPISODES]])
    return paths


def walk(actions: str) -> Path2D:
    """Return the cells that actions lead through; the last move may leave them."""
    row, col = 0, 0
    cells = [(row, col)]
    for action in map(int, actions):
        row, col = row + DISPLACEMENTS[action][0], col + DISPLACEMENTS[action][1]
        cells.append((row, col))
    return cells


def draw(folder: Path) -> Path:
    """Draw the panels and return the picture's path."""
    figure = new_figure(10.4, 2.9)
    axes: Any = figure.subplots(1, len(PANELS))
    for panel, (title, kind) in zip(axes, PANELS, strict=True):
        videos = [[line["path"]] for line in read_lines(VIDEOS)]
        draw_panel(panel, title, videos if kind is None else paths_of(kind))
    return save(figure, folder / f"{NAME}.svg")


def draw_curve(folder: Path) -> Path:
    """Draw the curve of CleanRL's loop on the level of the videos."""
    with CURVE.open(newline="") as file:
        points = [(int(row["moves"]), float(row["coverage"])) for row in csv.DictReader(file)]
    moves, coverage = zip(*points, strict=True)
    figure = new_figure(5.2, 2.6)
    axes = figure.subplots()
    plain(axes, "coverage of the last 100 episodes")
    axes.plot([count / 1000 for count in moves], coverage, color=COLOURS[0])
    axes.set_xlabel("moves, thousands")
    axes.set_ylim(0, 1)
    axes.yaxis.set_major_formatter(lambda share, _: per_cent(share))
    return save(figure, folder / f"{CURVE_NAME}.svg")


def draw_panel(axes: Axes, title: str, groups: Sequence[Sequence[Path2D]]) -> None:
    """Draw the paths of each group in a colour of its own."""
    plain(axes, title)
    axes.grid(visible=False)
    axes.set_xlim(-1.5, SIDE + 0.5)
    axes.set_ylim(SIDE + 0.5, -1.5)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    ground = Rectangle((-0.5, -0.5), SIDE, SIDE, facecolor=SAND, edgecolor=LINE_COLOUR)
    axes.add_patch(ground)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for group, colour in zip(groups, COLOURS, strict=True):
        for number, path in enumerate(group):
            shift = 0.25 * (COLOURS.index(colour) - 1)
            rows, cols = zip(*path, strict=True)
            axes.plot(
                [col + shift for col in cols],
                [row + shift for row in rows],
                color=colour,
                linewidth=1.6 if number == 0 else 0.9,
                alpha=1.0 if number == 0 else 0.55,
            )
