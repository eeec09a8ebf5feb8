"""Compares rules from elsewhere with ours on the same terrains.

    python -m research.baselines

All rules play a terrain before the next one, so a run that was stopped goes on where it was.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from humanplay.command.console import progress
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import steps_to_target
from marsexplorer.evaluation import RULES
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.evaluation.table import ratio_interval
from marsexplorer.intervals import Floats
from marsexplorer.policies.base import Policy
from research.baselines.rules import DistanceAdvantage, USweep
from research.paper.tables import Estimate, markdown_table

FIRST_SEED = 1795391114
"""Of the terrains, those of the second table of docs/results.md."""
FOLDER = Path(__file__).parent / "data"
SIDES = (21, 42, 84)
BEST = "frontier-priced"
"""The best of our rules."""
OURS = (*RULES, BEST)
ELSEWHERE = (DistanceAdvantage(1.0), DistanceAdvantage(0.5), USweep())
NAMES = (*OURS, *(rule.name for rule in ELSEWHERE))
COLUMNS = ("seed", "policy", "steps", "soon")
"""Moves to 99 %, and the share of the cells known after as many moves as two sides."""


def players() -> list[Policy]:
    """The rules, ours first."""
    return [*map(policies.load, OURS), *ELSEWHERE]


def file_of(side: int) -> Path:
    """The file of the terrains of a side."""
    return FOLDER / f"random-{side}.csv"


def measure(side: int, terrains: int) -> None:
    """Add the rows of the terrains of level random that the file does not have yet."""
    path, config, rules = file_of(side), EnvConfig.of("random", side), players()
    done = set(steps_by_seed(path)[0]) if path.is_file() else set[int]()
    with progress(f"{side}x{side}") as advance, path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if file.tell() == 0:
            writer.writerow(COLUMNS)
        for count, seed in enumerate(range(FIRST_SEED, FIRST_SEED + terrains), 1):
            if seed not in done:
                writer.writerows([row_of(rule, config, seed) for rule in rules])
                file.flush()
            advance(count, terrains)


def row_of(rule: Policy, config: EnvConfig, seed: int) -> tuple[int, str, int, str]:
    """What a rule needs on a terrain, by COLUMNS."""
    episode = play_episode(rule, config, seed)
    steps = steps_to_target(config, episode.outcome, episode.steps)
    soon = episode.discoveries[: 2 * config.rows + 1][-1] / config.n
    return seed, rule.name, steps, f"{soon:.4f}"


def steps_by_seed(path: Path) -> tuple[list[int], dict[str, Floats], dict[str, Floats]]:
    """What all rules played: (seeds, policy -> moves, policy -> shares)."""
    with path.open(newline="") as file:
        rows = [*csv.DictReader(file)]
    by_policy = {
        name: {int(row["seed"]): row for row in rows if row["policy"] == name} for name in NAMES
    }
    seeds = sorted(set.intersection(*(set(played) for played in by_policy.values())))
    moves, shares = (
        {
            name: np.array([float(played[seed][column]) for seed in seeds])
            for name, played in by_policy.items()
        }
        for column in ("steps", "soon")
    )
    return seeds, moves, shares


def table(sides: Sequence[int] = SIDES) -> str:
    """Each rule's moves, over those of the paper's better rule and of our best one."""
    rows = []
    for side in filter(lambda side: file_of(side).is_file(), sides):
        seeds, moves, shares = steps_by_seed(file_of(side))
        better = min(RULES, key=lambda name: float(moves[name].mean()))
        for name, steps in moves.items():
            ratios = [
                Estimate(*ratio_interval(steps, moves[reference])).text()
                if name != reference
                else "1"
                for reference in (better, BEST)
            ]
            size = f"{side}x{side}", f"{len(seeds):,}"
            rows.append(
                [
                    f"`{name}`",
                    *size,
                    Estimate.of(steps).text(1),
                    *ratios,
                    Estimate.of(shares[name]).text(),
                ]
            )
    columns = ("rule", "size", "terrains", "steps to 99 %", "to rule", "to best rule", "known soon")
    return markdown_table(columns, rows)


@click.command()
@click.option(
    "--size", "sides", type=click.IntRange(min=1), multiple=True, default=SIDES, show_default=True
)
@click.option("--terrains", type=click.IntRange(min=2), default=1000, show_default=True)
@click.option("--table", "is_table", is_flag=True, help="Print the table of what is stored.")
def main(sides: tuple[int, ...], terrains: int, is_table: bool) -> None:
    """Play the rules on the terrains of each size, and print the table."""
    if not is_table:
        for side in sides:
            measure(side, terrains)
    click.echo(table(sides))


if __name__ == "__main__":
    main(prog_name="python -m research.baselines")
