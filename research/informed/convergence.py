"""How far the informed planner has converged: `python -m research.informed.convergence --size 42 --episodes 8`.

Each terrain is searched with several budgets, and with several seeds of the search for each. Where doubling the budget changes
the mean by less than the half interval over terrains, and the seeds agree as closely, more search would change little.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.intervals import t_interval
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
    """Return what `searches` annealings of so many changes find on the terrain of each seed."""
    check_size(config)
    lengths, began = [], time.process_time()
    for seed in seeds:
        terrain = Episode.begin(config, seed=seed).terrain
        paths = informed_paths(config, terrain, seed, AnnealingConfig(changes, searches))
        lengths.append([len(path) - 1 for path in paths])
    return Convergence(
        changes, np.array(lengths), (time.process_time() - began) / (len(seeds) * searches)
    )


def row_of(found: Convergence, before: Convergence | None) -> str:
    """Return a line of the table: a mean for each search, that of the best of them with its half interval, and the change."""
    best = found.lengths.min(axis=1).astype(float)
    low, high = t_interval(best)
    means = ", ".join(f"{mean:.1f}" for mean in found.lengths.mean(axis=0))
    change = "" if before is None else f"{found.lengths.mean() / before.lengths.mean() - 1:+.1%}"
    return f"| {found.changes:,} | {means} | {best.mean():.1f} ± {(high - low) / 2:.1f} | {change} | {found.cpu_s:.1f} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each budget as soon as it is measured."""
    parser = argparse.ArgumentParser(
        prog="python -m research.informed.convergence", description=__doc__
    )
    parser.add_argument(
        "--level",
        default="random",
        help="random, or t-m-b from 1-1-1 to 3-2-2 (default: %(default)s)",
    )
    parser.add_argument("--size", type=int, default=42, help="cells a side (default: %(default)s)")
    parser.add_argument(
        "--episodes", type=int, default=8, help="terrains, at least 2 (default: %(default)s)"
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=1_000_000_000,
        help="of the first terrain (default: %(default)s)",
    )
    parser.add_argument(
        "--searches",
        type=int,
        default=3,
        help="seeds of the search for each terrain (default: %(default)s)",
    )
    parser.add_argument(
        "--changes", type=int, nargs="+", default=[300_000, 600_000], help="budgets, one line each"
    )
    given = parser.parse_args(arguments)
    if given.episodes < 2 or given.searches < 1 or min(given.changes) < 1:
        parser.error("expected at least 2 episodes, 1 search and 1 change")
    try:
        config = EnvConfig.of(given.level, given.size)
        check_size(config)
    except ValueError as error:
        parser.error(str(error))
    measure(
        EnvConfig.of("random", 9), [0], 10, 1
    )  # compiles the search, which is no part of its time
    print(
        "| changes | mean of each search | best search | change of the mean | CPU s a search |\n|---|---|---|---|---|"
    )
    before = None
    for changes in given.changes:
        found = measure(
            config, range(given.seed, given.seed + given.episodes), changes, given.searches
        )
        print(row_of(found, before))
        sys.stdout.flush()
        before = found


if __name__ == "__main__":
    main()
