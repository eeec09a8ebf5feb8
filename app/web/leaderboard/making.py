"""Makes the figures that the package comes with: the shipped policies on the terrains of the boards on offer."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

from app.jobs import Jobs, Progress
from app.tasks.mars.policies import PolicyCatalogue
from app.web.leaderboard.entries import OFFERED, LeaderboardEntry, entry_of
from app.web.leaderboard.evaluations import (
    Evaluation,
    Origin,
    ShippedFigure,
    ShippedFigures,
    file_sha256,
    to_document,
)


def offered_boards() -> dict[str, LeaderboardEntry]:
    """Return the boards on offer by their ids."""
    return {entry.id: entry for entry in map(entry_of, OFFERED)}


def make_board(
    entry: LeaderboardEntry,
    jobs: Jobs,
    advance: Progress,
    kept: ShippedFigures | None = None,
    again: Sequence[str] = (),
) -> str:
    """Play a board's policies and return the text of its file.

    kept   figures that are taken where they still hold, except for the policies in `again`

    `advance` is called with the number of policies that are done and their number.
    """
    command = f"marsexplorer leaderboard --board {entry.id} --out data/leaderboard"
    origin = Origin(version("marsexplorer-playground"), command)
    size = (entry.config.rows, entry.config.cols)
    offers = [each for each in PolicyCatalogue().offers() if each.size in (None, size)]
    wanted = list(entry.evaluations({each.name: each.source for each in offers}).values())
    waiting = []
    for each in reversed(wanted):  # the slowest first
        old = kept.find(each) if kept is not None and each.policy not in again else None
        waiting.append(old or jobs.submit(make_figure, each, origin))
    figures = []
    for figure in reversed(waiting):
        figures.append(figure if isinstance(figure, ShippedFigure) else figure.result())
        advance(len(figures), len(wanted))
    return to_document(entry.config, entry.seeds, figures, origin)


def make_figure(wanted: Evaluation, origin: Origin) -> ShippedFigure:
    """Play an evaluation and return its figure."""
    figure, steps = wanted.play()
    return ShippedFigure(wanted.policy, file_sha256(wanted.policy), tuple(steps), figure, origin)
