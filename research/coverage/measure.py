"""What is measured on simulated studies.

Coverage of the printed interval, of the ratio and the IQM, and false alarms of the test.
The truth of a simulated study (`simulated_studies`) is the mean over the population of players
on its own terrains, as in a report; "new terrains" is judged by the mean over terrains as well.
Test and ratio are the same test (`app.report.statistics.comparisons`): of policy - people = 0 for a policy
that is as good as people in the mean, and of policy - ratio people = 0 for the true ratio.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from app.report.measured_coverage import Cell, ScorePopulation
from app.report.statistics.crossed import crossed_interval, crossed_p
from app.report.statistics.intervals import (
    Ends,
    guaranteed_covers,
    is_a_few_players,
    printed_interval,
)
from app.report.statistics.likelihood import TAIL
from app.report.statistics.spread import iqm, iqm_shares
from marsexplorer.intervals import Floats, t_interval
from research.coverage.simulated_studies import (
    SCORE_BOUNDS,
    STEPS_BOUNDS,
    TERRAINS,
    failures,
    generator,
    mean_score,
    simulate_policy,
    simulate_studies,
    steps_of,
)

PAIRED_ICCS = (0.0, 0.1, 0.3, 0.5)
POLICY_SCORE = 0.92
"""Mean over all terrains of the policy whose ratio to people is estimated."""

OTHER_PLAYERS = 800
"""Simulated players beside a study's own, whose IQM is the truth on its terrains."""
STUDIES_AT_ONCE = 250
"""Whose guaranteed intervals are worked on together."""
CROWDED_STUDIES_AT_ONCE = 50
"""Of studies with other players beside their own."""


def measure_cell(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> Cell:
    """Return the coverage in one cell; the same for the same seed."""
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    mean, means = mean_score(population), scores.mean(2)
    truth, everywhere = mean + terrain.mean(1), np.full(studies, mean)
    (t_low, t_high), (low, high) = t_interval(means), printed_interval(means)
    printed, guaranteed = (
        _covers((low, high), truth),
        _guaranteed_covers(means, SCORE_BOUNDS, truth),
    )
    failed = failures(population, scores).sum(2).astype(np.float64)
    is_guaranteed = is_a_few_players(failed, np.full(means.shape, float(TERRAINS)))
    steps, true_steps = steps_of(population, scores, terrain)
    mean_steps = steps.mean(2)
    printed_steps = _covers(printed_interval(mean_steps), true_steps)
    headline_steps = printed_steps.copy()
    if is_guaranteed.any():
        chosen = mean_steps[is_guaranteed], STEPS_BOUNDS, true_steps[is_guaranteed]
        headline_steps[is_guaranteed] = guaranteed_covers(*chosen)
    return Cell(
        population=population.name,
        icc=icc,
        players=players,
        studies=studies,
        printed=_percent(printed),
        below=_percent(truth < low),
        above=_percent(truth > high),
        width=float(np.median((high - low) / (t_high - t_low))),
        t=_percent(_covers((t_low, t_high), truth)),
        guaranteed=_percent(guaranteed),
        new_terrains=_percent(_covers(crossed_interval(scores), everywhere)),
        pooled=_percent(_covers(t_interval(scores.reshape(studies, -1)), truth)),
        guaranteed_headline=_percent(is_guaranteed),
        headline=_percent(np.where(is_guaranteed, guaranteed, printed)),
        headline_steps=_percent(headline_steps),
        printed_steps=_percent(printed_steps),
    )


def _guaranteed_covers(
    means: Floats, bounds: tuple[float, float], truth: Floats
) -> NDArray[np.bool_]:
    """Return in which studies the guaranteed interval covers the truth, worked out some studies at a time."""
    stacks = [slice(at, at + STUDIES_AT_ONCE) for at in range(0, len(means), STUDIES_AT_ONCE)]
    return np.concatenate([guaranteed_covers(means[each], bounds, truth[each]) for each in stacks])


def _covers(ends: Ends, truth: Floats) -> NDArray[np.bool_]:
    covered: NDArray[np.bool_] = (ends[0] <= truth) & (truth <= ends[1])
    return covered


def _percent(is_so: NDArray[np.bool_]) -> float:
    return 100 * float(is_so.mean())


def measure_false_alarms(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> float:
    """Return in how many percent of studies p is below 0.05 although policy and people have the same mean over terrains.

    The policy deviates from people on each terrain, by amounts of mean 0 (`simulated_studies.POLICY_SD`).
    """
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    values = simulate_policy(mean_score(population), terrain, rng)
    return _percent(crossed_p(values[:, None, :] - scores) < 2 * TAIL)


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
    return _percent(is_kept & has_interval)


def measure_iqm(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> float:
    """Return in how many percent of studies the IQM's interval covers the IQM of other players on the same terrains."""
    rng, covered = generator(population, icc, players, seed), 0
    for at in range(0, studies, CROWDED_STUDIES_AT_ONCE):
        count = min(CROWDED_STUDIES_AT_ONCE, studies - at)
        scores, _ = simulate_studies(population, icc, players + OTHER_PLAYERS, count, rng)
        truth = np.array([iqm(others) for others in scores[:, players:]])
        covered += int(_covers(printed_interval(iqm_shares(scores[:, :players])), truth).sum())
    return 100 * covered / studies


def coverage_error(coverage: float, studies: int) -> float:
    """Return the half-width (percentage points) within which a measured coverage lies of the true one, 95 % of the time."""
    share = coverage / 100
    return float(100 * scipy.special.ndtri(1 - TAIL) * np.sqrt(share * (1 - share) / studies))
