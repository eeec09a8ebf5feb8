"""How often the interval of two arms' difference holds the truth, by simulation.

`python -m research.methods.arm_coverage`
"""

from __future__ import annotations

import click

from humanplay.report.measured_coverage import SCORE_POPULATIONS, ScorePopulation
from humanplay.report.statistics.arm_comparisons import difference_of
from marsexplorer.intervals import Floats
from research.coverage.simulated_studies import TERRAINS, generator, simulate_studies
from research.paper.tables import markdown_table

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


def table(studies: int, seed: int) -> str:
    """The coverage (%) of each population, by people in each arm and spread."""
    kinds = [(terrain_sd, players) for terrain_sd in TERRAIN_SDS for players in PLAYERS]
    columns = [
        "population",
        *(f"{players} people, SD between terrains {sd:g}" for sd, players in kinds),
    ]
    rows = []
    for population in SCORE_POPULATIONS:
        shares = [covered_share(population, players, sd, studies, seed) for sd, players in kinds]
        rows.append([population.name, *(f"{100 * share:.1f}" for share in shares)])
    return markdown_table(columns, rows)


@click.command()
@click.option("--studies", default=2000, show_default=True, help="Simulated, of each kind.")
@click.option("--seed", default=0, show_default=True)
def main(studies: int, seed: int) -> None:
    """Print in how many studies of 100 the interval holds the truth.

    By people in each arm, and by how much one arm's advantage differs between terrains.
    """
    click.echo(table(studies, seed))


if __name__ == "__main__":
    main(prog_name="python -m research.methods.arm_coverage")
