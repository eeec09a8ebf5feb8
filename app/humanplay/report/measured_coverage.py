"""The coverage of the report's interval, as measured.

`python -m research.coverage` measures it.
"""

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

    Attributes:
        shape: Of player, terrain and episode effects, where nobody collides; "kinds" are of
            players alone.
        collisions: The mean probability that an episode ends in one; a player's own is beta
            distributed, with the ICC asked for.
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
        "collisions", "5 % of episodes fail early; with ICC, those of few players", collisions=0.05
    ),
    ScorePopulation(
        "rare collisions",
        "2 % of episodes fail early; with ICC, those of very few players",
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
    """Coverage in percent of simulated studies of one kind.

    A kind is a population, an ICC and a number of players.

    Attributes:
        score, steps: Of the interval for other players and other terrains.
        own_score, own_steps: Of the interval for other players on these terrains.
        width: Of the interval of steps over that of the t interval over players, the median.
        pooled: What a t interval over all episodes would cover, as if they were independent.
    """

    population: str
    icc: float
    players: int
    studies: int
    score: float
    steps: float
    own_score: float
    own_steps: float
    width: float
    pooled: float


@cache
def saved() -> list[Cell]:
    """The table that the report quotes."""
    return [Cell(**cell) for cell in json.loads(COVERAGE_FILE.read_text(encoding="utf-8"))["cells"]]


def nearest(players: int) -> list[Cell]:
    """The saved cells of the measured number of players nearest to this one.

    Of two equally near the smaller.
    """
    cells = saved()
    counts = {cell.players for cell in cells}
    count = min(counts, key=lambda measured: (abs(measured - players), measured))
    return [cell for cell in cells if cell.players == count]
