"""How often random movers, and people who slip, get the label `no effort`.

`python -m research.methods.effort_rates`
"""

from __future__ import annotations

import click
import numpy as np

from marsexplorer.config import RUNNING, EnvConfig
from marsexplorer.evaluation.effort import makes_no_effort
from marsexplorer.rules import DISCOVERED
from marsexplorer.world import Worlds, positions
from research.methods.simulated_players import (
    RANDOM_MOVES,
    SIMULATED_POPULATIONS,
    DecisionKernel,
    SimulatedPopulation,
    draw_players,
)

FIRST_SEED = 7 * 10**12
"""Of the terrains: other ones than those of the check's own random episodes."""


def effort_rate(
    config: EnvConfig, population: SimulatedPopulation, episodes: int, seed: int
) -> float:
    """The share of episodes (0..1) that get the label.

    Each is by a player and on a terrain of its own.
    """
    courses = play_courses(config, population, episodes, seed)
    return float(np.mean([makes_no_effort(config, course) for course in courses]))


def play_courses(
    config: EnvConfig, population: SimulatedPopulation, episodes: int, seed: int
) -> list[list[int]]:
    """Return the cells known after each move of as many episodes."""
    rng, worlds = np.random.default_rng(seed), Worlds(config, episodes)
    worlds.start(np.arange(FIRST_SEED, FIRST_SEED + episodes))
    kernel = DecisionKernel((config.rows, config.cols), config.sensor_radius, episodes)
    slip, crash = draw_players(population, episodes, rng).draw_episodes(np.arange(episodes), rng)
    style = slip, crash, rng.integers(0, 2**64, episodes, np.uint64)
    courses: list[list[int]] = [[] for _ in range(episodes)]
    for move in range(config.limit):
        running = np.equal(worlds.outcomes, RUNNING)
        if not running.any():
            break
        worlds.step(
            kernel.decide(
                worlds.codes, positions(worlds.scalars), running, style, np.full(episodes, move)
            )
        )
        for index in np.flatnonzero(running):
            courses[index].append(int(worlds.scalars[index, DISCOVERED]))
    return courses


@click.command()
@click.option("--episodes", default=2000, show_default=True, help="Of each kind of player.")
@click.option("--seed", default=0, show_default=True)
def main(episodes: int, seed: int) -> None:
    """Print the share of episodes labelled, by level and by kind of player."""
    for level, size in (
        ("random", 21),
        ("1-1-1", 21),
        ("3-2-1", 21),
        ("random", 42),
        ("random", 11),
    ):
        config = EnvConfig.of(level, size)
        count = episodes if size <= 21 else episodes // 10
        kinds = (RANDOM_MOVES, *SIMULATED_POPULATIONS.values())
        rates = (f"{kind.name} {effort_rate(config, kind, count, seed):.1%}" for kind in kinds)
        click.echo(f"{level} {size}x{size}: {', '.join(rates)}")


if __name__ == "__main__":
    main()
