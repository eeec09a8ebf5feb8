"""Branched rollouts and refining: costs equal a literal replay, a network learns."""

import json
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from humanplay.tasks.mars.cli import cards
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.rollouts import GreedyRollouts
from marsexplorer.policies import load
from marsexplorer.policies.files.card import read_card, shipped
from marsexplorer.policies.network.features import MOVE_NUMBERS
from marsexplorer.policies.network.policy import NetworkPolicy
from marsexplorer.training.envs import EVALUATION_SEEDS
from marsexplorer.training.network import Net, load_net
from research.refinement import refine as refine_module
from research.refinement.__main__ import refine
from research.refinement.refine import (
    MAX_COST,
    MAX_EXTRA_MOVES,
    MAX_MOVES_PER_CELL,
    EpisodeTask,
    RefineConfig,
    RefineRun,
    branch_episodes,
    extra_moves,
    play_greedily,
    play_task,
    sample_observations,
)
from tests.support.policy_files import playing

SMALL = RefineConfig(
    tasks_per_level=(("random", 2), ("1-2-1", 1)),
    episodes_per_task=6,
    pairs_per_episode=16,
    anchor_sizes=((26, 2),),
    first_round_tasks=2,
    first_round_steps=2,
    gradient_steps=40,
    batch_size=256,
    anchor_batch_size=32,
)
TINY = RefineConfig(
    tasks_per_level=(("random", 1),),
    episodes_per_task=2,
    pairs_per_episode=2,
    anchor_sizes=((23, 1),),
    gradient_steps=6,
    batch_size=64,
    anchor_batch_size=16,
)
CONFIG = EnvConfig()
SEED = 77_000


@pytest.fixture(scope="module")
def net():
    """The shipped network, to be trained on."""
    return load_net(shipped()["ppo"])


@pytest.fixture(scope="module")
def scorer():
    """The same as it plays."""
    return load("ppo").net


def untrained_net():
    torch.manual_seed(3)
    net = Net().eval()
    net.prior.data.zero_()
    return net


def literal(net, seed, at=None, other=None):
    """The moves of the policy's episode; at its move `at` it makes the move `other`."""
    policy = NetworkPolicy("net", net, CONFIG.sensor_radius)
    episode = Episode.begin(CONFIG, seed=seed)
    policy.reset(0)
    while not episode.ended and episode.steps < int(MAX_MOVES_PER_CELL * CONFIG.n):
        action = policy.act(episode.codes)
        episode.step(other if episode.steps == at else action)
    return episode.steps


@pytest.mark.parametrize("which", ["untrained", "shipped"])
def test_episodes_are_those_of_the_policy_with_its_guard(which, scorer, tmp_path):
    net = playing(untrained_net(), tmp_path) if which == "untrained" else scorer
    steps = np.zeros(4, np.int64)
    joints = play_greedily(CONFIG, net, SEED, steps)
    guarded = sum(int(joint.decisions.guarded.sum()) for joint in joints)
    assert steps.tolist() == [literal(net, SEED + k) for k in range(4)]
    if which == "untrained":
        assert guarded > 0


def test_the_cost_of_another_move_is_what_a_literal_replay_finds(scorer):
    steps, branches = np.zeros(6, np.int64), []
    for count, joint in enumerate(play_greedily(CONFIG, scorer, SEED, steps)):
        if count in (0, 9, 20, 33):
            valid = joint.decisions.moves[:, :, 0] > 0
            valid[np.arange(len(valid)), joint.decisions.actions] = False
            others = np.where(valid.any(1), valid.argmax(1), joint.decisions.actions)
            worlds = joint.rollouts.snapshot(np.arange(joint.rollouts.num_worlds))
            branches.append((count, joint.episodes.copy(), others, worlds))
    signs = set()
    for count, episodes, others, worlds in branches:
        costs = extra_moves(CONFIG, scorer, worlds, others, steps[episodes])
        for episode, other, cost in zip(episodes, others, costs, strict=True):
            length = literal(scorer, SEED + int(episode), count, int(other))
            assert cost == min(length - steps[episode], MAX_EXTRA_MOVES)
            signs.add(int(np.sign(cost)))
    assert signs == {-1, 0, 1}


def test_pairs_are_two_valid_moves_and_what_the_network_prefers(scorer):
    pairs = branch_episodes(CONFIG, scorer, SEED, 8, 8)
    rows = np.arange(len(pairs.own))
    assert 0.5 * 8 * 8 < len(rows) < 2 * 8 * 8
    assert (pairs.moves[rows, pairs.own, 0] > 0).all()
    assert (pairs.moves[rows, pairs.other, 0] > 0).all()
    logits, _ = scorer.infer(pairs.planes, pairs.moves)
    assert (logits[rows, pairs.own] >= logits[rows, pairs.other] - 1e-3).all()
    assert abs(pairs.cost).max() <= MAX_COST
    assert pairs.cost.min() < 0 < pairs.cost.mean()
    again = branch_episodes(CONFIG, scorer, SEED, 8, 8)
    assert all(map(np.array_equal, vars(pairs).values(), vars(again).values()))


def test_observations_are_kept_at_a_quarter_of_the_steps(scorer):
    sampled = sample_observations(CONFIG, scorer, SEED, 8)
    assert 0.2 < len(sampled.planes) / sampled.steps.sum() < 0.3


def test_terrains_kept_for_evaluation_are_refused(scorer):
    with pytest.raises(ValueError, match="kept for evaluation"):
        branch_episodes(CONFIG, scorer, EVALUATION_SEEDS.start - 2, 8, 4)


def test_sizes_that_are_branched_are_no_anchors_and_have_fewer_episodes(net):
    anchors = {"anchor_sizes": ((84, 2), (42, 8)), "anchor_levels": ("2-2-1",)}
    run, tasks = RefineRun(net, 4, replace(SMALL, sizes=(21, 42), **anchors)), set()
    for task in run.make_tasks():
        tasks.add((task.level, task.size, task.num_episodes, task.pairs_per_episode))
    branched = {(level, *task, 16) for level in ("random", "1-2-1") for task in ((21, 6), (42, 1))}
    assert tasks == branched | {("2-2-1", 84, 2, 0)}
    run.config = replace(run.config, tasks_per_level=(("random", 12), ("1-1-1", 1)))
    counts = Counter((task.level, task.size) for task in run.make_tasks() if task.pairs_per_episode)
    assert counts == {("random", 21): 24, ("random", 42): 12, ("1-1-1", 21): 2, ("1-1-1", 42): 2}
    run.config = replace(run.config, sizes=(21, 42, 84))
    held = [task for task in run.make_tasks() if task.level == "2-2-1"]
    assert {(task.size, task.pairs_per_episode) for task in held} == {(84, 0)}


def test_a_network_that_is_refined_on_larger_grids_is_held_to_what_it_was_on_the_usual_ones(net):
    run = RefineRun(net, 4, RefineConfig(sizes=(42,)))
    assert {task.size for task in run.make_tasks() if not task.pairs_per_episode} == {21, 84}


@pytest.mark.long
def test_costs_on_a_larger_grid_are_in_proportion_to_its_side(net):
    weights = {name: tensor.numpy() for name, tensor in net.state_dict().items()}
    pairs = play_task((weights, EpisodeTask("1-1-1", 33, SEED, 2, 12)))
    moves = pairs.cost * (33 / 21)
    assert moves == pytest.approx(np.rint(moves), abs=1e-4)
    assert pairs.moves.shape[2] == MOVE_NUMBERS


def test_a_run_that_is_gone_on_with_comes_to_the_same_weights_on_any_number_of_workers(
    net, tmp_path
):
    tiny = replace(
        SMALL,
        tasks_per_level=(("random", 2),),
        first_round_tasks=1,
        episodes_per_task=1,
        pairs_per_episode=2,
        gradient_steps=3,
        batch_size=16,
        anchor_sizes=((12, 1),),
        anchor_batch_size=4,
    )
    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(2) as two:
        whole = RefineRun(deepcopy(net), 4, tiny)
        metrics = [whole.train_round(one) for _ in range(2)]
        first, second = (RefineRun(deepcopy(net), 4, tiny) for _ in range(2))
        assert first.train_round(two) == metrics[0]
        torch.save(first.state_dict(), tmp_path / "state")
        torch.rand(7)
        second.load_state_dict(torch.load(tmp_path / "state", weights_only=True))
        assert second.train_round(two) == metrics[1]
    assert all(map(torch.equal, whole.net.parameters(), second.net.parameters()))
    assert not all(map(torch.equal, whole.net.parameters(), net.parameters()))
    assert second.num_pairs == whole.num_pairs


def test_a_network_begins_with_the_moves_that_it_made(net, scorer, tmp_path):
    begun = playing(RefineRun(deepcopy(net), 4, SMALL).net, tmp_path)
    rollouts = GreedyRollouts(EnvConfig("random", 42, 42), 4)
    rollouts.worlds.start(np.arange(SEED, SEED + 4))
    for _ in range(20):
        decisions = rollouts.decide(scorer)
        logits, _ = begun.infer(decisions.planes, decisions.moves)
        valid = decisions.moves[:, :, 0] > 0
        assert logits[valid] == pytest.approx(SMALL.logit_scale * decisions.logits[valid], abs=1e-3)
        rollouts.step(decisions.actions)


@pytest.mark.long
def test_a_spoilt_network_learns_which_moves_are_better_the_same_on_any_number_of_workers(tmp_path):
    torch.manual_seed(3)
    began_with, runs = load_net(shipped()["ppo"]), []
    began_with.prior.data.zero_()
    for weights in (
        tensor.data for tensor in began_with.policy_head.parameters() if tensor.numel() > 1
    ):
        weights += weights.std() * torch.randn_like(weights)
    for workers in (1, 2):
        run = RefineRun(deepcopy(began_with), 4, replace(SMALL, ema_decay=0.97))
        with ThreadPoolExecutor(workers) as pool:
            metrics = [run.train_round(pool) for _ in range(2)]
        runs.append((run, metrics))
    (run, metrics), (other, same) = runs
    assert metrics == same
    assert all(map(torch.equal, run.net.parameters(), other.net.parameters()))
    before, after = playing(began_with, tmp_path), playing(run.net, tmp_path)
    seeds = range(SEED, SEED + 100)
    saved_moves = np.array([literal(before, seed) - literal(after, seed) for seed in seeds])
    assert saved_moves.mean() - 1.96 * saved_moves.std() / 100**0.5 > 0


def test_the_command_refines_the_file_that_plays_and_writes_a_card_and_a_log(monkeypatch, tmp_path):
    monkeypatch.setattr(refine_module, "DEFAULT_CONFIG", TINY)
    monkeypatch.setattr(cards, "HELD_OUT_TERRAINS", 3)
    folder = tmp_path / "mine"
    done = CliRunner().invoke(refine, ["--rounds=2", "--workers=1", f"--out={folder}"])
    assert done.exit_code == 0, done.output
    card, began = read_card(folder / "mine.onnx"), read_card(shipped()["ppo"])
    assert card["command"] == "python -m research.refinement ppo --rounds 2 --seed 0 --out mine"
    assert card["training"]["rounds"] == 2
    assert card["training"]["began_with"]["training"] == began["training"]
    assert card["results"]["random 21x21"]["terrains"] == 3
    lines = (folder / "log.jsonl").read_text().splitlines()
    assert [json.loads(line)["round"] for line in lines] == [1, 2]
    board = Episode.begin(EnvConfig(), seed=1).codes
    assert load(folder / "mine.onnx").act(board) in range(4)


@pytest.mark.parametrize(
    ("policy", "part"),
    [
        ("ppo-works", "ppo-works.onnx is no policy: expected the 13 weights"),
        ("ppo2", 'no policy "ppo2"'),
        ("frontier-cost", "frontier-cost is a rule"),
    ],
)
def test_what_is_no_network_of_ours_is_refused(policy, part):
    refused = CliRunner().invoke(refine, [policy])
    assert refused.exit_code == 2
    assert part in refused.output


def test_a_run_is_never_written_over(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.onnx").write_bytes(b"mine")
    refused = CliRunner().invoke(refine, ["--out", str(tmp_path / "run")])
    assert refused.exit_code == 2
    assert "exists already" in refused.output
    assert (tmp_path / "run" / "run.onnx").read_bytes() == b"mine"
