"""What is measured on simulated studies.

Coverage of the printed interval, of the ratio, the IQM and the mixed model, and false alarms of the
test. The truth of a simulated study (`simulated_studies`) is the mean over the population of players
on its own terrains, as in a report; "new terrains" is judged by the mean over terrains as well.
Test and ratio are the same test (`app.statistics.comparisons`): of policy - people = 0 for a policy
that is as good as people in the mean, and of policy - ratio people = 0 for the true ratio.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from app.report.measured_coverage import Cell, ScorePopulation
from app.statistics.crossed import crossed_interval, crossed_p
from app.statistics.headline import is_a_few_players
from app.statistics.intervals import TAIL, Ends, guaranteed_covers, printed_interval
from app.statistics.mixed_model import fit_mixed_model
from app.statistics.spread import iqm, iqm_shares
from marsexplorer.evaluation.intervals import Floats, t_interval
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
SIMULATED_SLOPE = 0.0005
"""Of learning, in score a trial, where the mixed model is measured."""


def measure_cell(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> Cell:
    """Return the coverage in one cell; the same for the same seed."""
    scores, terrain = simulate_studies(
        population, icc, players, studies, generator(population, icc, players, seed)
    )
    truth, everywhere = (
        mean_score(population) + terrain.mean(1),
        np.full(studies, mean_score(population)),
    )
    means = scores.mean(2)
    t, printed = t_interval(means), printed_interval(means)
    stacks = [slice(at, at + STUDIES_AT_ONCE) for at in range(0, studies, STUDIES_AT_ONCE)]
    guaranteed = np.concatenate(
        [guaranteed_covers(means[stack], SCORE_BOUNDS, truth[stack]) for stack in stacks]
    )
    is_guaranteed = is_a_few_players(
        failures(population, scores).sum(2).astype(np.float64),
        np.full(means.shape, float(TERRAINS)),
    )
    steps_covered, headline_steps_covered = _steps_covered(
        population, scores, terrain, is_guaranteed
    )
    return Cell(
        population=population.name,
        icc=icc,
        players=players,
        studies=studies,
        printed=_percent_covered(printed, truth),
        below=100 * float((truth < printed[0]).mean()),
        above=100 * float((truth > printed[1]).mean()),
        width=float(np.median((printed[1] - printed[0]) / (t[1] - t[0]))),
        t=_percent_covered(t, truth),
        guaranteed=100 * float(guaranteed.mean()),
        new_terrains=_percent_covered(crossed_interval(scores), everywhere),
        pooled=_percent_covered(_pooled(scores), truth),
        guaranteed_headline=100 * float(is_guaranteed.mean()),
        headline=100
        * float(np.where(is_guaranteed, guaranteed, _is_covered(printed, truth)).mean()),
        headline_steps=headline_steps_covered,
        printed_steps=steps_covered,
    )


def _steps_covered(
    population: ScorePopulation, scores: Floats, terrain: Floats, is_guaranteed: NDArray[np.bool_]
) -> tuple[float, float]:
    """Return how often (percent) the printed interval and the headline of steps to 99 % cover the truth."""
    steps, truth = steps_of(population, scores, terrain)
    means = steps.mean(2)
    printed, headline = _is_covered(printed_interval(means), truth), np.ones(len(means), bool)
    if is_guaranteed.any():
        headline[is_guaranteed] = guaranteed_covers(
            means[is_guaranteed], STEPS_BOUNDS, truth[is_guaranteed]
        )
    return 100 * float(printed.mean()), 100 * float(
        np.where(is_guaranteed, headline, printed).mean()
    )


def _pooled(scores: Floats) -> Ends:
    return t_interval(scores.reshape(len(scores), -1))


def _percent_covered(ends: Ends, truth: Floats) -> float:
    return 100 * float(_is_covered(ends, truth).mean())


def _is_covered(ends: Ends, truth: Floats) -> NDArray[np.bool_]:
    covered: NDArray[np.bool_] = (ends[0] <= truth) & (truth <= ends[1])
    return covered


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
    for at in range(0, studies, CROWDED_STUDIES_AT_ONCE):
        count = min(CROWDED_STUDIES_AT_ONCE, studies - at)
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


def coverage_error(coverage: float, studies: int) -> float:
    """Return the half-width (percentage points) within which a measured coverage lies of the true one, 95 % of the time."""
    share = coverage / 100
    return float(100 * scipy.special.ndtri(1 - TAIL) * np.sqrt(share * (1 - share) / studies))
