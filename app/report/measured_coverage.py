"""The coverage of the report's intervals as `python -m research.coverage` measured it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

COVERAGE_FILE = Path(__file__).with_name("measured_coverage.json")
"""What the report quotes: written by `python -m research.coverage --studies 2000 --seed 0 --save`."""


@dataclass(frozen=True)
class ScorePopulation:
    """Where scores come from.

    shape       of player, terrain and episode effects, where nobody collides; "kinds" are of players alone
    collisions  the mean probability that an episode ends in one; a player's own is beta distributed, with the ICC asked for
    """

    name: str
    summary: str
    shape: str = "normal"
    collisions: float = 0.0


SCORE_POPULATIONS = (
    ScorePopulation("symmetric", "normal players and episodes"),
    ScorePopulation("skewed", "exponential tails (skewness 2)", "exponential"),
    ScorePopulation("very skewed", "log-normal tails (skewness 3.7)", "lognormal"),
    ScorePopulation(
        "collisions", "5 % of episodes collide; with ICC, few players do it often", collisions=0.05
    ),
    ScorePopulation(
        "rare collisions",
        "2 % of episodes collide; with ICC, very few players do it often",
        collisions=0.02,
    ),
    ScorePopulation(
        "two kinds",
        "three quarters of the players are of one kind, a quarter of a worse one",
        "kinds",
    ),
)
ONE_SHAPE = ("symmetric", "skewed", "very skewed")
"""The populations in which everybody's scores have one shape."""


@dataclass(frozen=True)
class Cell:
    """Coverage in percent of simulated studies, for one population, ICC and number of players.

    below, above   the printed interval lies wholly above, or wholly below, the truth
    width          of the printed interval over that of the t interval, the median
    pooled         what a t interval over all episodes would cover, as if they were independent
    guaranteed_headline  in how many studies rule 2 (`is_a_few_players`) makes the guaranteed interval the headline
    headline, headline_steps   what the headline by rule 2 covers, of the score and of steps to 99 %
    printed_steps  what the printed interval of steps to 99 % covers
    """

    population: str
    icc: float
    players: int
    studies: int
    printed: float
    below: float
    above: float
    width: float
    t: float
    guaranteed: float
    new_terrains: float
    pooled: float
    guaranteed_headline: float
    headline: float
    headline_steps: float
    printed_steps: float


@cache
def saved() -> list[Cell]:
    """Return the table that the report quotes."""
    return [Cell(**cell) for cell in json.loads(COVERAGE_FILE.read_text(encoding="utf-8"))["cells"]]


def nearest(players: int) -> list[Cell]:
    """Return the saved cells of the measured number of players nearest to this one, the smaller of two."""
    cells = saved()
    counts = {cell.players for cell in cells}
    count = min(counts, key=lambda measured: (abs(measured - players), measured))
    return [cell for cell in cells if cell.players == count]


def two_kinds(most: int = 10) -> dict[int, float]:
    """Return what the printed interval covers (%) by number of players, where a quarter are far worse (ICC 0.5)."""
    found = [cell for cell in saved() if (cell.population, cell.icc) == ("two kinds", 0.5)]
    return {cell.players: cell.printed for cell in found if cell.players <= most}
