"""Makes the figures that the package comes with: the shipped policies on the terrains of the boards on offer."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version

from app.leaderboard.entries import OFFERED, LeaderboardEntry, offered_entry
from app.leaderboard.jobs import EvaluationJob
from app.leaderboard.shipped import Origin, ShippedFigure, ShippedFigures, file_sha256, to_document
from app.leaderboard.worker import evaluate_policy
from app.play.policy_catalogue import PolicyCatalogue


def offered_boards() -> dict[str, LeaderboardEntry]:
    """Return the boards on offer by their ids."""
    return {entry.id: entry for entry in map(offered_entry, OFFERED)}


def make_board(
    entry: LeaderboardEntry,
    workers: int,
    advance: Callable[[int, int], None],
    kept: ShippedFigures | None = None,
    again: Sequence[str] = (),
) -> str:
    """Play a board's policies in as many processes and return the text of its file.

    kept   figures that are taken where they still hold, except for the policies in `again`

    The figures do not depend on `workers`. `advance` is called with the number of policies that are done and their number.
    """
    origin = Origin(
        version("marsexplorer-playground"),
        f"marsexplorer leaderboard --board {entry.id} --out data/leaderboard",
    )
    size = (entry.config.rows, entry.config.cols)
    sources = {
        offer.name: offer.source
        for offer in PolicyCatalogue().offers()
        if offer.size in (None, size)
    }
    jobs = list(entry.jobs(sources).values())
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        found = [
            kept.find(job) if kept is not None and job.policy not in again else None for job in jobs
        ]
        waiting = [
            old or pool.submit(make_figure, job, origin)
            for job, old in zip(reversed(jobs), reversed(found), strict=True)
        ]  # the slowest first
        figures = []
        for each in reversed(waiting):
            figures.append(each if isinstance(each, ShippedFigure) else each.result())
            advance(len(figures), len(jobs))
    return to_document(entry.config, entry.seeds, figures, origin)


def make_figure(job: EvaluationJob, origin: Origin) -> ShippedFigure:
    """Play a job and return its figure."""
    figure, steps = evaluate_policy(job.policy, job.config, job.seeds)
    return ShippedFigure(job.policy, file_sha256(job.policy), tuple(steps), figure, origin)
