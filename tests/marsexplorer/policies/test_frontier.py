"""The frontier rules are the literal ones, and always see all that can be seen."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies.kernels.visibility import VisibilityMap
from tests.support import reference_frontier, strategies


def board(text):
    """uint8 codes from rows of `?` unknown, `.` free, `@` rover, `#` obstacle."""
    return np.array([["?.@#".index(cell) for cell in row] for row in text.split()], np.uint8)


def steps_through(terrain, radius, name, limit=400):
    """Yield (codes, visited, position, heading, action) along an episode."""
    config = EnvConfig("random", *terrain.shape, sensor_radius=radius, beta=1.0, max_steps=limit)
    episode, policy = Episode.begin(config, terrain=terrain), policies.load(name, radius)
    policy.reset(0)
    heading = 1
    while not episode.ended:
        codes = episode.codes.copy()
        action = policy.act(episode.observation())
        yield codes, set(episode.path), episode.position, heading, action
        episode.step(action)
        heading = action


@settings(max_examples=40, deadline=None)
@given(
    strategies.terrains(max_side=9, max_density=0.4),
    st.integers(1, 5),
    st.sampled_from(["cost", "utility"]),
)
def test_the_compiled_rules_are_the_literal_ones(terrain, radius, rule):
    for codes, *board, action in steps_through(terrain, radius, f"frontier-{rule}"):
        expected = reference_frontier.decide(codes.tolist(), *board, radius, rule)
        if expected is None:
            return
        assert action == expected, codes


@settings(max_examples=20, deadline=None)
@given(strategies.terrains(max_side=70, max_density=0.4), st.integers(1, 31), st.data())
def test_the_expected_discoveries_are_the_literal_count(terrain, radius, data):
    rows, cols = terrain.shape
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    codes = np.where(terrain, 3, 1).astype(np.uint8)
    codes[rng.random((rows, cols)) < 0.4] = 0
    visibility = VisibilityMap((rows, cols), radius)
    visibility.fill(codes)
    row, col = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, cols - 1))
    codes[row, col] = 1
    visibility.fill(codes)
    literal = reference_frontier.expected_discoveries(codes.tolist(), row, col, radius)
    assert visibility.expected_discoveries(row, col) == literal


@settings(max_examples=25, deadline=None)
@given(
    strategies.terrains(max_side=11, max_density=0.5),
    st.integers(1, 8),
    st.sampled_from(["cost", "utility"]),
)
def test_a_rule_sees_all_that_can_be_seen_and_wanders_no_more_than_it_must(terrain, radius, rule):
    """A rule first sees what reachable free cells see, on unsolvable terrains too."""
    n = terrain.size
    seen = None
    for codes, *board, _ in steps_through(terrain, radius, f"frontier-{rule}", limit=n * n):
        if reference_frontier.decide(codes.tolist(), *board, radius, rule) is None:
            seen = codes
            break
    if seen is None or radius == 1:
        return  # all of it was explored (or corners stay dark, as they must)
    truth = np.where(terrain, 3, 1)
    for row, col in reference_frontier.distances(truth.tolist(), (0, 0)):
        around = seen[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
        assert (around != 0).all(), (row, col)


@pytest.mark.parametrize("name", ["frontier-cost", "frontier-utility"])
def test_with_nothing_left_to_see_the_moves_stay_valid(name):
    codes = board("?##.... ##..... .@..... ####### ???????")
    codes[0, 0] = 0
    policy = policies.load(name, 3)
    policy.reset(3)
    for _ in range(3):
        assert policy.act(codes) in (1, 3)


@pytest.mark.parametrize("name", ["frontier-cost", "frontier-utility", "frontier-priced"])
def test_a_rule_says_which_cell_it_goes_to(name):
    policy = policies.load(name, 3)
    episode = Episode.begin(EnvConfig("random", 9, 13, sensor_radius=3), seed=5)
    assert policies.goal_of(policy) is None
    policy.reset(0)
    while not episode.ended:
        grid, rover, visited = episode.codes.tolist(), episode.position, set(episode.path)
        reach = reference_frontier.distances(grid, rover)
        episode.step(policy.act(episode.codes))
        goal = policies.goal_of(policy)
        assert reference_frontier.distances(grid, goal)[episode.position] == reach[goal] - 1
        new = {cell: reference_frontier.expected_discoveries(grid, *cell, 3) for cell in reach}
        shows = [cell for cell, cells in new.items() if cells and cell not in visited]
        assert goal in shows
        if name == "frontier-cost":
            near = (cell for cell in shows if reference_frontier.touches_unknown(grid, cell))
            assert reach[goal] == min(reach[cell] for cell in near)
    policy.act(np.where(episode.codes == 0, 1, episode.codes))  # nothing is left to see
    assert policies.goal_of(policy) is None
    policy.reset(0)
    assert policies.goal_of(policy) is None


def test_policies_that_choose_moves_have_no_goal():
    for name in ("random", "ppo"):
        policy, episode = policies.load(name), Episode.begin(EnvConfig("random", 9, 13), seed=5)
        policy.reset(0)
        policy.act(episode.codes)
        assert policies.goal_of(policy) is None
