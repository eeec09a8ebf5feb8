"""Policies of other makers' files play as they would, or a sentence refuses them."""

import json
import pickle
import subprocess
import sys
from contextlib import suppress

import numpy as np
import onnx
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import TensorProto

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import PolicyFileError
from marsexplorer.policies.files.card import read_card
from marsexplorer.training.network import Net, load_net, save_network
from tests.support import policy_files as files
from tests.support.command import command

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


def valid(episode):
    row, col = episode.position
    near = ((row - 1, col), (row, col + 1), (row + 1, col), (row, col - 1))
    return [0 <= r < SIZE[0] and 0 <= c < SIZE[1] and episode.codes[r, c] != 3 for r, c in near]


def test_the_pickles_of_the_corpus_do_run_where_they_are_unpickled(tmp_path):
    marker = tmp_path / "marker"
    pickle.loads(pickle.dumps(files.runs(marker)))
    assert marker.exists()


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
    "options", [{}, {"batch": 0}, {"dtype": TensorProto.UINT8}, {"value": False}, {"masked": True}]
)
def test_an_onnx_policy_decides_as_written_out(options, tmp_path):
    policy = policies.load(files.write_onnx(tmp_path / "mine.onnx", **options))
    assert policy.name == "mine"
    weights = np.random.default_rng(0).normal(size=(42, 4)).astype(np.float32)
    raw = options.get("dtype") == TensorProto.UINT8
    for episode in boards():
        board = episode.codes.astype(np.float32) if raw else episode.observation()
        scores = board.reshape(1, 42) @ weights
        value = scores.mean()
        if options.get("masked"):
            scores[0, ~np.array(valid(episode))] = -np.inf
        assert policy.act(episode.codes) == int(scores.argmax())
        if options.get("value", True):
            assert policy.thought()[1] == pytest.approx(value, abs=1e-4)
        else:
            assert np.isnan(policy.thought()[1])


def test_a_board_of_another_size_is_refused_with_the_size_it_was_made_for(tmp_path):
    other = Episode.begin(EnvConfig.of("random", (7, 6)), seed=0).codes
    with pytest.raises(ValueError, match=r"made for 6x7 and cannot play 7x6"):
        policies.load(files.write_onnx(tmp_path / "b.onnx")).act(other)


def test_a_network_plays_what_it_computes_where_it_is_trained_and_is_read_back_as_it_was(tmp_path):
    torch.manual_seed(3)
    net, path = Net().eval(), tmp_path / "own.onnx"
    before = torch.get_rng_state()
    save_network(net, path, {"summary": "Wanders."})
    assert torch.equal(torch.get_rng_state(), before)  # a training may be under way
    assert [path.name for path in tmp_path.iterdir()] == ["own.onnx"]
    assert policies.describe(str(path)) == "Wanders."
    policy, again = policies.load(path), load_net(path)
    seen = []
    for size in ((9, 14), (21, 21)):
        episode = Episode.begin(EnvConfig.of("random", size, max_steps=150), seed=4)
        policy.reset(4)
        while not episode.ended:
            planes, moves = policy.extract_features(episode.codes)
            seen.append((planes.copy(), moves.copy(), *policy.net.infer(planes, moves)))
            episode.step(policy.choose(seen[-1][2][0], 0.0))
    planes, moves, logits, values = (np.concatenate(arrays) for arrays in zip(*seen, strict=True))
    for computed in (net, again):
        with torch.inference_mode():
            expected = computed(torch.from_numpy(planes), torch.from_numpy(moves))
        assert logits == pytest.approx(expected[0].numpy(), abs=1e-4)
        assert values == pytest.approx(expected[1].numpy(), abs=1e-3)
    assert all(
        torch.equal(*both) for both in zip(net.parameters(), again.parameters(), strict=True)
    )


@pytest.mark.parametrize("card", ["{", "1", "[" * 200_000])
def test_a_card_that_is_none_is_no_card(card, tmp_path):
    model = files.onnx_model()
    model.metadata_props.add(key="card", value=card)
    onnx.save(model, tmp_path / "mine.onnx")
    assert read_card(tmp_path / "mine.onnx") == {}
    assert policies.describe(str(tmp_path / "mine.onnx")) == "A policy from an ONNX file."


def test_a_missing_onnxruntime_is_asked_for_by_name(tmp_path, monkeypatch):
    path = files.write_onnx(tmp_path / "mine.onnx")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(
        PolicyFileError, match=r"need the package onnxruntime, .*pip install .*\[play\]"
    ):
        policies.load(path)


WITHOUT_ONNX = """
import sys
sys.modules["onnx"] = None
from pathlib import Path
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies.files.card import read_card, write_card
path = Path(sys.argv[1])
write_card(path, {**read_card(path), "limits": "None known."})
assert policies.describe(str(path)) == "Mine."
codes = Episode.begin(EnvConfig.of("random", (6, 7)), seed=0).codes
assert policies.load(path).act(codes) in range(4)
policies.load("ppo")
"""


def test_policy_files_are_read_and_their_cards_written_without_the_package_onnx(tmp_path):
    path = files.write_onnx(tmp_path / "mine.onnx", card={"summary": "Mine."})
    before = onnx.load(path)
    subprocess.run([sys.executable, "-c", WITHOUT_ONNX, str(path)], check=True)
    after = onnx.load(path)
    onnx.checker.check_model(after)
    assert json.loads(after.metadata_props[0].value) == {
        "summary": "Mine.",
        "limits": "None known.",
    }
    del before.metadata_props[:], after.metadata_props[:]
    assert after == before


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_a_file_with_other_bytes_loads_or_is_refused(data, tmp_path_factory):
    """ONNX Runtime gets what our own reader lets through: it must not end the process."""
    model = bytearray(files.onnx_model().SerializeToString())
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(model) - 1))
        model[place : place + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    path = tmp_path_factory.getbasetemp() / "changed.onnx"
    path.write_bytes(model)
    with suppress(PolicyFileError):
        policies.load(path)


def test_evaluate_scores_files_of_other_makers(tmp_path, capsys):
    files.write_onnx(tmp_path / "mine.onnx")
    files.write_onnx(tmp_path / "other.onnx", masked=True)
    names = ["--policy", str(tmp_path / "mine.onnx"), "--policy", str(tmp_path / "other.onnx")]
    code, printed, _ = command(capsys, "evaluate", *names, "--size", "6x7", "--episodes", "3")
    assert code == 0
    assert "mine" in printed
    assert "other" in printed


def test_evaluate_refuses_a_size_that_a_policy_was_not_made_for(tmp_path, capsys):
    path = files.write_onnx(tmp_path / "mine.onnx")
    options = "--policy", path, "--size", "9", "--episodes", "3"
    code, _, complaint = command(capsys, "evaluate", *options)
    assert code == 2
    assert "made for 6x7 and cannot play 9x9" in complaint
    assert len(complaint.splitlines()) == 1


@pytest.mark.parametrize(("head", "output"), [("policy_head", "logits"), ("value_head", "value")])
def test_finite_weights_whose_sums_are_not_are_refused_at_load(head, output, tmp_path):
    net = Net()
    with torch.no_grad():
        for layer in (getattr(net, head)[0], getattr(net, head)[2]):
            layer.weight.fill_(3e38)
            layer.bias.fill_(3e38)
    save_network(net, tmp_path / "huge.onnx", {"summary": "Overflows."})
    with pytest.raises(PolicyFileError, match=f"finite numbers in {output}"):
        policies.load(tmp_path / "huge.onnx")


def test_other_makers_finite_weights_whose_sums_are_not_are_refused_too(tmp_path):
    model = files.onnx_model()
    held = {one.name: one for one in model.graph.initializer}
    held["w"].raw_data = np.full((42, 4), 3e38, np.float32).tobytes()
    onnx.save(model, tmp_path / "huge.onnx")
    with pytest.raises(PolicyFileError, match="finite numbers from a first decision"):
        policies.load(tmp_path / "huge.onnx")
    model = files.onnx_model()
    last = next(node for node in model.graph.node if node.output[0] == "value")
    last.output[0] = "mean"
    model.graph.node.append(onnx.helper.make_node("Sqrt", ["mean"], ["value"]))
    held = {one.name: one for one in model.graph.initializer}
    held["w"].raw_data = np.full((42, 4), -1, np.float32).tobytes()
    onnx.save(
        model, tmp_path / "nan.onnx"
    )  # 0 for zeros, for a board the root of a negative number
    with pytest.raises(PolicyFileError, match="finite numbers"):
        policies.load(tmp_path / "nan.onnx")
