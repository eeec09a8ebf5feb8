"""How far the informed planner has converged.

`python -m research.informed.convergence --size 42 --episodes 8`

Each terrain is searched with several budgets, and with several seeds of the search for each. Where
doubling the budget changes the mean by less than the half interval over terrains, and the seeds
agree as closely, more search would change little.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import click
import numpy as np

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.intervals import t_interval
from research.informed.informed import AnnealingConfig, check_size, informed_paths


@dataclass(frozen=True)
class Convergence:
    """The searches of one budget.

    lengths  moves of the walk found, int64[terrains, searches]
    cpu_s    CPU seconds of one search, in the mean
    """

    changes: int
    lengths: np.ndarray
    cpu_s: float


def measure(config: EnvConfig, seeds: Sequence[int], changes: int, searches: int) -> Convergence:
    """The walks that `searches` annealings find on the terrain of each seed."""
    check_size(config)
    lengths, began = [], time.process_time()
    for seed in seeds:
        terrain = Episode.begin(config, seed=seed).terrain
        paths = informed_paths(config, terrain, seed, AnnealingConfig(changes, searches))
        lengths.append([len(path) - 1 for path in paths])
    return Convergence(
        changes, np.array(lengths), (time.process_time() - began) / (len(seeds) * searches)
    )


def row_of(budget: Convergence, before: Convergence | None) -> str:
    """A line of the table: means of the searches, the best of them, and the change."""
    best = budget.lengths.min(axis=1).astype(float)
    low, high = t_interval(best)
    means = ", ".join(f"{mean:.1f}" for mean in budget.lengths.mean(axis=0))
    change = "" if before is None else f"{budget.lengths.mean() / before.lengths.mean() - 1:+.1%}"
    return (
        f"| {budget.changes:,} | {means} | {best.mean():.1f} ± {(high - low) / 2:.1f} | "
        f"{change} | {budget.cpu_s:.1f} |"
    )


@click.command()
@click.option("--level", default="random", show_default=True)
@click.option("--size", default=42, show_default=True, help="Cells a side.")
@click.option("--episodes", type=click.IntRange(min=2), default=8, show_default=True)
@click.option("--seed", default=1_000_000_000, show_default=True, help="Of the first terrain.")
@click.option("--searches", type=click.IntRange(min=1), default=3, help="Seeds of the search.")
@click.option("--changes", multiple=True, type=click.IntRange(min=1), default=(300_000, 600_000))
def main(
    level: str, size: int, episodes: int, seed: int, searches: int, changes: tuple[int, ...]
) -> None:
    """Print a line for each budget of --changes as soon as it is measured."""
    try:
        config = EnvConfig.of(level, size)
        check_size(config)
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    measure(EnvConfig.of("random", 9), [0], 10, 1)  # compiles the search: no part of its time
    click.echo(
        "| changes | mean of each search | best search | change of the mean | CPU s a search |\n"
        "|---|---|---|---|---|"
    )
    before = None
    for budget in changes:
        measured = measure(config, range(seed, seed + episodes), budget, searches)
        click.echo(row_of(measured, before))
        before = measured


if __name__ == "__main__":
    main()
