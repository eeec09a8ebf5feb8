"""How often the interval of two arms' difference holds the truth, by simulation.

`python -m research.methods.arm_coverage`
"""

from __future__ import annotations

from collections.abc import Iterator

import click

from humanplay.report.measured_coverage import SCORE_POPULATIONS, ScorePopulation
from humanplay.report.statistics.arm_comparisons import difference_of
from marsexplorer.intervals import Floats
from research.coverage.simulated_studies import TERRAINS, generator, simulate_studies

PLAYERS = (5, 10, 20)
"""People in each arm."""
ICC = 0.2
TERRAIN_SDS = (0.0, 0.02)
"""Between terrains, of how much better one arm does on them, in score."""


def simulate_arms(
    population: ScorePopulation, players: int, terrain_sd: float, studies: int, seed: int
) -> tuple[Floats, Floats]:
    """Scores of two arms that do alike: float64[studies, players, TERRAINS] each.

    One does better on some terrains and worse on others, by 0 in the mean over all there are.
    """
    rng = generator(population, ICC, 2 * players, seed)
    scores, _ = simulate_studies(population, ICC, 2 * players, studies, rng)
    better = terrain_sd * rng.standard_normal((studies, 1, TERRAINS))
    return scores[:, :players] + better, scores[:, players:]


def covered_share(
    population: ScorePopulation, players: int, terrain_sd: float, studies: int, seed: int
) -> float:
    """The share of studies (0..1) whose interval holds that there is no difference."""
    low, high = difference_of(
        *simulate_arms(population, players, terrain_sd, studies, seed)
    ).interval
    return float(((low <= 0) & (high >= 0)).mean())


def lines(studies: int, seed: int) -> Iterator[str]:
    """Yield a line for each population: its coverage by people in each arm and spread."""
    for population in SCORE_POPULATIONS:
        shares = [
            f"{100 * covered_share(population, players, terrain_sd, studies, seed):.1f}"
            for terrain_sd in TERRAIN_SDS
            for players in PLAYERS
        ]
        yield f"{population.name:<16}  {'  '.join(f'{share:>5}' for share in shares)}"


@click.command()
@click.option("--studies", default=2000, show_default=True, help="Simulated, of each kind.")
@click.option("--seed", default=0, show_default=True)
def main(studies: int, seed: int) -> None:
    """Print how often the interval holds the truth, by people in each arm."""
    for terrain_sd in TERRAIN_SDS:
        click.echo(f"{terrain_sd:g} between instances, of one arm less the other:", nl=False)
        click.echo(f" {', '.join(map(str, PLAYERS))} people in each arm")
    for line in lines(studies, seed):
        click.echo(line)


if __name__ == "__main__":
    main(prog_name="python -m research.methods.arm_coverage")
