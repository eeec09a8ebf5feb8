"""Regret of each move: lengths are those of literal episodes, losses have the kinds defined, the cache changes nothing."""

import numpy as np
import pytest

from marsexplorer.config import FREE, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.losses import LossKind, leaves_pocket
from marsexplorer.evaluation.missed import SOON
from marsexplorer.evaluation.regret import RegretEstimator, branch_lengths
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


def literal_length(net, record, step, action):
    """The moves of the whole episode, played board by board as the policy is served, its guard beginning at the branch."""
    episode = Episode.begin(record.config, terrain=record.terrain_map())
    policy = NetworkPolicy("p", net, CONFIG.sensor_radius)
    policy.reset(0)
    for made in record.actions[:step]:
        policy.extract_features(episode.codes)
        episode.step(made)
    policy.extract_features(episode.codes)
    episode.step(action)
    policy._guard = LoopGuard(CONFIG.sensor_radius)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    return episode.steps if episode.outcome == "explored" else CONFIG.limit


def test_lengths_are_those_of_literal_episodes(net):
    rng = np.random.default_rng(1)
    record = drive(SEED, 40, rng).record()
    lengths = branch_lengths(record, net)
    terrain = record.terrain_map()
    for step in rng.choice(len(record.actions), 8, replace=False):
        for action in range(4):
            assert lengths[step, action] == literal_length(net, record, step, action), (
                step,
                action,
            )
    assert not terrain[0, 0]


def test_a_regret_is_never_negative_and_the_best_action_has_none(estimator):
    found = estimator.regret(drive(SEED + 1, 60, np.random.default_rng(2)).record())
    steps = np.arange(len(found.actions))
    assert found.regret.min() >= 0
    assert found.regret.max() > 0
    assert (found.lengths[steps, found.best_actions] == found.lengths.min(1)).all()
    assert (found.best_actions[found.regret == 0] == found.actions[found.regret == 0]).all()
    assert all(
        (kind is None) == (regret == 0)
        for kind, regret in zip(found.kinds, found.regret, strict=True)
    )
    assert sum(found.by_kind().values()) == found.total == found.by_tenth().sum()
    biggest = found.biggest(3)
    assert biggest[0].regret == found.regret.max()
    assert [each.regret for each in biggest] == sorted(
        (each.regret for each in biggest), reverse=True
    )


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
            slips = episode.coverage > 0.8 and rng.random() < 0.6
            episode.step(
                int(rng.choice(valid_actions(episode.codes, *episode.position)))
                if slips
                else action
            )
        found = estimator.regret(episode.record())
        kinds += zip(found.kinds, found.coverage, strict=True)
    assert {coverage >= 0.95 for kind, coverage in kinds if kind is LossKind.LAST_CELLS} == {True}
    assert {
        coverage < 0.95
        for kind, coverage in kinds
        if kind in (LossKind.HIDDEN_POCKET, LossKind.EARLY_DETOUR)
    } == {True}


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
    monkeypatch.setattr(
        "marsexplorer.evaluation.regret.branch_lengths",
        lambda *given: pytest.fail("worked out again"),
    )
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
    terrain = record.terrain_map()
    losses = [loss for loss in estimator.regret(record).biggest(5) if loss.regret >= 2]
    missed = estimator.missed(record, losses)
    assert len(losses) == 5
    assert sum(len(each.cells) for each in missed) > 0
    for loss, found in zip(losses, missed, strict=True):
        # 1. The player's own way: what was known at the move, SOON moves after it, and when the rest was seen.
        own, known = Episode.begin(CONFIG, terrain=terrain), []
        for action in record.actions:
            known.append(own.codes != UNKNOWN)
            own.step(action)
        known.append(own.codes != UNKNOWN)
        before, soon = known[loss.step], known[min(loss.step + SOON, len(record.actions))]
        # 2. The policy's way after the better action.
        other = Episode.begin(CONFIG, terrain=terrain)
        policy = NetworkPolicy("p", net, CONFIG.sensor_radius)
        policy.reset(0)
        for action in record.actions[: loss.step]:
            policy.extract_features(other.codes)
            other.step(action)
        assert found.position == other.position
        assert (found.codes == other.codes).all()
        policy.extract_features(other.codes)
        other.step(loss.best_action)
        policy._guard = LoopGuard(CONFIG.sensor_radius)
        for _ in range(SOON - 1):
            if not other.ended:
                other.step(policy.act(other.codes))
        cells = np.argwhere((other.codes != UNKNOWN) & ~before & ~soon)
        assert found.cells.tolist() == cells.tolist()
        seen = [
            next((step for step, each in enumerate(known) if each[tuple(cell)]), None)
            for cell in cells
        ]
        assert found.seen_at == (None if not seen or None in seen else max(seen))
