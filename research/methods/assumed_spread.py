"""The mean and spread that a new study assumes of people, by synthetic players.

`python -m research.methods.assumed_spread`
"""

from __future__ import annotations

import click
import numpy as np

from humanplay.report.statistics.crossed import crossed_components
from marsexplorer.config import EXPLORED, RUNNING, EnvConfig
from marsexplorer.intervals import Floats
from marsexplorer.rules import STEPS
from marsexplorer.world import Worlds, positions
from research.methods.simulated_players import SIMULATED_POPULATIONS, DecisionKernel, draw_players

FIRST_SEED = 10**6


def steps_of_players(
    config: EnvConfig, population: str, players: int, terrains: int, seed: int
) -> Floats:
    """Steps to 99 % of players on the same terrains, float64[players, terrains].

    NaN for an episode that failed.
    """
    rng, count = np.random.default_rng(seed), players * terrains
    worlds = Worlds(config, count)
    worlds.start(np.tile(np.arange(FIRST_SEED, FIRST_SEED + terrains), players))
    kernel = DecisionKernel((config.rows, config.cols), config.sensor_radius, count)
    skills = draw_players(SIMULATED_POPULATIONS[population], players, rng)
    slip, crash = skills.draw_episodes(np.repeat(np.arange(players), terrains), rng)
    style = slip, crash, rng.integers(0, 2**64, count, np.uint64)
    for move in range(config.limit):
        running = np.equal(worlds.outcomes, RUNNING)
        if not running.any():
            break
        moves = np.full(count, move)
        position = positions(worlds.scalars)
        worlds.step(kernel.decide(worlds.codes, position, running, style, moves))
    has_explored = np.equal(worlds.outcomes, EXPLORED)
    steps = np.where(has_explored, worlds.scalars[:, STEPS].astype(np.float64), np.nan)
    return steps.reshape(players, terrains)


@click.command()
@click.option("--players", default=150, show_default=True)
@click.option("--terrains", default=30, show_default=True)
@click.option("--seed", default=0, show_default=True)
def main(players: int, terrains: int, seed: int) -> None:
    """Print failures, and mean and spread of the other episodes, by population."""
    for population in SIMULATED_POPULATIONS:
        steps = steps_of_players(EnvConfig(), population, players, terrains, seed)
        spread = crossed_components(steps)
        parts = np.array([spread.player, spread.terrain, spread.rest])
        people, of_terrains, rest = np.sqrt(np.maximum(parts, 0.0))
        click.echo(
            f"{population}: {np.isnan(steps).mean():.2%} of episodes failed; mean "
            f"{np.nanmean(steps):.1f}, SD {people:.1f} "
            f"between people, {of_terrains:.1f} between terrains, {rest:.1f} of the rest"
        )


if __name__ == "__main__":
    main()
