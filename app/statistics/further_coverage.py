"""Further measurements on simulated studies: false alarms of the test, coverage of the ratio's and of the IQM's interval.

Test and ratio are the same test (`app.statistics.comparisons`): of policy - people = 0 for a policy that is as good as people
in the mean, and of policy - ratio people = 0 for the true ratio. Run by `python -m app.statistics.coverage` with `--paired`,
`--ratio` and `--iqm`.
"""

from __future__ import annotations

import numpy as np

from app.statistics.coverage_table import ScorePopulation
from app.statistics.crossed import crossed_p
from app.statistics.intervals import TAIL, printed_interval
from app.statistics.simulated_studies import generator, mean_score, simulate_policy, simulate_studies
from app.statistics.spread import iqm, iqm_shares

PAIRED_ICCS = (0.0, 0.1, 0.3, 0.5)
POLICY_SCORE = 0.92
"""Mean over all terrains of the policy whose ratio to people is estimated."""

OTHER_PLAYERS = 800
"""Simulated players beside a study's own, whose IQM is the truth on its terrains."""
STUDIES_AT_ONCE = 50


def measure_false_alarms(population: ScorePopulation, icc: float, players: int, studies: int, seed: int) -> float:
    """Return in how many percent of studies p is below 0.05 although policy and people have the same mean over terrains.

    The policy deviates from people on each terrain, by amounts of mean 0 (`simulated_studies.POLICY_SD`).
    """
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    values = simulate_policy(mean_score(population), terrain, rng)
    return 100 * float((crossed_p(values[:, None, :] - scores) < 2 * TAIL).mean())


def measure_ratio(population: ScorePopulation, icc: float, players: int, studies: int, seed: int) -> float:
    """Return in how many percent of studies the interval of policy / people covers the ratio of the means over terrains."""
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    values = simulate_policy(POLICY_SCORE, terrain, rng)
    truth = POLICY_SCORE / mean_score(population)
    is_kept = crossed_p(values[:, None, :] - truth * scores) >= 2 * TAIL
    has_interval = crossed_p(scores) < 2 * TAIL
    return 100 * float((is_kept & has_interval).mean())


def measure_iqm(population: ScorePopulation, icc: float, players: int, studies: int, seed: int) -> float:
    """Return in how many percent of studies the IQM's interval covers the IQM of other players on the same terrains."""
    rng, covered = generator(population, icc, players, seed), 0
    for at in range(0, studies, STUDIES_AT_ONCE):
        count = min(STUDIES_AT_ONCE, studies - at)
        scores, _ = simulate_studies(population, icc, players + OTHER_PLAYERS, count, rng)
        low, high = printed_interval(iqm_shares(scores[:, :players]))
        truth = np.array([iqm(others) for others in scores[:, players:]])
        covered += int(((low <= truth) & (truth <= high)).sum())
    return 100 * covered / studies
