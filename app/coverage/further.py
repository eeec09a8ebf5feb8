"""Further measurements on simulated studies: false alarms of the test, coverage of the ratio, the IQM and the mixed model.

Test and ratio are the same test (`app.statistics.comparisons`): of policy - people = 0 for a policy that is as good as people
in the mean, and of policy - ratio people = 0 for the true ratio. Run by `python -m app.coverage` with `--paired`,
`--ratio`, `--iqm` and `--mixed`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.coverage.simulated_studies import generator, mean_score, simulate_policy, simulate_studies
from app.coverage.table import ScorePopulation
from app.statistics.crossed import crossed_p
from app.statistics.intervals import TAIL, printed_interval
from app.statistics.mixed_model import fit_mixed_model
from app.statistics.spread import iqm, iqm_shares

PAIRED_ICCS = (0.0, 0.1, 0.3, 0.5)
POLICY_SCORE = 0.92
"""Mean over all terrains of the policy whose ratio to people is estimated."""

OTHER_PLAYERS = 800
"""Simulated players beside a study's own, whose IQM is the truth on its terrains."""
STUDIES_AT_ONCE = 50
SIMULATED_SLOPE = 0.0005
"""Of learning, in score a trial, where the mixed model is measured."""


def measure_false_alarms(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> float:
    """Return in how many percent of studies p is below 0.05 although policy and people have the same mean over terrains.

    The policy deviates from people on each terrain, by amounts of mean 0 (`simulated_studies.POLICY_SD`).
    """
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    values = simulate_policy(mean_score(population), terrain, rng)
    return 100 * float((crossed_p(values[:, None, :] - scores) < 2 * TAIL).mean())


def measure_ratio(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> float:
    """Return in how many percent of studies the interval of policy / people covers the ratio of the means over terrains."""
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    values = simulate_policy(POLICY_SCORE, terrain, rng)
    truth = POLICY_SCORE / mean_score(population)
    is_kept = crossed_p(values[:, None, :] - truth * scores) >= 2 * TAIL
    has_interval = crossed_p(scores) < 2 * TAIL
    return 100 * float((is_kept & has_interval).mean())


def measure_iqm(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> float:
    """Return in how many percent of studies the IQM's interval covers the IQM of other players on the same terrains."""
    rng, covered = generator(population, icc, players, seed), 0
    for at in range(0, studies, STUDIES_AT_ONCE):
        count = min(STUDIES_AT_ONCE, studies - at)
        scores, _ = simulate_studies(population, icc, players + OTHER_PLAYERS, count, rng)
        low, high = printed_interval(iqm_shares(scores[:, :players]))
        truth = np.array([iqm(others) for others in scores[:, players:]])
        covered += int(((low <= truth) & (truth <= high)).sum())
    return 100 * covered / studies


@dataclass(frozen=True)
class MixedModelCoverage:
    """In how many percent of studies the intervals of the mixed model cover the truth, and in how many it converged.

    mean     over players and terrains; terrains: of the terrains' difficulties
    """

    population: str
    icc: float
    players: int
    studies: int
    converged: float
    mean: float
    slope: float
    terrains: float


def measure_mixed_model(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> MixedModelCoverage:
    """Return how often the mixed model's intervals cover, in studies in which everybody learns alike."""
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    covered: list[tuple[bool, bool, float]] = []
    for table, truth in zip(scores, terrain, strict=True):
        trials = rng.permuted(
            np.tile(np.arange(table.shape[1], dtype=np.float64), (players, 1)), axis=1
        )
        found = fit_mixed_model("score", table + SIMULATED_SLOPE * (trials - trials.mean()), trials)
        if found.interval and found.slope_interval:
            inside = [
                each.interval[0] <= truth[each.terrain] <= each.interval[1]
                for each in found.terrains
            ]
            mean, slope = mean_score(population), SIMULATED_SLOPE
            is_mean = found.interval[0] <= mean <= found.interval[1]
            covered.append(
                (
                    is_mean,
                    found.slope_interval[0] <= slope <= found.slope_interval[1],
                    float(np.mean(inside)),
                )
            )
    shares = 100 * np.array(covered).mean(0)
    return MixedModelCoverage(
        population.name, icc, players, studies, 100 * len(covered) / studies, *map(float, shares)
    )
