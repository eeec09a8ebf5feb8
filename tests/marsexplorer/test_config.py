"""Configurations and scores."""

from fractions import Fraction

import numpy as np
import pytest

from marsexplorer.config import LEVELS, EnvConfig
from marsexplorer.episode import score, steps_to_target


def test_the_twelve_levels_and_random():
    assert len(LEVELS) == 13
    assert {name for name, level in LEVELS.items() if not level.has_bonus} == {
        f"{t}-{m}-2" for t in "123" for m in "12"
    }


@pytest.mark.parametrize("beta", [0.3, 0.5, 0.95, 0.99, 1.0])
def test_the_target_is_the_fewest_cells_that_reach_beta(beta):
    for rows in range(5, 60):
        config = EnvConfig(rows=rows, cols=rows + 1, beta=beta)
        assert config.target / config.n >= beta
        assert (config.target - 1) / config.n < beta


def test_the_hash_is_that_of_the_canonical_json_and_stays():
    assert EnvConfig().hash == EnvConfig(max_steps=441).hash
    assert EnvConfig(cols=22).hash != EnvConfig(rows=22).hash
    assert EnvConfig(beta=1).hash == EnvConfig(beta=np.float64(1.0)).hash
    assert EnvConfig.of("random", np.int64(9)).hash == EnvConfig.of("random", (9, np.int32(9))).hash
    assert EnvConfig(**EnvConfig.of("1-2-1", (5, 7)).to_dict()) == EnvConfig.of("1-2-1", (5, 7))
    assert EnvConfig().hash == "a5aa6afaaf945098149a4bd31cd20b5afad672e9633dfbf54aacd4f606d7dbe8"


def test_the_score_is_zero_for_an_invalid_first_move_and_one_at_the_maximum():
    config = EnvConfig()
    assert score(config, -441) == 0
    assert score(config, 882) == 1
    assert score(config, -1000) < 0
    unpaid = EnvConfig(level="1-1-2")
    assert score(unpaid, 441) == 1
    assert Fraction(score(config, 441)) == Fraction(2, 3) or abs(score(config, 441) - 2 / 3) < 1e-15


def test_an_unfinished_episode_counts_all_its_steps():
    assert steps_to_target(EnvConfig(), "explored", 63) == 63
    assert steps_to_target(EnvConfig(), "collided", 5) == 441


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"rows": 3}, ValueError, "rows must be at least 5, got 3"),
        ({"cols": "21"}, TypeError, "cols must be a whole number, got '21'"),
        ({"rows": True}, TypeError, "whole number"),
        ({"sensor_radius": 0}, ValueError, "sensor_radius must be at least 1, got 0"),
        ({"sensor_radius": 32}, ValueError, "at most 31"),
        ({"beta": 1.01}, ValueError, "beta must be a number above 0 and at most 1"),
        ({"max_steps": 0}, ValueError, "max_steps must be at least 1"),
        ({"level": "hard"}, ValueError, "no level 'hard'; choose one of: random, 1-1-1"),
    ],
)
def test_a_bad_value_says_what_was_expected(options, error, says):
    with pytest.raises(error, match=says):
        EnvConfig(**options)
