"""What is measured on simulated studies.

Coverage of the interval and of the ratio, false alarms and power of the test. The truth of a
simulated study (`simulated_studies`) is the mean over players and terrains; for these terrains,
over players alone. Test and ratio are the same test (`humanplay.report.statistics.comparisons`): of
policy - people = 0, and of policy - ratio people = 0 for the true ratio.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from humanplay.report.measured_coverage import Cell, ScorePopulation
from humanplay.report.statistics.intervals import Ends, interval, p_value
from humanplay.report.statistics.likelihood import TAIL
from marsexplorer.intervals import Floats, t_interval
from research.coverage.simulated_studies import (
    PAPER,
    SCORE_BOUNDS,
    STEPS_BOUNDS,
    generator,
    mean_score,
    mean_steps,
    simulate_plan,
    simulate_policy,
    simulate_studies,
    steps_of,
)

PAIRED_ICCS = (0.0, 0.1, 0.3, 0.5)
POLICY_SCORE = 0.92
"""Mean over all terrains of the policy whose ratio to people is estimated."""


def measure_cell(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> Cell:
    """Return the coverage in one cell; the same for the same seed."""
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    steps, own_steps = steps_of(population, scores, terrain)
    mean, limit = mean_score(population), STEPS_BOUNDS[1]
    lowest = SCORE_BOUNDS[0]
    drawn = interval(steps, limit)
    plain = t_interval(steps.mean(2))
    return Cell(
        population=population.name,
        icc=icc,
        players=players,
        studies=studies,
        score=_percent(_covers(interval(scores, lowest), np.full(studies, mean))),
        steps=_percent(_covers(drawn, np.full(studies, mean_steps(population)))),
        own_score=_percent(
            _covers(interval(scores, lowest, terrains_drawn=False), mean + terrain.mean(1))
        ),
        own_steps=_percent(_covers(interval(steps, limit, terrains_drawn=False), own_steps)),
        width=float(np.median((drawn[1] - drawn[0]) / (plain[1] - plain[0]))),
        pooled=_percent(_covers(t_interval(scores.reshape(studies, -1)), mean + terrain.mean(1))),
    )


def _covers(ends: Ends, truth: Floats) -> NDArray[np.bool_]:
    covered: NDArray[np.bool_] = (ends[0] <= truth) & (truth <= ends[1])
    return covered


def _percent(is_so: NDArray[np.bool_]) -> float:
    return 100 * float(is_so.mean())


def measure_false_alarms(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> float:
    """The per cent of studies with p below 0.05 although the means are equal.

    The means over terrains of policy and people.

    The policy deviates from people on each terrain, by amounts of mean 0
    (`simulated_studies.POLICY_SD`).
    """
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    values = simulate_policy(mean_score(population), terrain, rng)
    p = p_value(values[:, None, :] - scores, values - SCORE_BOUNDS[0])
    return _percent(p < 2 * TAIL)


def measure_ratio(
    population: ScorePopulation, icc: float, players: int, studies: int, seed: int
) -> float:
    """The per cent of studies whose interval of policy / people covers the ratio.

    The ratio of the means over terrains.
    """
    rng = generator(population, icc, players, seed)
    scores, terrain = simulate_studies(population, icc, players, studies, rng)
    values = simulate_policy(POLICY_SCORE, terrain, rng)
    truth, lowest = POLICY_SCORE / mean_score(population), SCORE_BOUNDS[0]
    is_kept = p_value(values[:, None, :] - truth * scores, values - truth * lowest) >= 2 * TAIL
    return _percent(is_kept & (p_value(scores, lowest) < 2 * TAIL))


def measure_width(unseen: float, studies: int, seed: int) -> float:
    """The interval's width over the t interval's, at the paper's spreads; means."""
    rng = np.random.default_rng([seed, 1])
    people, _ = simulate_plan(0.0, 0.0, studies, rng)
    low, high = interval(people, PAPER.limit, unseen=unseen)
    plain = t_interval(people.mean(2))
    return float((high - low).mean() / (plain[1] - plain[0]).mean())


def measure_power(
    ahead: float, policy_sd: float, level: float, unseen: float, studies: int, seed: int
) -> float:
    """The per cent of studies at the paper's spreads that see a difference.

    A difference is seen on its side.

    Args:
        ahead: steps by which the policy needs fewer than people; below 0 it needs more.
        policy_sd: of the policy's steps on a terrain, beside people's.
        level: that p has to be below.
        unseen: see `intervals.UNSEEN`.
        studies: simulated.
        seed: of the studies.
    """
    rng = np.random.default_rng([seed, 2])
    people, policy = simulate_plan(ahead, policy_sd, studies, rng)
    differences = policy[:, None, :] - people
    p = p_value(differences, policy - PAPER.limit, unseen=unseen)
    return _percent((p < level) & (np.sign(differences.mean((1, 2))) == -np.sign(ahead)))


def coverage_error(coverage: float, studies: int) -> float:
    """The half-width (percentage points) of a measured coverage's 95 % interval."""
    share = coverage / 100
    return float(100 * scipy.special.ndtri(1 - TAIL) * np.sqrt(share * (1 - share) / studies))
