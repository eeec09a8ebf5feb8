"""The cost of each move: lengths of literal episodes, sums, and kinds of mistakes."""

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from marsexplorer.config import FREE, OUTCOMES, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode, moves_of, replay
from marsexplorer.evaluation.cost import CostEstimator
from marsexplorer.evaluation.missed import SOON
from marsexplorer.evaluation.mistakes import (
    POCKET_CELLS,
    MistakeKind,
    is_blocked,
    leaves_pocket,
    moved,
)
from marsexplorer.observation import valid_actions
from marsexplorer.policies import PolicyFileError, PolicyNotFoundError, load
from marsexplorer.policies.network.policy import NetworkPolicy

CONFIG = EnvConfig("random", 11, 14, sensor_radius=4)
SHORT = EnvConfig("random", 9, 11, sensor_radius=3, max_steps=45)
SEED = 81_000
ENDINGS = OUTCOMES[1:]


@pytest.fixture(scope="module")
def net():
    return load("ppo").net


@pytest.fixture(scope="module")
def estimator():
    return CostEstimator()


def expert_of(net, config):
    policy = NetworkPolicy("ppo", net, config.sensor_radius)
    policy.reset(0)
    return policy


def crash(episode, outcome):
    """Make an invalid move that ends an episode with this outcome, where there is one."""
    for action in range(4):
        row, col = cell = moved(episode.position, action)
        is_on_grid = 0 <= row < episode.config.rows and 0 <= col < episode.config.cols
        if is_blocked(episode.terrain, cell) and is_on_grid == (outcome == "collided"):
            episode.step(action)
            return


def drive(net, config, seed, slip, ending="explored", moves=0):
    """An episode of Expert that slips into random valid moves and may end otherwise."""
    rng, episode, policy = (
        np.random.default_rng(seed),
        Episode.begin(config, seed=seed),
        expert_of(net, config),
    )
    while not episode.ended:
        action = policy.act(episode.codes)
        if ending == "abandoned" and episode.steps >= moves:
            episode.abandon()
            break
        if ending in ("collided", "out_of_bounds") and episode.steps >= moves:
            crash(episode, ending)
            if episode.ended:
                break
        if ending == "timed_out" and episode.steps >= moves:
            slip = 1.0
        if rng.random() < slip:
            action = int(rng.choice(valid_actions(episode.codes, *episode.position)))
        episode.step(action)
    return episode.record()


def goes_on(net, record, step, action=None):
    """An episode after so many moves, and Expert, who has watched them.

    `action` is made instead of the next move.
    """
    episode, policy = Episode.again(record), expert_of(net, record.config)
    for move in (*record.actions[:step], *([] if action is None else [action])):
        policy.act(episode.codes)
        episode.step(move)
    return episode, policy


def literal_length(net, record, step):
    """V after so many moves, played board by board as the policy is served."""
    episode, policy = goes_on(net, record, step)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    return episode.steps if episode.outcome == "explored" else record.config.limit


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    slip=st.floats(0, 0.9),
    ending=st.sampled_from(ENDINGS),
    moves=st.integers(0, 40),
)
def test_costs_are_differences_of_literal_lengths_and_add_up(seed, slip, ending, moves):
    net = load("ppo").net
    record = drive(net, SHORT, seed, slip, ending, moves)
    episode_costs = CostEstimator().costs(record)
    lengths, counts = episode_costs.lengths, SHORT.limit
    if record.outcome == "explored":
        counts = record.steps
    running = len(record.actions) + (record.outcome == "abandoned")
    literal = [literal_length(net, record, step) for step in range(running)]
    assert lengths.tolist() == (literal if record.outcome == "abandoned" else [*literal, counts])
    assert episode_costs.costs.sum() + episode_costs.without_move == counts - literal[0]
    assert episode_costs.total == counts - literal[0]
    assert sum(episode_costs.by_kind().values()) + episode_costs.gained == episode_costs.total
    assert episode_costs.by_tenth().sum() + episode_costs.without_move == episode_costs.total


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), side=st.integers(6, 15), limit=st.sampled_from([12, 60, None]))
def test_experts_own_episode_is_v0_and_none_of_its_moves_costs_anything(seed, side, limit):
    net, config = load("ppo").net, EnvConfig.of("random", side, max_steps=limit)
    record = drive(net, config, seed, 0.0)
    episode_costs = CostEstimator().costs(record)
    assert episode_costs.expert_moves == (
        record.steps if record.outcome == "explored" else config.limit
    )
    assert set(episode_costs.lengths.tolist()) == {episode_costs.expert_moves}
    assert (episode_costs.total, episode_costs.gained, episode_costs.mistakes) == (0, 0, ())
    assert episode_costs.advice.actions[: record.steps].tolist() == list(record.actions)


@pytest.mark.parametrize("ending", ENDINGS)
def test_every_ending_is_drawn_and_all_but_explored_count_the_limit(net, estimator, ending):
    records = [drive(net, SHORT, seed, 0.3, ending, 20) for seed in range(SEED, SEED + 8)]
    ended = [record for record in records if record.outcome == ending]
    assert ended
    for record in ended:
        counts = estimator.costs(record).counts
        assert counts == (record.steps if ending == "explored" else SHORT.limit)


def test_the_loop_guard_stands_as_the_path_left_it(net):
    """Back and forth between two cells makes the guard of whoever watches take over."""
    differing = 0
    for seed in range(SEED, SEED + 12):
        episode = Episode.begin(CONFIG, seed=seed)
        action = valid_actions(episode.codes, *episode.position)[0]
        for step in range(6):
            episode.step(action if step % 2 == 0 else (action + 2) % 4)
        episode.abandon()
        record = episode.record()
        lengths = CostEstimator().costs(record).lengths
        assert lengths.tolist() == [literal_length(net, record, step) for step in range(7)]
        fresh, policy = goes_on(net, record, 6)
        policy._guard.reset()
        while not fresh.ended:
            fresh.step(policy.act(fresh.codes))
        differing += fresh.steps != lengths[6]
    assert differing, "where the guard begins anew, another episode follows"


def test_shares_and_actions_are_experts_on_each_board_of_the_episode(net, estimator):
    record = drive(net, CONFIG, SEED, 0.5)
    advice, policy = estimator.costs(record).advice, expert_of(net, CONFIG)
    for step, (episode, _) in enumerate(moves_of(record)):
        assert advice.actions[step] == policy.act(episode.codes)
        assert advice.shares[step] == pytest.approx(policy.thought()[0], abs=1e-4)


def test_a_mistake_is_a_stretch_of_moves_that_are_not_experts(net, estimator):
    joined = 0
    for seed in range(SEED, SEED + 6):
        record = drive(net, CONFIG, seed, 0.4)
        episode_costs = estimator.costs(record)
        costs, steps = episode_costs.costs, np.arange(record.steps)
        is_other = episode_costs.actions != episode_costs.advice.actions[: record.steps]
        assert not costs[~is_other].any(), "who goes as Expert does loses nothing"
        for mistake in episode_costs.mistakes:
            stretch = steps[mistake.first : mistake.last + 1]
            assert is_other[stretch].all()
            assert mistake.cost == costs[stretch].sum() > 0
            assert costs[mistake.step] == costs[stretch].max() > 0
            joined += len(stretch) > 1
        biggest = [mistake.cost for mistake in episode_costs.biggest(3)]
        assert (
            biggest
            == sorted((mistake.cost for mistake in episode_costs.mistakes), reverse=True)[:3]
        )
        named = [
            step
            for mistake in episode_costs.mistakes
            for step in range(mistake.first, mistake.last + 1)
        ]
        assert len(named) == len(set(named)), "no two mistakes have a move in common"
        kinds = [step for step, kind in enumerate(episode_costs.kinds) if kind is not None]
        assert kinds == sorted(named)
    assert joined


def test_a_collision_costs_what_is_left_of_the_limit(estimator):
    episode = Episode.begin(CONFIG, seed=SEED)
    episode.step(0)
    episode_costs = estimator.costs(episode.record())
    assert episode_costs.costs.tolist() == [CONFIG.limit - episode_costs.expert_moves]
    assert episode_costs.kinds == (MistakeKind.ENDED_EARLY,)


def test_giving_up_is_one_last_cost_also_before_the_first_move(net, estimator):
    for moves in (10, 0):
        record = drive(net, CONFIG, SEED, 0.9, "abandoned", moves)
        episode_costs = estimator.costs(record)
        assert episode_costs.without_move == CONFIG.limit - literal_length(net, record, moves) > 0
        assert episode_costs.by_kind()[MistakeKind.ENDED_EARLY] == episode_costs.without_move


def test_a_mistake_of_the_last_cells_is_one_after_95_percent(estimator, net):
    kinds = []
    for seed in range(SEED, SEED + 8):
        episode_costs = estimator.costs(drive(net, CONFIG, seed, 0.5))
        coverage = [episode_costs.coverage[mistake.step] for mistake in episode_costs.mistakes]
        kinds += zip([mistake.kind for mistake in episode_costs.mistakes], coverage, strict=True)
    last, others = (MistakeKind.LAST_CELLS,), (MistakeKind.HIDDEN_POCKET, MistakeKind.EARLY_DETOUR)
    for wanted, is_late in ((last, True), (others, False)):
        assert {coverage >= 0.95 for kind, coverage in kinds if kind in wanted} == {is_late}


def test_a_pocket_is_left_by_the_move_away_from_it_alone():
    codes, terrain = np.full((9, 12), FREE, np.uint8), np.zeros((9, 12), bool)
    codes[4, 5:7] = UNKNOWN
    nearer, farther = (4, 3), (4, 1)
    assert leaves_pocket(codes, terrain, (4, 2), [farther, nearer], 6)
    assert not leaves_pocket(codes, terrain, (4, 2), [nearer, farther], 6)
    assert not leaves_pocket(codes, terrain, (4, 2), [farther, nearer], 2)
    terrain[4, 5:7] = True  # nothing free is hidden in it
    assert not leaves_pocket(codes, terrain, (4, 2), [farther, nearer], 6)
    codes[:, 5:] = UNKNOWN  # no pocket, the open country
    terrain[:] = False
    assert not leaves_pocket(codes, terrain, (4, 2), [farther, nearer], 6)


def leaves_pocket_by_scipy(codes, terrain, position, towards, radius):
    groups, count = scipy.ndimage.label(codes == UNKNOWN)
    for number in range(1, count + 1):
        cells = np.argwhere(groups == number)
        if len(cells) > POCKET_CELLS or terrain[tuple(cells.T)].all():
            continue
        before, after, better = (
            np.abs(cells - place).sum(1).min() for place in (position, *towards)
        )
        is_near = np.abs(cells - position).max(1).min() <= radius
        if is_near and better < before <= after:
            return True
    return False


@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 2**32), st.integers(5, 30), st.integers(5, 30),
    st.sampled_from([0.05, 0.2, 0.4, 0.7]), st.integers(1, 8),
)  # fmt: skip
def test_pockets_are_the_groups_that_scipy_labels(seed, rows, cols, unknown, radius):
    rng = np.random.default_rng(seed)
    codes = np.where(rng.random((rows, cols)) < unknown, UNKNOWN, FREE).astype(np.uint8)
    terrain = rng.random((rows, cols)) < 0.5
    position = (int(rng.integers(rows)), int(rng.integers(cols)))
    for action in range(4):
        for expert in range(4):
            towards = [moved(position, action), moved(position, expert)]
            asked = (codes, terrain, position, towards, radius)
            assert leaves_pocket(*asked) == leaves_pocket_by_scipy(*asked)


def test_what_is_kept_is_read_again_and_a_broken_file_is_worked_out_anew(
    tmp_path, monkeypatch, net
):
    record = drive(net, CONFIG, SEED, 0.9, "abandoned", 12)
    estimator = CostEstimator(cache=tmp_path / "costs")
    first = estimator.costs(record).lengths
    (path,) = (tmp_path / "costs").iterdir()
    worked_out = "marsexplorer.evaluation.cost.whole_lengths"
    monkeypatch.setattr(worked_out, lambda *arguments: pytest.fail("worked out again"))
    assert (estimator.costs(record).lengths == first).all()
    monkeypatch.undo()
    path.write_bytes(b"\x93NUMPY broken")
    assert (estimator.costs(record).lengths == first).all()
    assert (np.load(path) == first).all()


def test_a_large_board_and_one_where_not_all_cells_count_have_experts_episode_alone(net, estimator):
    for config in (EnvConfig.of("random", (43, 42)), EnvConfig.of("cave", 21)):
        episode = Episode.begin(config, seed=1)
        with pytest.raises(ValueError, match=r"up to 1764 cells, .* has 43x42|is of level cave"):
            estimator.costs(episode.record())
        expected = literal_length(net, episode.record(), 0)
        assert estimator.expert_moves(episode.record()) == expected < config.limit


def test_what_cannot_be_expert_is_refused():
    with pytest.raises(PolicyNotFoundError):
        CostEstimator("no-such-policy")
    for other in ("ppo-paper", "sac-works"):  # without our features, and with moves that are drawn
        with pytest.raises(PolicyFileError, match="is no policy: expected"):
            CostEstimator(other)


def test_what_was_missed_is_what_expert_sees_soon_after_its_move(net, estimator):
    record = drive(net, CONFIG, SEED + 1, 0.9, "abandoned", 60)
    mistakes = estimator.costs(record).biggest(5)
    missed = estimator.missed(record, mistakes)
    assert len(mistakes) == 5
    assert sum(len(part.cells) for part in missed) > 0
    for mistake, picture in zip(mistakes, missed, strict=True):
        # 1. The player's own way: what was known at the move, SOON moves after it, and when the
        #    rest was seen.
        boards = [(board.position, board.codes.copy()) for board, _ in moves_of(record)]
        assert picture.position == boards[mistake.step][0]
        assert (picture.codes == boards[mistake.step][1]).all()
        known_cells = [codes != UNKNOWN for _, codes in boards] + [replay(record).codes != UNKNOWN]
        before, soon = (
            known_cells[mistake.step],
            known_cells[min(mistake.step + SOON, len(record.actions))],
        )
        # 2. Expert's way.
        other, policy = goes_on(net, record, mistake.step, mistake.expert_action)
        for _ in range(SOON - 1):
            if not other.ended:
                other.step(policy.act(other.codes))
        cells = np.argwhere((other.codes != UNKNOWN) & ~before & ~soon)
        assert picture.cells.tolist() == cells.tolist()
        seen = [
            [step for step, codes in enumerate(known_cells) if codes[tuple(cell)]] for cell in cells
        ]
        expected = max(steps[0] for steps in seen) if seen and all(seen) else None
        assert picture.seen_at == expected
