"""The computed power of the learning test beside that of the report's own test: `python -m research.methods.flat_power`."""

from __future__ import annotations

import click
import numpy as np

from app.report.statistics.learning import assess_learning
from app.report.statistics.planning import derived_margin, plan_study, planned_sds
from app.series.protocol import Protocol, default_protocol
from marsexplorer.config import EnvConfig


def simulate_flat_power(protocol: Protocol, studies: int, rng: np.random.Generator) -> float:
    """Return the share of simulated flat studies that the report's own test (`assess_learning`) calls within the margin."""
    player_sd, episode_sd = planned_sds(protocol)
    shape = (studies, protocol.players, protocol.ranked)
    tables = player_sd * rng.standard_normal((*shape[:2], 1)) + episode_sd * rng.standard_normal(
        shape
    )
    margin = protocol.equivalence_margin
    verdicts = [assess_learning("steps", table, margin).verdict for table in tables]
    return sum(verdict in ("flat", "changed, within the margin") for verdict in verdicts) / studies


@click.command()
@click.option("--studies", type=click.IntRange(min=10), default=500, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
def main(studies: int, seed: int) -> None:
    """Print, for the default protocol, the power of the learning test at some margins: computed, and simulated."""
    click.echo(
        "| players | margin (steps) | computed (%) | simulated (%) |\n| ---: | ---: | ---: | ---: |"
    )
    for players in (5, 10, 20, 30):
        base = default_protocol("plan", EnvConfig(), players=players)
        for margin in (5.0, derived_margin(base) or 0.0):
            protocol = base.model_copy(update={"equivalence_margin": margin})
            rng = np.random.default_rng([seed, players, round(margin)])
            simulated = simulate_flat_power(protocol, studies, rng)
            computed = plan_study(protocol).comparisons[0].power
            click.echo(f"| {players} | {margin:g} | {100 * computed:.1f} | {100 * simulated:.1f} |")


if __name__ == "__main__":
    main()
