"""Looking ahead: terrains, imagined looks, and moves that follow from the record."""

import logging
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from marsexplorer import policies
from marsexplorer.bitmap import pack
from marsexplorer.config import FREE, OBSTACLE, ROVER, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies.kernels.posterior import move_chains, posterior_chains, rectangles_of
from marsexplorer.policies.kernels.prices import PricedBoard, update_board
from marsexplorer.policies.kernels.rollouts import look_round
from marsexplorer.terrain import generate

CONFIG = EnvConfig.of("random", 14)


def is_kept(blocked):
    """Whether the generator keeps a terrain that is seen but for 1 %, by hand."""
    if blocked[0, 0]:
        return False
    reached, waiting = {(0, 0)}, [(0, 0)]
    while waiting:
        r, c = waiting.pop()
        for near in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
            inside = 0 <= near[0] < blocked.shape[0] and 0 <= near[1] < blocked.shape[1]
            if inside and not blocked[near] and near not in reached:
                reached.add(near)
                waiting.append(near)
    padded = np.pad(~blocked, 1)
    near_free = np.logical_or.reduce(
        [np.roll(padded, shift, (0, 1)) for shift in product((-1, 0, 1), repeat=2)]
    )[1:-1, 1:-1]
    return len(reached) == (~blocked).sum() and near_free.sum() >= 0.99 * blocked.size


def test_terrains_have_the_distribution_that_counting_them_all_gives():
    rows, cols = shape = (7, 8)
    assert rectangles_of(rows * cols) == 2
    codes = np.full(shape, UNKNOWN, np.uint8)
    codes[:4, :4], codes[0, 0], codes[3, 3], codes[6, 7] = FREE, ROVER, OBSTACLE, FREE

    # 1. Every pair of rectangles, weighed as the generator draws them.
    alone = []
    for height, width in product((1, 2, 3), repeat=2):
        places = list(product(range(rows - height + 1), range(cols - width + 1)))
        for top, left in places:
            cells = np.zeros(shape, np.bool_)
            cells[top : top + height, left : left + width] = True
            alone.append((cells, 1 / len(places)))
    total, share = 0.0, np.zeros(shape)
    for (one, weight), (other, more) in product(alone, repeat=2):
        blocked = one | other
        agrees = blocked[3, 3] and not blocked[(codes == FREE) | (codes == ROVER)].any()
        if agrees and is_kept(blocked):
            total += weight * more
            share += weight * more * blocked

    # 2. The chains, from one state on.
    chains, state = posterior_chains(shape, 50), np.array([7], np.uint64)
    drawn, count = np.zeros(shape), 0
    for _ in range(200):
        move_chains(chains, codes.reshape(-1), rows, cols, 56, 3, True, state)
        usable = chains[1][chains[2] > 0].reshape(-1, *shape) > 0
        assert all(map(is_kept, usable[:2]))
        drawn, count = drawn + usable.sum(0), count + len(usable)
    assert count > 9000
    np.testing.assert_allclose(drawn / count, share / total, atol=0.02)


@pytest.mark.parametrize("side", [21, pytest.param(42, marks=pytest.mark.long)])
def test_kept_from_the_first_move_chains_agree_with_all_that_is_seen(side):
    config = EnvConfig.of("random", side)
    policy, episode = policies.load("frontier-priced"), Episode.begin(config, seed=3)
    chains, state = posterior_chains((side, side), 12), np.array([1], np.uint64)
    least = 12
    while not episode.ended:
        codes = episode.codes.copy()
        move_chains(chains, codes.reshape(-1), side, side, config.target, 1, False, state)
        covers = chains[1][chains[2] > 0].reshape(-1, side, side)
        least = min(least, len(covers))
        assert not covers[:, (codes == FREE) | (codes == ROVER)].any()
        assert (covers[:, codes == OBSTACLE] > 0).all()
        assert (chains[0][chains[2] > 0, :, :2] >= 1).all()
        episode.step(policy.act(codes.copy()))
    assert least >= 10


def test_an_imagined_look_shows_what_the_rules_show():
    terrain = generate(CONFIG, 4)
    episode = Episode.begin(CONFIG, terrain=terrain)
    shape, radius = terrain.shape, CONFIG.sensor_radius
    board, cols, rng = PricedBoard(shape, radius), shape[1], np.random.default_rng(2)
    squares = np.array([2, 6, 12])
    update_board(episode.codes, board.board, squares, board.changed_columns)
    truth, done = pack(terrain, CONFIG), np.zeros(shape, np.uint8)
    rover = np.array([0, episode.discovered, 0])
    for _ in range(150):
        moves = [a for a in range(4) if not is_invalid(episode, a)]
        episode.step(int(rng.choice(moves)))
        rover[0] = episode.position[0] * cols + episode.position[1]
        look_round(board.board, truth, done, rover, squares, cols)
        seen = episode.codes.copy()
        seen[seen == ROVER] = FREE
        imagined = board.board[0].reshape(shape).copy()
        imagined[imagined == ROVER] = FREE  # where it stood at first
        np.testing.assert_array_equal(imagined, seen)
        if episode.ended:
            break
    fresh = PricedBoard(shape, radius)
    update_board(episode.codes, fresh.board, squares, fresh.changed_columns)
    np.testing.assert_array_equal(board.board[1], fresh.board[1])
    assert rover[1] == episode.discovered


def is_invalid(episode, action):
    row, col = np.array(episode.position) + [(-1, 0), (0, 1), (1, 0), (0, -1)][action]
    inside = 0 <= row < CONFIG.rows and 0 <= col < CONFIG.cols
    return not inside or episode.terrain[row, col]


def decided(policy, observation):
    """A move, with where the policy's draws have come to.

    Other draws could make the same moves.
    """
    return policy.act(observation), int(policy._state[0]), policy.compared


def test_moves_and_draws_follow_from_the_observations_alone():
    # 1. The same again, whatever the seed of `reset`, also from a policy that has played other
    #    terrains.
    policy, episode, seen, answers = (
        policies.load("lookahead"),
        Episode.begin(CONFIG, seed=11),
        [],
        [],
    )
    policy.reset(11)
    while not episode.ended:
        seen.append(episode.codes.copy())
        answers.append(decided(policy, seen[-1]))
        episode.step(answers[-1][0])
    assert sum(compared > 0 for _, _, compared in answers) >= 5
    play_episode(policy, CONFIG, 12)  # what it leaves behind must not count
    policy.reset(5)
    assert not any(chain.any() for chain in policy._arrays.chains[:2])
    assert [decided(policy, observed) for observed in seen] == answers
    assert play_episode(policies.load("lookahead"), CONFIG, 11).actions == episode.actions

    # 2. From any place of an episode that somebody else has played, as after a restart or "Try from
    #    here".
    walker, episode = policies.load("frontier-utility"), Episode.begin(CONFIG, seed=8)
    seen, answers = [], []
    policy.reset(0)
    while not episode.ended:
        seen.append(episode.codes.copy())
        answers.append(decided(policy, seen[-1]))
        episode.step(walker.act(seen[-1]))
    for stop in range(10, len(seen), 15):
        rebuilt = policies.load("lookahead")
        rebuilt.reset(99)
        assert [decided(rebuilt, observed) for observed in seen[: stop + 1]] == answers[: stop + 1]


def test_elsewhere_it_is_ppo_and_says_so(caplog):
    config = EnvConfig.of("2-2-2", 21)
    policy, ppo = policies.load("lookahead"), policies.load("ppo")
    with caplog.at_level(logging.WARNING, "marsexplorer.policies.lookahead"):
        assert play_episode(policy, config, 2).actions == play_episode(ppo, config, 2).actions
    assert not policy.compared
    assert "elsewhere it is ppo" in policies.describe("lookahead")
    sentence = "on level 2-2-2 it plays as ppo"
    assert [sentence in record.getMessage() for record in caplog.records] == [True]
    large = EnvConfig.of("random", (90, 80))
    episode, moves = Episode.begin(large, seed=1), []
    policies.begin(policy, "random", 1)
    ppo.reset(1)
    for _ in range(5):
        moves.append((policy.act(episode.codes), ppo.act(episode.codes)))
        episode.step(moves[-1][1])
    assert all(one == other for one, other in moves)


@pytest.mark.long
def test_it_saves_moves():
    config, seeds = EnvConfig.of("random", 21), range(40, 46)
    moves = {
        name: sum(play_episode(policies.load(name), config, seed).steps for seed in seeds)
        for name in ("ppo", "lookahead")
    }
    assert moves["lookahead"] < moves["ppo"]


def test_pages_and_reports_call_it_by_what_it_knows():
    title = policies.title("lookahead")
    assert title == "Expert that knows how terrains are made"
    assert policies.title("ppo") == "ppo"
    page = Path(__file__).parents[3] / "static" / "task" / "mars" / "words.js"
    assert f'lookahead: t("mars.policy.lookahead", "{title}")' in page.read_text()
