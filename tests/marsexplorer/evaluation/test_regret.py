"""Regret of each move: lengths are those of literal episodes, losses have the kinds defined, the cache changes nothing."""

import numpy as np
import pytest

from marsexplorer.config import FREE, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode, moves_of, replay
from marsexplorer.evaluation.losses import LossKind, leaves_pocket
from marsexplorer.evaluation.missed import SOON
from marsexplorer.evaluation.regret import RegretEstimator, branch_lengths, policy_shares
from marsexplorer.observation import valid_actions
from marsexplorer.policies import PolicyFileError, PolicyNotFoundError, load
from marsexplorer.policies.guard import LoopGuard
from marsexplorer.policies.network.policy import NetworkPolicy

CONFIG = EnvConfig("random", 11, 14, sensor_radius=4)
SEED = 81_000


@pytest.fixture(scope="module")
def net():
    return load("ppo").net


@pytest.fixture(scope="module")
def estimator():
    return RegretEstimator()


def drive(seed, moves, rng):
    """An episode of so many random valid moves."""
    episode = Episode.begin(CONFIG, seed=seed)
    while not episode.ended and episode.steps < moves:
        episode.step(int(rng.choice(valid_actions(episode.codes, *episode.position))))
    return episode


def branched(net, record, step, action):
    """An episode once another action was made at a step, and the policy that goes on, its guard beginning there."""
    episode, policy = Episode.again(record), NetworkPolicy("p", net, CONFIG.sensor_radius)
    policy.reset(0)
    for made in (*record.actions[:step], action):
        policy.extract_features(episode.codes)
        episode.step(made)
    policy._guard = LoopGuard(CONFIG.sensor_radius)
    return episode, policy


def literal_length(net, record, step, action):
    """The moves of the whole episode, played board by board as the policy is served."""
    episode, policy = branched(net, record, step, action)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    return episode.steps if episode.outcome == "explored" else CONFIG.limit


def test_lengths_are_those_of_literal_episodes(net):
    rng = np.random.default_rng(1)
    record = drive(SEED, 40, rng).record()
    lengths = branch_lengths(record, net)
    for step in rng.choice(len(record.actions), 8, replace=False):
        for action in range(4):
            expected = literal_length(net, record, step, action)
            assert lengths[step, action] == expected, (step, action)


def test_shares_are_those_of_the_policy_on_each_board_of_the_episode(net):
    record = drive(SEED, 40, np.random.default_rng(1)).record()
    policy = NetworkPolicy("p", net, CONFIG.sensor_radius)
    policy.reset(0)
    for (episode, _), shares in zip(moves_of(record), policy_shares(record, net), strict=True):
        policy.act(episode.codes)
        assert shares == pytest.approx(policy.thought()[0], abs=1e-4)


def test_a_regret_is_never_negative_and_the_best_action_has_none(estimator):
    found = estimator.regret(drive(SEED + 1, 60, np.random.default_rng(2)).record())
    steps = np.arange(len(found.actions))
    assert found.regret.min() >= 0
    assert found.regret.max() > 0
    assert (found.lengths[steps, found.best_actions] == found.lengths.min(1)).all()
    assert (found.best_actions[found.regret == 0] == found.actions[found.regret == 0]).all()
    assert [kind is None for kind in found.kinds] == (found.regret == 0).tolist()
    assert sum(found.by_kind().values()) == found.total == found.by_tenth().sum()
    biggest = found.biggest(3)
    assert biggest[0].regret == found.regret.max()
    regrets = [each.regret for each in biggest]
    assert regrets == sorted(regrets, reverse=True)


def test_a_collision_costs_what_is_left_of_the_limit(estimator):
    episode = Episode.begin(CONFIG, seed=SEED)
    episode.step(0)
    found = estimator.regret(episode.record())
    assert found.lengths[0, 0] == CONFIG.limit
    assert found.regret[0] == CONFIG.limit - found.lengths[0].min() > 0
    assert found.kinds == (LossKind.ENDED_EARLY,)


def test_giving_up_costs_what_the_policy_would_have_needed(estimator):
    episode = drive(SEED, 10, np.random.default_rng(3))
    moved = estimator.regret(episode.record())
    episode.abandon()
    found = estimator.regret(episode.record())
    assert found.given_up == CONFIG.limit - found.lengths[-1, found.actions[-1]] > 0
    assert found.total == moved.total + found.given_up
    assert found.by_kind()[LossKind.ENDED_EARLY] == found.given_up


def test_an_episode_without_a_move_has_no_regret(estimator):
    episode = Episode.begin(CONFIG, seed=SEED)
    episode.abandon()
    found = estimator.regret(episode.record())
    assert (found.total, found.biggest(), found.regret.tolist()) == (0, [], [])


def test_a_loss_of_the_last_cells_is_one_after_95_percent(estimator, net):
    rng, kinds = np.random.default_rng(5), []
    for seed in range(SEED, SEED + 3):
        episode = Episode.begin(CONFIG, seed=seed)
        policy = NetworkPolicy("p", net, CONFIG.sensor_radius)
        policy.reset(0)
        while not episode.ended and episode.steps < 120:
            action = policy.act(episode.codes)
            if episode.coverage > 0.8 and rng.random() < 0.6:  # it slips
                action = int(rng.choice(valid_actions(episode.codes, *episode.position)))
            episode.step(action)
        found = estimator.regret(episode.record())
        kinds += zip(found.kinds, found.coverage, strict=True)
    last, others = (LossKind.LAST_CELLS,), (LossKind.HIDDEN_POCKET, LossKind.EARLY_DETOUR)
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


def test_what_is_kept_is_read_again_and_a_broken_file_is_worked_out_anew(tmp_path, monkeypatch):
    record = drive(SEED, 12, np.random.default_rng(4)).record()
    kept = RegretEstimator(cache=tmp_path / "regret")
    first = kept.regret(record).lengths
    (path,) = (tmp_path / "regret").iterdir()
    worked_out = "marsexplorer.evaluation.regret.branch_lengths"
    monkeypatch.setattr(worked_out, lambda *given: pytest.fail("worked out again"))
    assert (kept.regret(record).lengths == first).all()
    monkeypatch.undo()
    path.write_bytes(b"\x93NUMPY broken")
    assert (kept.regret(record).lengths == first).all()
    assert (np.load(path) == first).all()


def test_what_cannot_go_on_or_is_too_large_is_refused(estimator):
    with pytest.raises(PolicyNotFoundError):
        RegretEstimator("no-such-policy")
    for other in ("ppo-paper", "sac-works"):  # without our features, and with moves that are drawn
        with pytest.raises(PolicyFileError, match="is no policy: expected"):
            RegretEstimator(other)
    large = Episode.begin(EnvConfig.of("random", (43, 42)), seed=1)
    with pytest.raises(ValueError, match=r"up to 1764 cells, .* has 43x42"):
        estimator.regret(large.record())


def test_what_was_missed_is_what_the_policy_sees_soon_after_the_better_move(net, estimator):
    record = drive(SEED + 1, 60, np.random.default_rng(8)).record()
    losses = [loss for loss in estimator.regret(record).biggest(5) if loss.regret >= 2]
    missed = estimator.missed(record, losses)
    assert len(losses) == 5
    assert sum(len(each.cells) for each in missed) > 0
    for loss, found in zip(losses, missed, strict=True):
        # 1. The player's own way: what was known at the move, SOON moves after it, and when the rest was seen.
        boards = [(own.position, own.codes.copy()) for own, _ in moves_of(record)]
        assert found.position == boards[loss.step][0]
        assert (found.codes == boards[loss.step][1]).all()
        known = [codes != UNKNOWN for _, codes in boards] + [replay(record).codes != UNKNOWN]
        before, soon = known[loss.step], known[min(loss.step + SOON, len(record.actions))]
        # 2. The policy's way after the better action.
        other, policy = branched(net, record, loss.step, loss.best_action)
        for _ in range(SOON - 1):
            if not other.ended:
                other.step(policy.act(other.codes))
        cells = np.argwhere((other.codes != UNKNOWN) & ~before & ~soon)
        assert found.cells.tolist() == cells.tolist()
        seen = [[step for step, each in enumerate(known) if each[tuple(cell)]] for cell in cells]
        expected = max(steps[0] for steps in seen) if seen and all(seen) else None
        assert found.seen_at == expected
