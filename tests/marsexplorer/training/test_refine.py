"""Branched rollouts and refining: costs are what a literal replay finds, and a network learns from them."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from app.cli.main import cli
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies.files.card import read_card, shipped
from marsexplorer.policies.network.features import Perception
from marsexplorer.policies.network.model import Net, NetworkPolicy, load_net
from marsexplorer.training.branching import LONGEST, MOST, PATIENCE, branch, play, play_on, walk
from marsexplorer.training.envs import EVALUATION_SEEDS
from marsexplorer.training.refine import MIRROR, Plan, Refining

SMALL = Plan(
    levels=(("random", 2), ("1-2-1", 1)),
    episodes=6,
    each=16,
    held=((26, 2),),
    opening=2,
    first=2,
    steps=40,
    batch=256,
    held_batch=32,
)
CONFIG = EnvConfig()
SEED = 77_000


@pytest.fixture(scope="module")
def net():
    return load_net(shipped()["ppo"])


def rookie():
    torch.manual_seed(3)
    return Net().eval()


def literal(net, seed, at=None, other=None):
    """The policy's episode, move by move; at its move `at` it makes the move `other`. Returns its moves."""
    policy, episode = NetworkPolicy("net", net, CONFIG.sensor_radius), Episode.begin(CONFIG, seed=seed)
    policy.reset(0)
    while not episode.ended and episode.steps < int(LONGEST * CONFIG.n):
        action = policy.act(episode.codes)
        episode.step(other if episode.steps == at else action)
    return episode.steps


@pytest.mark.parametrize("make", [rookie, lambda: load_net(shipped()["ppo"])], ids=["untrained", "shipped"])
def test_episodes_are_those_of_the_policy_with_its_guard(make):
    net, steps = make(), np.zeros(12, np.int64)
    guarded = sum(int(moment.decided.guarded.sum()) for moment in play(CONFIG, net, SEED, steps))
    assert steps.tolist() == [literal(net, SEED + k) for k in range(12)]
    if make is rookie:
        assert guarded > 0


def test_the_cost_of_another_move_is_what_a_literal_replay_finds(net):
    steps, moments = np.zeros(6, np.int64), []
    for count, moment in enumerate(play(CONFIG, net, SEED, steps)):
        if count in (0, 9, 20, 33):
            valid = moment.decided.moves[:, :, 0] > 0
            valid[np.arange(len(valid)), moment.decided.actions] = False
            others = np.where(valid.any(1), valid.argmax(1), moment.decided.actions)
            moments.append((count, moment.which.copy(), others, moment.players.take(np.arange(moment.players.num))))
    signs = set()
    for count, which, others, worlds in moments:
        for episode, other, cost in zip(which, others, play_on(CONFIG, net, worlds, others, steps[which]), strict=True):
            assert cost == min(literal(net, SEED + int(episode), count, int(other)) - steps[episode], PATIENCE)
            signs.add(int(np.sign(cost)))
    assert signs == {-1, 0, 1}


def test_pairs_are_two_valid_moves_and_what_the_network_prefers(net):
    pairs = branch(CONFIG, net, SEED, 16, 16)
    rows = np.arange(len(pairs.own))
    assert 0.5 * 16 * 16 < len(rows) < 2 * 16 * 16
    assert (pairs.moves[rows, pairs.own, 0] > 0).all()
    assert (pairs.moves[rows, pairs.other, 0] > 0).all()
    logits, _ = net.decide(pairs.planes, pairs.moves)
    assert (logits[rows, pairs.own] >= logits[rows, pairs.other] - 1e-3).all()
    assert abs(pairs.cost).max() <= MOST
    assert pairs.cost.min() < 0 < pairs.cost.mean()
    again = branch(CONFIG, net, SEED, 16, 16)
    assert all(
        np.array_equal(getattr(pairs, name), getattr(again, name)) for name in ("planes", "own", "other", "cost", "steps")
    )


def test_looks_are_a_quarter_of_the_moments(net):
    looks = walk(CONFIG, net, SEED, 8)
    assert 0.2 < len(looks.planes) / looks.steps.sum() < 0.3


def test_terrains_kept_for_evaluation_are_refused(net):
    with pytest.raises(ValueError, match="kept for evaluation"):
        branch(CONFIG, net, EVALUATION_SEEDS.start - 2, 8, 4)


def test_the_mirror_exchanges_rows_and_columns():
    """A board and its transpose look the same to the mirror, moves exchanged north-west and east-south."""
    codes = np.random.default_rng(5).choice([0, 1, 1, 3], size=(1, 21, 21)).astype(np.uint8)
    codes[0, 8, 5] = 2
    eyes = Perception(1, 21, 21, 6)
    nothing = np.zeros((1, 441), np.uint8)
    planes, moves = (each.copy() for each in eyes(codes, np.array([8 * 21 + 5]), nothing, np.array([1])))
    turned = np.ascontiguousarray(codes.transpose(0, 2, 1))
    mirrored, flipped = eyes(turned, np.array([5 * 21 + 8]), nothing, np.array([2]))
    assert np.array_equal(planes[:, :, MIRROR], mirrored)
    alike = [k for k in range(16) if k not in (7, 8, 9)]  # rules break ties by compass
    assert np.allclose(moves[:, ::-1, alike], flipped[:, :, alike])


def test_an_untrained_network_learns_which_moves_are_better_the_same_on_any_number_of_workers():
    runs = []
    for workers in (1, 2):
        run = Refining(rookie(), 4, SMALL)
        with ThreadPoolExecutor(workers) as pool:
            reports = [run.round(pool) for _ in range(2)]
        runs.append((run, reports))
    (run, reports), (other, same) = runs
    assert reports == same
    assert all(torch.equal(*both) for both in zip(run.net.parameters(), other.net.parameters(), strict=True))
    seeds = range(SEED, SEED + 50)
    gained = np.array([literal(rookie(), seed) - literal(run.net, seed) for seed in seeds])
    assert gained.mean() - 1.96 * gained.std() / 50**0.5 > 0


def test_what_is_no_network_of_ours_is_refused_and_a_run_is_never_written_over(tmp_path):
    (tmp_path / "no.safetensors").write_bytes(b"nothing")
    refused = CliRunner().invoke(cli, ["refine", str(tmp_path / "no.safetensors")])
    assert refused.exit_code == 2
    assert "is no policy" in refused.output
    assert "the format marsexplorer-network-2" in CliRunner().invoke(cli, ["refine", "ppo-paper"]).output
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.safetensors").write_bytes(b"mine")
    kept = CliRunner().invoke(cli, ["refine", "--out", str(tmp_path / "run")])
    assert kept.exit_code == 2
    assert "exists already" in kept.output
    assert (tmp_path / "run" / "run.safetensors").read_bytes() == b"mine"


@pytest.mark.long
def test_the_command_refines_the_shipped_policy(tmp_path):
    done = CliRunner().invoke(cli, ["refine", "--rounds", "1", "--out", str(tmp_path / "mine")])
    assert done.exit_code == 0, done.output
    card = read_card(tmp_path / "mine" / "mine.safetensors")
    assert card["training"]["rounds"] == 1
    assert card["training"]["began_with"]["command"]
    results = card["results"]["random 21x21"]
    assert results["completion"] == 1.0
    assert results["steps"] < results["best_rule_steps"]
