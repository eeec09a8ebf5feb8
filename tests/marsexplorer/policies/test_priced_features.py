"""What a network that sees prices is given and begins with."""

import math
from functools import cache

import numpy as np
import pytest
import torch

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.rollouts import GreedyRollouts
from marsexplorer.policies import load
from marsexplorer.policies.network.features import ACTION_FEATURES, FeatureExtractor
from marsexplorer.policies.network.priced_features import LEAST_SHARE, PRICED_FEATURES, RULES
from marsexplorer.training.network import Net
from marsexplorer.training.prior import size_nearness
from tests.support import reference_frontier as literal
from tests.support.policy_files import playing

RADIUS = 3


def explored(rows, cols, steps):
    """An episode after some random moves, and the cells visited."""
    episode = Episode.begin(EnvConfig("random", rows, cols, sensor_radius=RADIUS), seed=4)
    rng = np.random.default_rng(2)
    while episode.steps < steps:
        row, col = episode.position
        beyond = np.pad(episode.codes, 1, constant_values=3)
        near = [beyond[row + 1 + r, col + 1 + c] for r, c in literal.DISPLACEMENTS]
        free = [action for action, code in enumerate(near) if code != 3]
        episode.step(int(rng.choice(free)))
    return episode


def numbers(codes, position, path):
    """The numbers of each move, float32[4, ...]."""
    rows, cols = codes.shape
    visited = np.zeros((1, rows * cols), np.uint8)
    for row, col in path:
        visited[0, row * cols + col] = 1
    cell = np.array([position[0] * cols + position[1]])
    extractor = FeatureExtractor(1, rows, cols, RADIUS)
    return extractor(codes[None], cell, visited, np.array([1]))[1][0]


def literal_values(grid, visited, rover, rule):
    """For each action the highest value that it leads to and the way, by definition."""
    reach, best_values = literal.distances(grid, rover), [(0.0, 0)] * 4
    plain = {**vars(rule), **vars(rule.prices)}
    priced = cache(lambda u: literal.price(grid, u, RADIUS, plain))
    for cell, way in reach.items():
        shown = [] if cell in visited else literal.expected_cells(grid, *cell, RADIUS)
        if not shown:
            continue
        total = sum(priced(u) * literal.fade(u, cell, RADIUS, plain) for u in shown)
        value = min(total, round(rule.limit * 1024 * 64)) * (way + rule.offset) ** -rule.power
        back = literal.distances(grid, cell)
        for action, (d_row, d_col) in enumerate(literal.DISPLACEMENTS):
            if back.get((rover[0] + d_row, rover[1] + d_col)) == way - 1:
                best_values[action] = max(
                    best_values[action], (value, way), key=lambda pair: pair[0]
                )
    return best_values


@pytest.mark.parametrize("steps", [9, 30, 60])
def test_the_numbers_are_those_of_the_definition(steps):
    rows, cols = 13, 18
    episode = explored(rows, cols, steps)
    grid, visited = episode.codes.tolist(), set(episode.path)
    moves = numbers(episode.codes, episode.position, episode.path)
    for k, rule in enumerate(RULES):
        values_and_ways = literal_values(grid, visited, episode.position, rule)
        best = max(value for value, _ in values_and_ways)
        for action, (value, way) in enumerate(values_and_ways):
            share, expected = value / best, [0.0] * 3
            if share > LEAST_SHARE and moves[action, 0] > 0:
                over = (share - LEAST_SHARE) / (1 - LEAST_SHARE)
                expected = [over, float(value == best), 0.3 * math.log(1 + way)]
            first = ACTION_FEATURES + 3 * k
            priced_numbers = moves[action, first : first + 3]
            assert priced_numbers == pytest.approx(expected, abs=1e-6), (k, action)
    assert moves[:, -1] == pytest.approx(0.2 * math.log(rows * cols) * moves[:, 0])
    assert moves.shape == (4, ACTION_FEATURES + PRICED_FEATURES)


def test_a_transposed_board_has_the_same_numbers_for_the_transposed_moves():
    episode = explored(21, 30, 12)
    there = numbers(episode.codes, episode.position, episode.path)
    codes, path = np.ascontiguousarray(episode.codes.T), [cell[::-1] for cell in episode.path]
    turned = numbers(codes, episode.position[::-1], path)
    assert np.array_equal(there[::-1, ACTION_FEATURES:], turned[:, ACTION_FEATURES:])


def test_the_prior_is_linear_between_the_sides_that_it_has_weights_for():
    cells = torch.tensor([5.0 * 5, 21 * 21, 29.698**2, 42 * 42, 84 * 84, 128 * 128])
    expected = [[1, 0, 0], [1, 0, 0], [0.5, 0.5, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]]
    assert torch.allclose(size_nearness(cells.log()), torch.tensor(expected), atol=1e-4)


@pytest.mark.parametrize(("side", "rules"), [(15, ()), (21, ()), (30, (0, 1, 2)), (84, (1,))])
def test_rules_on_which_nothing_depends_are_not_priced_and_logits_and_values_stay_the_same(
    side, rules
):
    """Bit by bit, but for 84 x 84, where rounding gives a ten-millionth."""
    far = 1e-5 if side == 84 else 0.0
    net, config = load("ppo").net, EnvConfig("random", side, side)
    assert net.rules_that_count(side, side) == rules
    all_rules, few_rules = (GreedyRollouts(config, 2), GreedyRollouts(config, 2, rules))
    for rollouts in (all_rules, few_rules):
        rollouts.worlds.start(np.arange(2))
    for _ in range(30):
        decisions = all_rules.decide(net), few_rules.decide(net)
        assert np.abs(decisions[0].logits - decisions[1].logits).max() <= far
        values = [net.infer(decision.planes, decision.moves)[1] for decision in decisions]
        assert np.abs(values[0] - values[1]).max() <= far
        assert (decisions[1].moves[:, :, -1] == decisions[0].moves[:, :, -1]).all()
        for rollouts in (all_rules, few_rules):
            rollouts.step(decisions[0].actions)


def test_a_rule_counts_where_any_weight_of_its_numbers_is_not_zero(tmp_path):
    net, numbers = Net().eval(), ACTION_FEATURES + PRICED_FEATURES
    with torch.no_grad():
        net.prior[0] = 0.0
        net.policy_head[0].weight[:, 128 + ACTION_FEATURES : 128 + numbers] = 0.0
        for move in range(4):
            first = 128 + numbers * move
            net.value_head[0].weight[:, first + ACTION_FEATURES : first + numbers] = 0.0
    assert playing(net, tmp_path).rules_that_count(21, 21) == ()
    with torch.no_grad():
        net.value_head[0].weight[3, 128 + 2 * numbers + ACTION_FEATURES + 8] = 1e-9
    assert playing(net, tmp_path).rules_that_count(21, 21) == (2,)
    with torch.no_grad():
        net.policy_head[0].weight[5, 128 + ACTION_FEATURES] = 1e-9
        net.policy_head[0].weight[6, 128 + ACTION_FEATURES + 4] = 1e-9
    assert playing(net, tmp_path).rules_that_count(21, 21) == (0, 1, 2)
    assert playing(net, tmp_path).rules_that_count(84, 84) == (0, 1, 2)
