"""What mean cost measures, on players whose slips are known.

`python -m research.methods.cost_validation`

A synthetic player follows the shipped policy and, with a probability of its own, makes a random
valid move instead. Printed are the mean cost of each slip rate and what of it moves gained back,
Spearman's rank correlation of slip rate and the player's mean cost, and how often the interval of a
report covers the true mean: players and terrains are drawn from a pool of played episodes, in which
the mean is known exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import click
import numpy as np
import scipy

from humanplay.report.statistics.intervals import interval
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.cost import CostEstimator
from marsexplorer.intervals import Floats
from marsexplorer.observation import valid_actions
from marsexplorer.policies import Policy, load

SLIP_RATES = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
FIRST_SEED = 8 * 10**12
"""Of the terrains: neither training nor evaluation uses them."""


@dataclass(frozen=True)
class SlipPool:
    """Costs of episodes, and their part below 0.

    float64[slip rates, replicates, terrains]
    """

    rates: tuple[float, ...]
    cost: Floats
    gained: Floats

    def rank_correlation(self) -> float:
        """Spearman's correlation of slip rate and mean cost over players.

        One for each rate and replicate.
        """
        means = self.cost.mean(2)
        rates = np.repeat(np.array(self.rates)[:, None], means.shape[1], axis=1)
        return float(scipy.stats.spearmanr(rates.ravel(), means.ravel()).statistic)

    def coverage(self, players: int, studies: int, rng: np.random.Generator) -> float:
        """Return the share of studies in which the interval holds the true mean, 0..1.

        Each player has a rate drawn at random, and plays the same terrains, which are drawn too.
        """
        rates, replicates, terrains = self.cost.shape
        drawn = rng.integers(rates, size=(studies, players, 1))
        which = rng.integers(replicates, size=(studies, players, terrains))
        met = rng.integers(terrains, size=(studies, 1, terrains))
        low, high = interval(self.cost[drawn, which, met], None)
        truth = self.cost.mean()
        return float(((low <= truth) & (truth <= high)).mean())


def play_with_slips(
    policy: Policy, config: EnvConfig, seed: int, rate: float, rng: np.random.Generator
) -> Episode:
    """Play a terrain with the policy; a move is random and valid with chance `rate`."""
    episode = Episode.begin(config, seed=seed)
    policy.reset(seed)
    while not episode.ended:
        action = policy.act(episode.codes)
        if rng.random() < rate:
            action = int(rng.choice(valid_actions(episode.codes, *episode.position)))
        episode.step(action)
    return episode


def measure_slips(
    config: EnvConfig,
    rates: Sequence[float],
    replicates: int,
    terrains: int,
    seed: int,
    policy: str = "ppo",
) -> SlipPool:
    """The costs of `replicates` players of each rate on the same terrains, by seed."""
    rng, estimator, player = (
        np.random.default_rng(seed),
        CostEstimator(policy),
        load(policy, config.sensor_radius),
    )
    cost = np.zeros((len(rates), replicates, terrains))
    gained = np.zeros_like(cost)
    for at in np.ndindex(cost.shape):
        episode = play_with_slips(player, config, FIRST_SEED + at[2], rates[at[0]], rng)
        costs = estimator.costs(episode.record())
        cost[at], gained[at] = costs.total, costs.gained
    return SlipPool(tuple(rates), cost, gained)


@click.command()
@click.option("--terrains", default=30, show_default=True)
@click.option("--replicates", default=3, show_default=True, help="Players of each slip rate.")
@click.option("--studies", default=2000, show_default=True)
@click.option("--seed", default=0, show_default=True)
def main(terrains: int, replicates: int, studies: int, seed: int) -> None:
    """Print the rank correlation and the interval's coverage, level random at 21x21."""
    pool = measure_slips(EnvConfig(), SLIP_RATES, replicates, terrains, seed)
    rows = zip(pool.rates, pool.cost.mean((1, 2)), pool.gained.mean((1, 2)), strict=True)
    for rate, cost, gained in rows:
        click.echo(
            f"slip rate {rate:4.0%}: mean cost {cost:6.1f} moves an episode, gained {gained:5.1f}"
        )
    click.echo(
        f"rank correlation over {pool.cost[..., 0].size} players: {pool.rank_correlation():.3f}"
    )
    rng = np.random.default_rng(seed)
    for players in (5, 10, 20):
        covered = pool.coverage(players, studies, rng)
        click.echo(
            f"{players} players: the 95 % interval covers the mean in {covered:.1%} of "
            f"{studies} studies"
        )


if __name__ == "__main__":
    main()
