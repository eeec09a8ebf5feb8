"""`marsexplorer clone`: a policy from a release's people, held-out terrains, and no clone of nobody."""

import pytest

from app.cli.main import main
from app.release.build import ReleaseRequest, build_release
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.agreement import Agreement, agreement_with
from marsexplorer.policies import load
from marsexplorer.policies.files.card import read_card
from marsexplorer.policies.network.model import NetworkPolicy
from marsexplorer.training.clone import CloneConfig, demonstrations_of, train_clone
from tests.support.stored_studies import freeze, play_study

CONFIG = EnvConfig("random", 9, 12, sensor_radius=4)


def released(folder, **rest):
    play_study(folder / "play.db", freeze(folder / "studies"), **rest)
    build_release(ReleaseRequest(folder / "play.db", "dunes", folder / "out"))
    return folder / "out"


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return released(tmp_path_factory.mktemp("clone"))


@pytest.fixture
def clone(capsys):
    """`clone(...)` runs the command and returns exit code, stdout, stderr."""

    def run(*words):
        with pytest.raises(SystemExit) as left:
            main(["clone", *map(str, words)])
        said = capsys.readouterr()
        return left.value.code or 0, said.out, said.err

    return run


def test_a_release_becomes_a_policy_with_a_card(clone, bundle, tmp_path):
    path = tmp_path / "dunes.safetensors"
    code, out, err = clone(bundle, "--out", path, "--epochs", 2)
    assert (code, err) == (0, "")
    assert "held-out terrains it makes" in out
    assert "other policies make of them: ppo" in out
    card = read_card(path)
    assert card["summary"].startswith("A clone of the people of the study dunes, from ")
    assert 0 <= card["results"]["human_likeness"] <= 1
    assert load(path).act(Episode.begin(CONFIG, seed=1).codes) in range(4)
    assert clone(bundle, "--out", tmp_path / "again.safetensors", "--epochs", 2)[0] == 0
    assert (tmp_path / "again.safetensors").read_bytes() == path.read_bytes()


def test_scripts_alone_are_refused_and_marked_when_asked_for(clone, tmp_path):
    bundle = released(tmp_path, kinds=("script", "script"))
    code, _, err = clone(bundle, "--out", tmp_path / "no.safetensors")
    assert code == 1
    assert "finished ranked episodes of people" in err
    assert not (tmp_path / "no.safetensors").exists()
    assert (
        clone(bundle, "--synthetic", "--epochs", 1, "--out", tmp_path / "yes.safetensors")[0] == 0
    )
    assert "SYNTHETIC" in read_card(tmp_path / "yes.safetensors")["summary"]


def test_a_changed_release_is_refused(clone, tmp_path):
    bundle = released(tmp_path)
    with (bundle / "study.sqlite").open("ab") as file:
        file.write(b"more")
    code, _, err = clone(bundle)
    assert code == 1
    assert "is not as it was signed" in err


def test_a_clone_learns_the_moves_it_is_shown():
    rule = load("frontier-cost", CONFIG.sensor_radius)

    def record(seed):
        episode = Episode.begin(CONFIG, seed=seed)
        rule.reset(0)
        while not episode.ended:
            episode.step(rule.act(episode.codes))
        return episode.record()

    net = train_clone(demonstrations_of(record(seed) for seed in range(40)), CloneConfig(epochs=8))
    held = [record(seed) for seed in range(100, 110)]
    policy = NetworkPolicy("clone", net, CONFIG.sensor_radius)
    assert sum((agreement_with(policy, each) for each in held), start=Agreement()).share > 0.8
