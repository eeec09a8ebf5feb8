"""The true level of a population on given terrains: its mean score and steps, from many episodes; whole studies in memory.

An interval that a report prints is an estimate from ten people; here the number it estimates is computed to a hundredth
of that width, so the report can be checked against it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.simulate.decisions import DecisionKernel
from app.simulate.population import SimulatedPopulation, draw_players
from marsexplorer.config import OUTCOMES, EnvConfig
from marsexplorer.rules import DISCOVERED, STEPS
from marsexplorer.score import score, steps_to_target
from marsexplorer.world import Worlds, positions, totals

BOARDS_AT_A_TIME = 1000
"""The number of boards that are stepped together."""


@dataclass(frozen=True)
class SimulatedEpisodes:
    """Episodes, one entry each: outcome (code), normalized score, steps to 99 %, moves, discovered cells, return."""

    outcome: NDArray[np.uint8]
    score: NDArray[np.float64]
    steps_to_99: NDArray[np.int64]
    steps: NDArray[np.int64]
    discovered: NDArray[np.int64]
    total: NDArray[np.float64]

    def shaped(self, *shape: int) -> SimulatedEpisodes:
        """Return the same episodes as arrays of another shape."""
        return SimulatedEpisodes(
            self.outcome.reshape(shape), self.score.reshape(shape), self.steps_to_99.reshape(shape),
            self.steps.reshape(shape), self.discovered.reshape(shape), self.total.reshape(shape),
        )  # fmt: skip


@dataclass(frozen=True)
class TrueLevel:
    """A population's true level on some terrains; *_error is the standard error of the simulation, not of a study."""

    episodes: int
    mean_score: float
    score_error: float
    mean_steps: float
    steps_error: float
    collisions: float


def play_episodes(
    config: EnvConfig,
    seeds: Sequence[int],
    slip: NDArray[np.float64],
    crash: NDArray[np.float64],
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
) -> SimulatedEpisodes:
    """Play one episode for each seed, with the player's slip and crash at the same index.

    progress  called with (episodes played, episodes in all)
    """
    parts = []
    streams = rng.integers(0, 2**64, len(seeds), np.uint64)
    for at in range(0, len(seeds), BOARDS_AT_A_TIME):
        stack = slice(at, at + BOARDS_AT_A_TIME)
        parts.append(_play_stack(config, seeds[stack], (slip[stack], crash[stack], streams[stack])))
        if progress:
            progress(min(at + BOARDS_AT_A_TIME, len(seeds)), len(seeds))
    outcome, score_, to_99, steps, discovered, total = (
        np.concatenate(each) for each in zip(*parts, strict=True)
    )
    return SimulatedEpisodes(outcome, score_, to_99, steps, discovered, total)


def _play_stack(
    config: EnvConfig,
    seeds: Sequence[int],
    style: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint64]],
) -> tuple[NDArray[np.generic], ...]:
    worlds = Worlds(config, len(seeds))
    worlds.start(np.array(seeds, np.uint64))
    kernel = DecisionKernel((config.rows, config.cols), config.sensor_radius, len(seeds))
    while (is_running := worlds.outcomes == 0).any():
        moves = worlds.scalars[:, STEPS].astype(np.int64)
        worlds.step(
            kernel.decide(worlds.codes, positions(worlds.scalars), is_running, style, moves)
        )
    total = totals(config, worlds.scalars)
    steps = worlds.scalars[:, STEPS].astype(np.int64)
    scores = np.array([score(config, each) for each in total])
    to_99 = np.array(
        [
            steps_to_target(config, OUTCOMES[code], int(made))
            for code, made in zip(worlds.outcomes, steps, strict=True)
        ]
    )
    return (
        worlds.outcomes.copy(),
        scores,
        to_99,
        steps,
        worlds.scalars[:, DISCOVERED].astype(np.int64),
        total,
    )


def true_level(
    config: EnvConfig,
    seeds: Sequence[int],
    population: SimulatedPopulation,
    episodes: int = 10_000,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> TrueLevel:
    """Return the mean over players of a population on the terrains of `seeds`, each episode by a player of its own.

    Every terrain is played equally often, to one episode, so the mean over episodes is the mean over players and terrains.
    """
    if episodes < 2:
        raise ValueError(f"episodes must be at least 2, got {episodes}")
    rng = np.random.default_rng([seed, 1])
    skills = draw_players(population, episodes, rng)
    terrains = [seeds[i % len(seeds)] for i in range(episodes)]
    played = play_episodes(
        config, terrains, *skills.draw_episodes(np.arange(episodes), rng), rng, progress
    )
    root = np.sqrt(episodes)
    crashed = np.isin(played.outcome, [OUTCOMES.index("collided"), OUTCOMES.index("out_of_bounds")])
    return TrueLevel(
        episodes,
        float(played.score.mean()),
        float(played.score.std(ddof=1) / root),
        float(played.steps_to_99.mean()),
        float(played.steps_to_99.std(ddof=1) / root),
        float(crashed.mean()),
    )


def play_studies(
    config: EnvConfig,
    seeds: Sequence[int],
    population: SimulatedPopulation,
    shape: tuple[int, int],
    seed: int = 0,
) -> SimulatedEpisodes:
    """Play whole studies in memory; every array of the result has the shape (studies, players, terrains).

    shape  (studies, players); every player meets every terrain once, and no two studies share a player
    """
    count, players = shape
    rng = np.random.default_rng([seed, 2])
    skills = draw_players(population, count * players, rng)
    who = np.repeat(np.arange(count * players), len(seeds))
    played = play_episodes(
        config, [*seeds] * (count * players), *skills.draw_episodes(who, rng), rng
    )
    return played.shaped(count, players, len(seeds))
