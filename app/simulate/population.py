"""Populations of synthetic players: how much people differ, how much one player's episodes differ, how often somebody crashes.

A player follows `frontier-cost` and slips now and then into a random valid move. Players differ in how often (skill), and
one player's episodes differ among themselves (luck). On top of that a move that could end in an obstacle or off the grid
does so with a small probability of the player's own, spread unevenly: a few people make most of the collisions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class SimulatedPopulation:
    """A distribution from which players are drawn.

    slip          share of moves that slip for the median player, in (0, 1)
    skill_sd      SD between players of the slip, in logits
    luck_sd       SD between one player's episodes of the slip, in logits
    crash         probability of a crash per move next to something to crash into, for the median player, in [0, 1)
    crash_sd      SD between players of the logarithm of that probability
    """

    name: str
    slip: float
    skill_sd: float
    luck_sd: float
    crash: float = 0.0
    crash_sd: float = 0.0


@dataclass(frozen=True)
class Skills:
    """Players drawn from a population, one entry each: slip in logits, and the probability of a crash."""

    slip_logit: NDArray[np.float64]
    crash: NDArray[np.float64]
    luck_sd: float

    def draw_episodes(
        self, players: NDArray[np.int64], rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw one episode for each entry of `players` and return its (slip, crash)."""
        logit = self.slip_logit[players] + self.luck_sd * rng.standard_normal(len(players))
        return 1.0 / (1.0 + np.exp(-logit)), self.crash[players]


SIMULATED_POPULATIONS = {
    each.name: each
    for each in (
        SimulatedPopulation("skilled", slip=0.05, skill_sd=0.5, luck_sd=0.4),
        SimulatedPopulation(
            "mixed", slip=0.15, skill_sd=1.0, luck_sd=0.5, crash=0.0001, crash_sd=1.0
        ),
        SimulatedPopulation(
            "clumsy", slip=0.25, skill_sd=0.9, luck_sd=0.5, crash=0.002, crash_sd=1.2
        ),
    )
}
"""By name: hardly any slips; people as different as people are; slips everywhere, and collisions by a few."""

RANDOM_MOVES = SimulatedPopulation("random", slip=1.0 - 1e-12, skill_sd=0.0, luck_sd=0.0)
"""Players whose every move is a random valid one."""


def draw_players(population: SimulatedPopulation, players: int, rng: np.random.Generator) -> Skills:
    """Draw `players` players."""
    logit = np.log(population.slip / (1.0 - population.slip))
    slip = logit + population.skill_sd * rng.standard_normal(players)
    spread = np.exp(population.crash_sd * rng.standard_normal(players))
    return Skills(slip, np.minimum(population.crash * spread, 1.0), population.luck_sd)
