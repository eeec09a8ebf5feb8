"""Policies from files of other makers: played as they would play, and refused with a sentence when they are anything else."""

import json
import subprocess
import sys

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto

from app.cli.main import main
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import PolicyFileError
from marsexplorer.policies.files.weights import save_network
from marsexplorer.policies.network.model import Net, format_of
from marsexplorer.policies.network.onnx_network import write_onnx
from tests.support import policy_files as files

SIZE = (6, 7)
CONFIG = EnvConfig.of("random", SIZE, max_steps=60)


def boards(count=30, config=CONFIG, seed=0):
    """Yield observations along random valid walks."""
    walker, rng = policies.load("random"), np.random.default_rng(seed)
    walker.reset(seed)
    episode = Episode.begin(config, seed=seed)
    for _ in range(count):
        if episode.ended:
            episode = Episode.begin(config, seed=int(rng.integers(1000)))
        yield episode
        episode.step(walker.act(episode.codes))


def literal(weights, observation, activation=torch.tanh):
    """MlpPolicy written out: four scores and the value."""
    x = torch.from_numpy(observation).flatten()[None]

    def net(name):
        y = x
        for at in (0, 2):
            layer = f"mlp_extractor.{name}.{at}"
            y = activation(y @ weights[f"{layer}.weight"].T + weights[f"{layer}.bias"])
        return y

    scores = net("policy_net") @ weights["action_net.weight"].T + weights["action_net.bias"]
    value = net("value_net") @ weights["value_net.weight"].T + weights["value_net.bias"]
    return scores[0].numpy(), float(value[0, 0])


def valid(episode):
    row, col = episode.position
    near = ((row - 1, col), (row, col + 1), (row + 1, col), (row, col - 1))
    return [0 <= r < SIZE[0] and 0 <= c < SIZE[1] and episode.codes[r, c] != 3 for r, c in near]


@pytest.mark.parametrize("masked", [True, False])
def test_an_mlp_policy_decides_as_written_out(masked, tmp_path):
    weights = files.flat_weights()
    policy = policies.load(
        files.write_sb3(tmp_path / "mine.zip", weights, files.sb3_description(masked=masked))
    )
    assert policy.name == "mine"
    assert isinstance(policy, policies.Policy)
    overruled = 0
    for episode in boards():
        scores, value = literal(weights, episode.observation())
        blind = int(scores.argmax())
        if masked:
            scores[~np.array(valid(episode))] = -np.inf
        overruled += blind != int(scores.argmax())
        assert (
            policy.act(episode.observation()) == policy.act(episode.codes) == int(scores.argmax())
        )
        probabilities, thought_value = policy.thought()
        shares = np.exp(scores - scores.max())
        assert probabilities == pytest.approx(shares / shares.sum(), abs=1e-6)
        assert thought_value == pytest.approx(value, abs=1e-5)
    assert (overruled > 0) == masked


def test_the_activation_is_read_from_the_text(tmp_path):
    weights, relu = files.flat_weights(), "<class 'torch.nn.modules.activation.ReLU'>"
    policy = policies.load(
        files.write_sb3(
            tmp_path / "mine.zip", weights, files.sb3_description(masked=False, activation_fn=relu)
        )
    )
    for episode in boards():
        scores, value = literal(weights, episode.observation(), torch.relu)
        assert policy.act(episode.codes) == int(scores.argmax())
        assert policy.thought()[1] == pytest.approx(value, abs=1e-5)


def test_codes_are_what_a_model_trained_on_codes_gets(tmp_path):
    weights = files.flat_weights()
    policy = policies.load(
        files.write_sb3(
            tmp_path / "mine.zip", weights, files.sb3_description(masked=False, dtype="uint8")
        )
    )
    for episode in boards():
        policy.act(episode.codes)
        assert policy.thought()[1] == pytest.approx(
            literal(weights, episode.codes.astype(np.float32))[1], abs=1e-5
        )


def test_terrain_features_are_the_ones_of_the_example(tmp_path):
    weights = files.terrain_weights()
    about = files.sb3_description(features_extractor_class="<class '__main__.TerrainFeatures'>")
    policy = policies.load(files.write_sb3(tmp_path / "mine.zip", weights, about))
    for episode in boards():
        planes = torch.stack(
            [torch.from_numpy((episode.codes == code).astype(np.float32)) for code in range(4)]
        )[None]
        x = planes
        for at in (0, 2):
            layer = f"features_extractor.cnn.{at}"
            x = torch.conv2d(
                x, weights[f"{layer}.weight"], weights[f"{layer}.bias"], stride=2, padding=1
            ).relu()
        linear = "features_extractor.linear.0"
        x = (x.flatten(1) @ weights[f"{linear}.weight"].T + weights[f"{linear}.bias"]).relu()
        policy.act(episode.codes)
        assert policy.thought()[1] == pytest.approx(literal(weights, x.numpy())[1], abs=1e-5)


def test_pickles_in_the_text_and_next_to_the_weights_are_never_read(tmp_path):
    marker = tmp_path / "marker"
    about = files.sb3_description() | {
        "lr_schedule": {":type:": "x", ":serialized:": files.hidden_pickle(marker)}
    }
    about["policy_kwargs"][":serialized:"] = about["observation_space"][":serialized:"] = (
        files.hidden_pickle(marker)
    )
    evil = files.saved(files.runs(marker))
    path = files.write_sb3(
        tmp_path / "mine.zip",
        None,
        about,
        **{"pytorch_variables.pth": evil, "policy.optimizer.pth": evil},
    )
    policy = policies.load(path)
    policy.act(Episode.begin(CONFIG, seed=0).codes)
    assert not marker.exists()


def test_the_pickles_of_the_corpus_do_run_where_they_are_unpickled(tmp_path):
    import pickle

    marker = tmp_path / "marker"
    pickle.loads(pickle.dumps(files.runs(marker)))
    assert marker.exists()


@pytest.mark.parametrize("kind", files.BROKEN_SB3)
def test_a_broken_zip_is_refused_and_runs_nothing(kind, tmp_path):
    marker = tmp_path / "marker"
    before = set(tmp_path.parent.iterdir())
    path = files.broken_sb3(kind, tmp_path / "bad.zip", marker)
    with pytest.raises(
        PolicyFileError, match=r"(?s)bad\.zip is no policy: expected .*, got .*; save a PPO"
    ) as refusal:
        policies.load(path)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 500
    assert not marker.exists()
    assert set(tmp_path.parent.iterdir()) == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("kind", files.BROKEN_ONNX)
def test_a_broken_onnx_file_is_refused_and_runs_nothing(kind, tmp_path):
    marker = tmp_path / "marker"
    path = files.broken_onnx(kind, tmp_path / "bad.onnx", marker)
    with pytest.raises(
        PolicyFileError, match=r"(?s)bad\.onnx is no policy: expected .*, got .*; give an ONNX"
    ) as refusal:
        policies.load(path)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 500
    assert not marker.exists()


@pytest.mark.parametrize(
    "given", [{}, {"batch": 0}, {"dtype": TensorProto.UINT8}, {"value": False}, {"masked": True}]
)
def test_an_onnx_policy_decides_as_written_out(given, tmp_path):
    policy = policies.load(files.write_onnx(tmp_path / "mine.onnx", **given))
    assert policy.name == "mine"
    weights = np.random.default_rng(0).normal(size=(42, 4)).astype(np.float32)
    raw = given.get("dtype") == TensorProto.UINT8
    for episode in boards():
        board = episode.codes.astype(np.float32) if raw else episode.observation()
        scores = board.reshape(1, 42) @ weights
        value = scores.mean()
        if given.get("masked"):
            scores[0, ~np.array(valid(episode))] = -np.inf
        assert policy.act(episode.codes) == int(scores.argmax())
        if given.get("value", True):
            assert policy.thought()[1] == pytest.approx(value, abs=1e-4)
        else:
            assert np.isnan(policy.thought()[1])


def test_a_board_of_another_size_is_refused_with_the_size_it_was_made_for(tmp_path):
    other = Episode.begin(EnvConfig.of("random", (7, 6)), seed=0).codes
    for path in (files.write_sb3(tmp_path / "a.zip"), files.write_onnx(tmp_path / "b.onnx")):
        with pytest.raises(ValueError, match=r"made for 6x7 and cannot play 7x6"):
            policies.load(path).act(other)


@pytest.mark.parametrize("sees_prices", [False, True], ids=["few numbers", "prices"])
def test_a_network_written_as_onnx_plays_the_same_episode(sees_prices, tmp_path):
    torch.manual_seed(3)
    net = Net(sees_prices)
    save_network(net, tmp_path / "own.safetensors", {"summary": "Wanders."}, format_of(net))
    write_onnx(tmp_path / "own.safetensors", tmp_path / "twin.onnx")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["own.safetensors", "twin.onnx"]
    assert policies.describe(str(tmp_path / "twin.onnx")) == "Wanders."
    ours, twin = policies.load(tmp_path / "own.safetensors"), policies.load(tmp_path / "twin.onnx")
    for size in ((9, 14), (21, 21)):
        episode = Episode.begin(EnvConfig.of("random", size, max_steps=150), seed=4)
        ours.reset(4), twin.reset(4)
        while not episode.ended:
            action, shares = ours.act(episode.codes), np.sort(ours.thought()[0])
            assert (
                twin.act(episode.codes) == action or shares[3] - shares[2] < 1e-5
            )  # rounding decides between equals
            assert twin.thought()[0] == pytest.approx(ours.thought()[0], abs=1e-4)
            assert twin.thought()[1] == pytest.approx(ours.thought()[1], abs=1e-3)
            episode.step(action)


def test_the_written_onnx_carries_the_card(tmp_path):
    save_network(Net(), tmp_path / "own.safetensors", {"summary": "Wanders."})
    write_onnx(tmp_path / "own.safetensors", tmp_path / "twin.onnx")
    metadata = {one.key: one.value for one in onnx.load(tmp_path / "twin.onnx").metadata_props}
    assert json.loads(metadata["card"])["summary"] == "Wanders."


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_a_missing_package_is_asked_for_by_name(package, tmp_path, monkeypatch):
    path = files.write_onnx(tmp_path / "mine.onnx")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(
        PolicyFileError, match=rf"need the package {package}, .*pip install .*\[onnx\]"
    ):
        policies.load(path)


def test_evaluate_scores_files_of_other_makers(tmp_path):
    files.write_sb3(tmp_path / "mine.zip")
    files.write_onnx(tmp_path / "other.onnx", masked=True)
    names = ["--policy", str(tmp_path / "mine.zip"), "--policy", str(tmp_path / "other.onnx")]
    command = [
        sys.executable,
        "-m",
        "app.cli",
        "evaluate",
        *names,
        "--size",
        "6x7",
        "--episodes",
        "3",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "mine" in done.stdout
    assert "other" in done.stdout


def test_evaluate_refuses_a_size_that_a_policy_was_not_made_for(tmp_path, capsys):
    path = files.write_sb3(tmp_path / "mine.zip")
    with pytest.raises(SystemExit) as left:
        main(["evaluate", "--policy", str(path), "--size", "9", "--episodes", "3"])
    said = capsys.readouterr().err
    assert left.value.code == 2
    assert "made for 6x7 and cannot play 9x9" in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("head", ["policy_head", "value_head"])
def test_finite_weights_whose_sums_are_not_are_refused_at_load(head, tmp_path):
    net = Net()
    with torch.no_grad():
        for layer in (getattr(net, head)[0], getattr(net, head)[2]):
            layer.weight.fill_(3e38)
            layer.bias.fill_(3e38)
    save_network(net, tmp_path / "huge.safetensors", {"summary": "Overflows."})
    with pytest.raises(PolicyFileError, match="finite numbers from a first decision"):
        policies.load(tmp_path / "huge.safetensors")


def test_other_makers_finite_weights_whose_sums_are_not_are_refused_too(tmp_path):
    weights = files.flat_weights()
    weights["mlp_extractor.policy_net.2.bias"][:], weights["action_net.weight"][:] = 50, 3e38
    path = files.write_sb3(tmp_path / "huge.zip", weights)
    with pytest.raises(PolicyFileError, match="finite numbers from a first decision"):
        policies.load(path)
