"""Measurements go on, decisions are worth at most the map, labels follow `ppo`."""

import numpy as np
from click.testing import CliRunner

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies import load
from marsexplorer.policies.files.card import shipped
from marsexplorer.terrain import generate
from marsexplorer.training.network import load_net
from research.lookahead.__main__ import main, read
from research.lookahead.distillation import Labeller, Scorer
from research.lookahead.stages import JudgedLookahead


def test_a_second_run_adds_what_is_missing_and_changes_nothing(tmp_path):
    words = ["--size", "21", "--seed", "5", "--out", str(tmp_path)]
    for terrains in ("2", "2", "3"):
        done = CliRunner().invoke(main, [*words, "--terrains", terrains])
        assert done.exit_code == 0, done.output
    lines = (tmp_path / "21.csv").read_text().splitlines()
    assert lines[0] == "side,seed,ppo,lookahead,decisions,seconds"
    rows = read(tmp_path / "21.csv")
    assert [row[1] for row in rows] == [5, 6, 7]
    assert all(row[2] > 30 and row[3] > 30 and row[4] > 5 for row in rows)


def test_what_a_decision_finds_is_at_most_what_knowing_the_map_gives():
    config, watched = EnvConfig.of("random", 15), JudgedLookahead()
    watched.watch(generate(config, 5), 5)
    play_episode(watched, config, 5)
    shares, by_looking, by_knowing, _ = zip(*watched.decisions, strict=True)
    assert min(shares) < 0.6 < max(shares)
    assert all(some <= most for some, most in zip(by_looking, by_knowing, strict=True))
    assert min(by_knowing) >= 0 < max(by_knowing)


def test_labels_are_of_other_moves_and_the_episode_is_that_of_ppo():
    net = Scorer().eval()
    net.load_state_dict(load_net(shipped()["ppo"]).state_dict())
    labeller = Labeller(net, np.random.default_rng(0))
    config = EnvConfig.of("random", 21)
    labelled, alone = (play_episode(policy, config, 5) for policy in (labeller, load("ppo")))
    assert labelled.actions == alone.actions
    _, moves, base, other, cost = (np.array(column) for column in zip(*labeller.pairs, strict=True))
    assert (base != other).all()
    assert moves[np.arange(len(other)), other, 0].all()  # only what can be done
    assert 0 < (cost < 0).mean() < 0.5
    assert labeller.observations
