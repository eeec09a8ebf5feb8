"""What looking at an open study costs, measured: `python -m app.coverage.looks --studies 2000 --seed 0`.

Each simulated study is looked at while its players finish, and stopped at the first look at which the interval leaves a value
out. `misses`: the value is the truth itself, the worst that stopping can do, so this is the type-I error and the interval's
failure at any look together. `coverage at the stop`: the value is that of a policy one standard deviation of players' means
above the truth, as somebody would who waits for a difference; the interval at the stop is then judged by the truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import click
import numpy as np
from numpy.typing import NDArray

from app.coverage.simulated_studies import generator, mean_score, simulate_studies
from app.coverage.table import SCORE_POPULATIONS, ScorePopulation
from app.statistics.intervals import Ends, printed_interval
from app.statistics.sequential import Spending, boundaries
from marsexplorer.evaluation.intervals import CONFIDENCE, Floats
from marsexplorer.evaluation.run import Progress

PLAYERS = 20
ICC = 0.2
FIRST = 5
"""Players at the first look of those who look after each player."""
PLANNED = (5, 10, 15, 20)


@dataclass(frozen=True)
class LookingRule:
    """When a study is looked at, and at which levels; `spending` None means 95 % at each look, as if it were the only one."""

    name: str
    looks: tuple[int, ...]
    spending: Spending | None

    def levels(self) -> list[float]:
        """Return the level of the interval at each look."""
        if self.spending is None:
            return [CONFIDENCE] * len(self.looks)
        return [
            each.confidence
            for each in boundaries(self.spending, [look / PLAYERS for look in self.looks])
        ]


AFTER_EACH = tuple(range(FIRST, PLAYERS + 1))
RULES = (
    LookingRule("once, at the end", (PLAYERS,), None),
    LookingRule("after each player, 95 % each", AFTER_EACH, None),
    LookingRule("after each player, O'Brien-Fleming", AFTER_EACH, "obrien-fleming"),
    LookingRule("after each player, Pocock", AFTER_EACH, "pocock"),
    LookingRule("4 looks, O'Brien-Fleming", PLANNED, "obrien-fleming"),
    LookingRule("4 looks, Pocock", PLANNED, "pocock"),
)


@dataclass(frozen=True)
class Outcome:
    """What a rule came to, in percent of studies.

    misses   studies in which the interval of some look leaves the truth out
    covered  studies whose interval at the stop holds the truth, where a policy one SD better stops the study
    stopped  mean number of players at that stop
    """

    misses: float
    covered: float
    stopped: float


def measure(population: ScorePopulation, rule: LookingRule, studies: int, seed: int) -> Outcome:
    """Return the outcome of a rule in one population; the same for the same seed."""
    scores, terrain = simulate_studies(
        population, ICC, PLAYERS, studies, generator(population, ICC, PLAYERS, seed)
    )
    truth, means = mean_score(population) + terrain.mean(1), scores.mean(2)
    policy = truth + means.std(1, ddof=1).mean()
    ends = [
        _interval(means[:, :look], level)
        for look, level in zip(rule.looks, rule.levels(), strict=True)
    ]
    misses = np.array([_leaves_out(each, truth) for each in ends])
    sees_policy = np.array([_leaves_out(each, policy) for each in ends])
    sees_policy[-1] = True  # at the last look every study stops
    at = sees_policy.argmax(0)
    covered = ~misses[at, np.arange(studies)]
    return Outcome(
        100 * float(misses.any(0).mean()),
        100 * float(covered.mean()),
        float(np.array(rule.looks)[at].mean()),
    )


def _interval(means: Floats, level: float) -> Ends:
    if level >= 1:
        return np.full(len(means), -np.inf), np.full(len(means), np.inf)
    return printed_interval(means, level)


def _leaves_out(ends: Ends, value: Floats) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = (value < ends[0]) | (value > ends[1])
    return found


def table(studies: int, seed: int, advance: Progress | None = None) -> list[Sequence[str]]:
    """Return the rows of the table, its heads first; advance: (cells measured, in all)."""
    rows: list[Sequence[str]] = [
        ("population", "looks", "misses", "coverage at the stop", "players at the stop")
    ]
    cells = [(population, rule) for population in SCORE_POPULATIONS for rule in RULES]
    for done, (population, rule) in enumerate(cells, 1):
        found = measure(population, rule, studies, seed)
        numbers = f"{found.misses:.1f}", f"{found.covered:.1f}", f"{found.stopped:.1f}"
        rows.append((population.name, rule.name, *numbers))
        if advance:
            advance(done, len(cells))
    return rows


@click.command()
@click.option("--studies", type=click.IntRange(min=1), default=2000, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
def main(studies: int, seed: int) -> None:
    """Measure what looking costs and print it as a Markdown table (percent of studies; 20 players, ICC 0.2)."""
    rows = table(studies, seed)
    click.echo(
        "\n".join(
            "| " + " | ".join(row) + " |"
            for row in (rows[0], ("---", "---", "---:", "---:", "---:"), *rows[1:])
        )
    )


if __name__ == "__main__":
    main()
