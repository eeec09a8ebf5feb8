"""Compares rules from elsewhere with ours on the same terrains.

    python -m research.baselines

All rules play a terrain before the next one, so a run that was stopped goes on where it was, and a
rule that is new plays the terrains that the others have played.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import click
import numpy as np

from humanplay.command.console import progress
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import steps_to_target
from marsexplorer.evaluation import RULES
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.evaluation.table import ratio_interval
from marsexplorer.policies.base import Policy
from research.baselines.rules import ClusterTour, DistanceAdvantage, NextBestView, USweep
from research.paper.tables import Estimate, markdown_table

FIRST_SEED = 1795391114
"""Of the terrains, those of the second table of docs/results.md."""
FOLDER = Path(__file__).parent / "data"
SIDES = (21, 42, 84)
BEST = "frontier-priced"
"""The best of our rules."""
OURS = (*RULES, BEST)
ELSEWHERE = (
    DistanceAdvantage(1.0),
    DistanceAdvantage(0.5),
    NextBestView(),
    ClusterTour(),
    USweep(),
)
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
    played = read_rows(path) if path.is_file() else {}
    with progress(f"{side}x{side}") as advance, path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if file.tell() == 0:
            writer.writerow(COLUMNS)
        for count, seed in enumerate(range(FIRST_SEED, FIRST_SEED + terrains), 1):
            missing = [rule for rule in rules if seed not in played.get(rule.name, {})]
            writer.writerows([row_of(rule, config, seed) for rule in missing])
            file.flush()
            advance(count, terrains)


def row_of(rule: Policy, config: EnvConfig, seed: int) -> tuple[int, str, int, str]:
    """What a rule needs on a terrain, by COLUMNS."""
    episode = play_episode(rule, config, seed)
    steps = steps_to_target(config, episode.outcome, episode.steps)
    soon = episode.discoveries[: 2 * config.rows + 1][-1] / config.n
    return seed, rule.name, steps, f"{soon:.4f}"


@dataclass(frozen=True)
class Row:
    """What a rule needed on a terrain.

    steps  to 99 %
    soon   share of the cells known after as many moves as two sides
    """

    steps: float
    soon: float


def read_rows(path: Path) -> dict[str, dict[int, Row]]:
    """What the rules played: policy -> seed -> row; the rules in the order of NAMES."""
    played: dict[str, dict[int, Row]] = {name: {} for name in NAMES}
    with path.open(newline="") as file:
        for line in csv.DictReader(file):
            played[line["policy"]][int(line["seed"])] = Row(
                float(line["steps"]), float(line["soon"])
            )
    return {name: rows for name, rows in played.items() if rows}


def to_reference(rows: dict[int, Row], references: dict[int, Row]) -> str:
    """A rule's moves over those of a reference on the terrains that both played."""
    both = sorted(rows.keys() & references.keys())
    moves, others = (
        np.array([played[seed].steps for seed in both]) for played in (rows, references)
    )
    return Estimate(*ratio_interval(moves, others)).text()


def table(sides: Sequence[int] = SIDES) -> str:
    """Each rule's moves, over those of the paper's better rule and of our best one."""
    cells = []
    for side in filter(lambda side: file_of(side).is_file(), sides):
        played = read_rows(file_of(side))
        better = min(RULES, key=lambda name: fmean(row.steps for row in played[name].values()))
        for name, rows in played.items():
            ratios = [
                to_reference(rows, played[reference]) if name != reference else "1"
                for reference in (better, BEST)
            ]
            steps = Estimate.of([row.steps for row in rows.values()]).text(1)
            soon = Estimate.of([row.soon for row in rows.values()]).text()
            cells.append([f"`{name}`", f"{side}x{side}", f"{len(rows):,}", steps, *ratios, soon])
    columns = ("rule", "size", "terrains", "steps to 99 %", "to rule", "to best rule", "known soon")
    return markdown_table(columns, cells)


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
