"""Simulated studies whose truth is known, to measure a report's methods on.

A simulated study is scores[players, terrains] = mean + player + terrain + episode. A score's long
tail points down; steps to 99 % mirror it, and so do their intervals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from humanplay.report.measured_coverage import SCORE_POPULATIONS, ScorePopulation
from marsexplorer.intervals import Floats

TERRAINS = 30
TERRAIN_SHARE = 0.2
"""Of the variance of an episode's score."""
SCORE_BOUNDS = (-0.18, 1.0)
COLLISION_COST = 0.55
"""Of a collision, in score."""
PLAYED_SCORE, PLAYED_SD = 0.94, 0.0098
"""Of an episode without a collision, in the populations that have them."""
MEAN_STEPS, STEPS_SD = 95.0, 15.0
"""Of an episode that reaches 99 %."""
STEPS_BOUNDS = (1.0, 441.0)
"""Of a 21x21 grid; a collision counts the upper one."""
WORSE_SHARE = 0.25
"""Of the players, of the worse of two kinds."""
POLICY_SD = 0.01
"""Of what a policy scores on a terrain, apart from what the terrain adds to everybody's score."""


@dataclass(frozen=True)
class StudyPlan:
    """A study without failures, in steps: size, people's mean and spreads, limit."""

    players: int
    terrains: int
    mean: float
    player_sd: float
    episode_sd: float
    limit: float

    def __str__(self) -> str:
        spreads = f"SD {self.player_sd:g} between players and {self.episode_sd:g} of an episode"
        return f"{self.players} players x {self.terrains} terrains, {spreads}"


PAPER = StudyPlan(10, 30, mean=100.0, player_sd=28.0, episode_sd=45.0, limit=441.0)
"""At the spreads that a protocol on 21x21 grids assumes."""


def generator(
    population: ScorePopulation, icc: float, players: int, seed: int
) -> np.random.Generator:
    """Return the generator of a cell's studies, another one for every cell and seed."""
    return np.random.default_rng(
        [seed, players, round(100 * icc), SCORE_POPULATIONS.index(population)]
    )


def mean_score(population: ScorePopulation) -> float:
    """Return the mean score over players and terrains."""
    return PLAYED_SCORE - COLLISION_COST * population.collisions if population.collisions else 0.9


def simulate_studies(
    population: ScorePopulation, icc: float, players: int, studies: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Scores float64[studies, players, TERRAINS], and each terrain's effect.

    The effects are float64[studies, TERRAINS], mean 0.

    The truth on a study's terrains is `mean_score(population)` plus the mean of what they add.
    """
    shape = (studies, players, TERRAINS)
    if not population.collisions:
        player, terrain = (
            _drawn(population.shape, size, rng)
            for size in ((studies, players, 1), (studies, 1, TERRAINS))
        )
        if population.shape == "kinds":
            player = np.where(rng.random(player.shape) < WORSE_SHARE, *_kinds())
        # the ICC is of the one-way model, in which terrains count as variance within players
        terrain_share = min(TERRAIN_SHARE, 1 - icc)
        episode = _drawn(population.shape, shape, rng)
        shares = (icc, terrain_share, 1 - icc - terrain_share)
        parts = zip(shares, (player, terrain, episode), strict=True)
        scores: Floats = 0.9 + 0.03 * sum(np.sqrt(share) * part for share, part in parts)
        return scores, 0.03 * np.sqrt(terrain_share) * terrain[:, 0]
    rate = np.full((studies, players, 1), population.collisions)
    if icc:
        spread = 1 / icc - 1
        ends = population.collisions * spread, (1 - population.collisions) * spread
        rate = rng.beta(*ends, (studies, players, 1))
    terrain = 0.004 * rng.standard_normal((studies, 1, TERRAINS))
    player = 0.004 * rng.standard_normal((studies, players, 1))
    played = PLAYED_SCORE + player + terrain + 0.008 * rng.standard_normal(shape)
    return played - COLLISION_COST * (rng.random(shape) < rate), terrain[:, 0]


def _kinds() -> tuple[float, float]:
    """The effects of a player of the worse kind and of the others.

    Mean 0 and variance 1 over the population.
    """
    odds = np.sqrt(WORSE_SHARE / (1 - WORSE_SHARE))
    return -1 / odds, odds


def failures(population: ScorePopulation, scores: Floats) -> NDArray[np.bool_]:
    """Which episodes of `simulate_studies` ended in a collision.

    The costs of one are far beyond every other spread.
    """
    lowest = PLAYED_SCORE - COLLISION_COST / 2 if population.collisions else -np.inf
    return np.asarray(scores < lowest)


def mean_steps(population: ScorePopulation) -> float:
    """Return the mean steps to 99 % over players and terrains."""
    share = population.collisions
    return (1 - share) * MEAN_STEPS + share * STEPS_BOUNDS[1]


def steps_of(population: ScorePopulation, scores: Floats, terrain: Floats) -> tuple[Floats, Floats]:
    """The steps to 99 % of simulated episodes, and their true mean on each terrain.

    Steps mirror the score, with a spread of STEPS_SD; a collision counts the limit.
    """
    failed = failures(population, scores)
    middle, spread = (
        (PLAYED_SCORE, PLAYED_SD) if population.collisions else (mean_score(population), 0.03)
    )
    steps_per_score = STEPS_SD / spread
    played = MEAN_STEPS - steps_per_score * (scores + COLLISION_COST * failed - middle)
    steps: Floats = np.where(failed, STEPS_BOUNDS[1], played)
    share = population.collisions
    truth: Floats = (1 - share) * (
        MEAN_STEPS - steps_per_score * terrain.mean(1)
    ) + share * STEPS_BOUNDS[1]
    return steps, truth


def _drawn(shape: str, size: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """Return draws of mean 0 and variance 1 whose long tail, if any, points down."""
    if shape == "exponential":
        return 1 - rng.standard_exponential(size)
    if shape == "lognormal":
        sigma2 = 0.64
        drawn = np.exp(np.sqrt(sigma2) * rng.standard_normal(size))
        spread = np.sqrt((np.exp(sigma2) - 1) * np.exp(sigma2))
        return np.asarray((np.exp(sigma2 / 2) - drawn) / spread)
    return rng.standard_normal(size)


def simulate_policy(mean: float, terrain: Floats, rng: np.random.Generator) -> Floats:
    """A policy's scores float64[studies, TERRAINS].

    Its mean, each terrain's effect, and a deviation of its own.
    """
    values: Floats = mean + terrain + POLICY_SD * rng.standard_normal(terrain.shape)
    return values


def simulate_plan(
    ahead: float, policy_sd: float, studies: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Steps at PAPER of people and of a policy, on the same terrains.

    float64[studies, players, terrains] and float64[studies, terrains]

    Args:
        ahead: steps by which the policy needs fewer in the mean.
        policy_sd: of the policy's steps between terrains.
        studies: simulated.
        rng: draws them.
    """
    shape = (studies, PAPER.players, PAPER.terrains)
    people = PAPER.mean + PAPER.player_sd * rng.standard_normal((studies, PAPER.players, 1))
    people = people + PAPER.episode_sd * rng.standard_normal(shape)
    drawn = rng.standard_normal((studies, PAPER.terrains))
    return people, PAPER.mean - ahead + policy_sd * drawn
