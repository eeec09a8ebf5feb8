"""The clone example: a policy from a release's people, on held-out terrains."""

import importlib.util
import sys
from pathlib import Path

import pytest
import torch

from humanplay.release.build import ReleaseRequest, build_release
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import Agreement, agreement_with, play_episode
from marsexplorer.policies import load
from marsexplorer.policies.files.card import read_card
from marsexplorer.training.network import Net, save_network
from tests.support.stored_studies import freeze, play_study


@pytest.fixture(scope="module")
def example():
    path = Path(__file__).parents[2] / "examples" / "clone.py"
    spec = importlib.util.spec_from_file_location("clone", path)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    return example


@pytest.fixture
def clone(example, tmp_path, monkeypatch):
    """`clone(kinds, words)` runs the example on a small study of these players."""

    def call(kinds, *words):
        bundle = tmp_path / "out"
        if not bundle.exists():
            study = freeze(tmp_path / "studies", warm_up=1, ranked=2)
            play_study(tmp_path / "play.db", study, kinds)
            build_release(ReleaseRequest(tmp_path / "play.db", "dunes", bundle))
        monkeypatch.setattr(sys, "argv", ["clone.py", str(bundle), *map(str, words)])
        example.main()

    return call


@pytest.mark.long
def test_a_release_becomes_a_policy_with_a_card(clone, tmp_path, capsys):
    people, first, again = ("human", "human"), tmp_path / "dunes.onnx", tmp_path / "again.onnx"
    clone(people, "--out", first, "--epochs", 2)
    assert "on 1 held-out terrains it makes" in capsys.readouterr().out
    card = read_card(first)
    assert card["summary"].startswith("A clone of the people of out, from ")
    assert 0 <= card["results"]["human_likeness"] <= 1
    board = Episode.begin(EnvConfig("random", 9, 12, sensor_radius=4), seed=1).codes
    assert load(first).act(board) in range(4)
    clone(people, "--out", again, "--epochs", 2)
    assert again.read_bytes() == first.read_bytes(), "release and seed fix the weights"


def test_scripts_alone_are_refused_and_marked_when_asked_for(clone, tmp_path):
    scripts, out = ("script", "script"), tmp_path / "scripts.onnx"
    with pytest.raises(SystemExit, match="no finished ranked episodes of people"):
        clone(scripts, "--out", out)
    assert not out.exists()
    clone(scripts, "--synthetic", "--epochs", 1, "--out", out)
    assert "SYNTHETIC" in read_card(out)["summary"]


def test_a_clone_learns_the_moves_it_is_shown(example, tmp_path):
    config, rule = EnvConfig("random", 9, 12, sensor_radius=4), load("frontier-cost", 4)

    def record(seed):
        return play_episode(rule, config, seed).record()

    torch.manual_seed(0)
    net = Net()
    shown = example.demonstrations_of([record(seed) for seed in range(40)])
    example.fit(net, shown, epochs=8, seed=0)
    save_network(net, tmp_path / "clone.onnx", {})
    policy = load(tmp_path / "clone.onnx", 4)
    held = (record(seed) for seed in range(100, 110))
    assert sum((agreement_with(policy, held_out) for held_out in held), Agreement()).share > 0.8
