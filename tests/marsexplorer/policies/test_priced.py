"""The priced rule is the literal one, ends everywhere, and never needs its guard."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marsexplorer.compiled import read_only
from marsexplorer.config import OBSTACLE, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies.kernels.prices import (
    PricedBoard,
    PriceParameters,
    PriceTables,
    update_board,
)
from marsexplorer.policies.kernels.visibility import VisibilityMap
from marsexplorer.policies.priced import TUNED, FrontierPriced, PricedRule, SizedRule
from tests.support import reference_frontier, strategies

_ODD = PricedRule(PriceParameters((1.5, 0.0, 7.0), (2.0, 1.0, 0.5), 30.0, 2.5, 0.3), 40.0, 0.0, 2.0)
OTHER = SizedRule(_ODD, _ODD, _ODD)
"""Parameters that are nothing like the tuned ones: a low limit, no offset, one square left out."""


def plain(rule):
    """The parameters by name, for the literal rule."""
    return {**vars(rule), **vars(rule.prices)}


@pytest.mark.parametrize(("radius", "rule"), [(2, TUNED), (3, OTHER), (3, TUNED), (4, OTHER)])
def test_the_compiled_rule_is_the_literal_one(radius, rule):
    terrain = np.random.default_rng(radius).random((9, 14)) < 0.2
    terrain[0, 0] = False
    config = EnvConfig("random", 9, 14, sensor_radius=radius, beta=1.0, max_steps=20)
    episode = Episode.begin(config, terrain=terrain)
    policy = FrontierPriced(radius, rule)
    heading = 1
    policy.reset(0)
    while not episode.ended:
        codes, board = episode.codes.copy(), (set(episode.path), episode.position, heading, radius)
        parameters = plain(rule.of(9, 14, radius))
        expected = reference_frontier.decide_priced(codes.tolist(), *board, parameters)
        if expected is None:
            break
        heading = policy.act(episode.observation())
        assert heading == expected, codes
        episode.step(heading)
    assert episode.steps > 10


@pytest.mark.parametrize("rule", [TUNED, OTHER], ids=["tuned", "other"])
@pytest.mark.parametrize(
    ("level", "size"), [("random", (21, 33)), ("3-2-1", (33, 21)), ("1-1-1", (17, 26))]
)
def test_every_terrain_is_explored_and_the_guard_never_acts(level, size, rule):
    config, policy = EnvConfig.of(level, size), FrontierPriced(6, rule)
    for seed in range(5):
        outcome = play_episode(policy, config, seed).outcome
        assert (outcome, policy.guard.overruled) == ("explored", 0), seed


@settings(max_examples=30, deadline=None)
@given(strategies.terrains(max_side=16, max_density=0.5), st.integers(2, 8))
def test_the_rule_sees_all_that_can_be_seen(terrain, radius):
    """What borders on a reachable free cell is known before the candidates run out.

    Unsolvable terrains are included.
    """
    limits = {"beta": 1.0, "max_steps": terrain.size**2}
    config = EnvConfig("random", *terrain.shape, sensor_radius=radius, **limits)
    episode, policy = Episode.begin(config, terrain=terrain), FrontierPriced(radius)
    policy.reset(0)
    visibility = VisibilityMap(terrain.shape, radius)
    while not episode.ended:
        policy.memory.observe(episode.codes)
        visibility.fill(episode.codes)
        reach = reference_frontier.distances(episode.codes.tolist(), episode.position)
        fresh = (cell for cell in reach if policy.memory.visited[cell] == 0)
        if not any(visibility.expected_discoveries(*cell) for cell in fresh):
            break
        episode.step(policy.decide(policy.memory))
    assert episode.outcome in ("explored", "running")
    for row, col in reference_frontier.distances(np.where(terrain, 3, 1).tolist(), (0, 0)):
        around = episode.codes[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
        assert (around != UNKNOWN).all(), (row, col)


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_what_is_kept_of_a_board_is_what_a_new_board_would_have(rows, cols, radius, seed):
    """Boards may follow each other in any order, also one on which less is known."""
    rng = np.random.default_rng(seed)
    half_sides = PriceTables([TUNED.small.prices], radius).arrays[0]
    followed, before = PricedBoard((rows, cols), radius), np.full((rows, cols), 255, np.uint8)
    for _ in range(4):
        is_other, others = rng.random((rows, cols)) < rng.random(), rng.integers(0, 4, (rows, cols))
        codes = read_only(np.where(is_other, others, before % 4).astype(np.uint8))
        left = update_board(codes, followed.board, half_sides, followed.changed_columns)
        new = PricedBoard((rows, cols), radius)
        assert left == update_board(codes, new.board, half_sides, new.changed_columns)
        assert left == np.count_nonzero(codes == UNKNOWN)
        visibility = VisibilityMap((rows, cols), radius)
        visibility.fill(codes)
        for k in range(2):
            assert (followed.board[2][k] == new.board[2][k]).all()
            assert (followed.board[2][k] == visibility.view[k]).all()
        assert (followed.board[0] == new.board[0]).all()
        assert (followed.board[1] == new.board[1]).all()
        for row in range(rows):
            lines = (before[row], codes[row])
            was, now = ((line == UNKNOWN) + 2 * (line == OBSTACLE) for line in lines)
            changed = np.flatnonzero(was != now).tolist() or [cols, -1]
            assert followed.changed_columns[row].tolist() == [changed[0], changed[-1]]
        before = codes


def test_prices_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="weights, pocket and fade must be 0 or more"):
        PriceParameters((1.0, -1.0, 1.0), (1.0, 1.0, 1.0), 0.0, 1.0, 0.0)
    with pytest.raises(ValueError, match="limit and power must be above 0"):
        PricedRule(TUNED.small.prices, 300.0, 1.0, 0.0)


def test_parameters_change_with_the_logarithm_of_the_side():
    assert TUNED.of(21, 21) == TUNED.of(10, 12) == TUNED.small
    assert TUNED.of(84, 84) == TUNED.of(300, 100) == TUNED.large
    assert TUNED.of(28, 63) == TUNED.middle
    for rows, cols, first, last in (
        (21, 42, TUNED.small, TUNED.middle),
        (42, 84, TUNED.middle, TUNED.large),
    ):
        halfway = TUNED.of(rows, cols)
        assert halfway.power == pytest.approx((first.power + last.power) / 2)
        weights = (rule.prices.weights[1] for rule in (first, last))
        assert halfway.prices.weights[1] == pytest.approx(sum(weights) / 2)
    # A grid is as large as it is in units of the radius.
    assert TUNED.of(14, 14, radius=4) == TUNED.small
    assert TUNED.of(14, 14, radius=2) == TUNED.of(42, 42)
