"""Mean regret ranks synthetic players by how often they slip, and its interval covers."""

import numpy as np
import pytest

from app.moves.regret_validation import SLIP_RATES, SlipPool, measure_slips
from marsexplorer.config import EnvConfig


def test_who_slips_more_regrets_more():
    pool = measure_slips(EnvConfig("random", 11, 13), (0.0, 0.5), replicates=2, terrains=4, seed=0)
    assert pool.regret[1].mean(1).min() > pool.regret[0].mean(1).max()
    assert pool.rank_correlation() > 0.8  # two players of each rate: the rates are tied


def test_coverage_counts_the_studies_that_hold_the_true_mean():
    regret = np.random.default_rng(0).normal(50, 10, (4, 3, 6)) + 20 * np.arange(4)[:, None, None]
    pool = SlipPool((0.0, 0.1, 0.2, 0.3), regret)
    assert 0.9 < pool.coverage(10, 400, np.random.default_rng(1)) < 1
    flat = SlipPool((0.0, 0.1), np.full((2, 3, 6), 7.0))
    assert flat.coverage(5, 10, np.random.default_rng(1)) == 1


@pytest.mark.long
def test_slip_rates_and_mean_regret_rank_alike_and_the_interval_covers():
    """The figures of docs/evaluation.md."""
    pool = measure_slips(EnvConfig(), SLIP_RATES, replicates=3, terrains=30, seed=0)
    assert pool.rank_correlation() >= 0.9
    for players in (10, 20):
        assert 0.93 <= pool.coverage(players, 2000, np.random.default_rng(players)) <= 0.98
