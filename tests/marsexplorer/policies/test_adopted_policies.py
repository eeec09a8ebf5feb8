"""ONNX files of other libraries, read with answers to what their shapes lack.

Each is written as one of ours.
"""

import json
import os
import sys

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from marsexplorer import policies
from marsexplorer.evaluation.boards import observations
from marsexplorer.observation import STATE_VALUES
from marsexplorer.policies.files.adopt import ComplaintsError, adopt
from marsexplorer.policies.files.adoption import Answers
from marsexplorer.policies.files.card import read_card
from tests.support.command import command

ROWS, COLS = SIZE = (6, 7)
WEIGHTS = np.random.default_rng(5).normal(size=(4 * ROWS * COLS, 4)).astype(np.float32)
FLOAT, DOUBLE, UINT8, INT64 = (
    TensorProto.FLOAT,
    TensorProto.DOUBLE,
    TensorProto.UINT8,
    TensorProto.INT64,
)
EQ6 = Answers(values="eq6", acts="greedy")


def model(
    shape=(1, ROWS, COLS),
    name="observation",
    kind=FLOAT,
    output="logits",
    states=False,
    extra=(),
    out_kind=FLOAT,
):
    """A linear policy over the flattened input.

    With states it adds a tenth of the last scores, unless an episode starts.
    """
    count = int(np.prod([side or 1 for side in shape]))
    nodes = [
        helper.make_node("Cast", [name], ["floats"], to=FLOAT),
        helper.make_node("Reshape", ["floats", "flat_shape"], ["flat"]),
        helper.make_node("MatMul", ["flat", "w"], ["raw"]),
    ]
    tensors = [
        numpy_helper.from_array(WEIGHTS[:count].copy(), "w"),
        numpy_helper.from_array(np.array([1, count]), "flat_shape"),
        numpy_helper.from_array(np.array(0.1, np.float32), "tenth"),
    ]
    inputs = [
        helper.make_tensor_value_info(name, kind, [side or "batch" for side in shape]),
        *extra,
    ]
    outputs = [
        helper.make_tensor_value_info(output, out_kind, [1] if out_kind == INT64 else [1, 4])
    ]
    scores = "raw"
    if states:
        nodes += [
            helper.make_node("Mul", ["h", "tenth"], ["little"]),
            helper.make_node("Add", ["little", "first"], ["with_start"]),
            helper.make_node("Add", ["raw", "with_start"], ["h_out"]),
        ]
        inputs += [helper.make_tensor_value_info("h", FLOAT, [1, 4])]
        inputs += [helper.make_tensor_value_info("first", FLOAT, [1])]
        outputs += [helper.make_tensor_value_info("h_out", FLOAT, [1, 4])]
        scores = "h_out"
    if out_kind == INT64:
        nodes += [helper.make_node("ArgMax", [scores], [output], axis=1, keepdims=0)]
    else:
        nodes += [helper.make_node("Identity", [scores], [output])]
    graph = helper.make_graph(nodes, "policy", inputs, outputs, tensors)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def best(*boards):
    """The move of the linear policy on frames, the first of which comes first."""
    flat = np.concatenate([np.asarray(board, np.float32).reshape(-1) for board in boards])
    return int((flat @ WEIGHTS[: len(flat)]).argmax())


def added(folder, proto, answers):
    """The policy of a model that was read with these answers."""
    onnx.save(proto, folder / "net.onnx")
    adopt(folder / "net.onnx", folder / "added.onnx", answers, observations)
    return policies.load(folder / "added.onnx")


KINDS = {
    "as SB3 documents it": (
        {"name": "input", "output": "actions", "out_kind": INT64},
        Answers(values="eq6"),
    ),
    "another sole input": ({"name": "x.1"}, EQ6),
    "an open batch": ({"shape": (None, ROWS, COLS)}, EQ6),
    "a channel": ({"shape": (1, 1, ROWS, COLS)}, EQ6),
    "no batch": ({"shape": SIZE}, EQ6),
    "an output without a name": ({"output": "42"}, EQ6),
    "Q": ({"output": "q_values"}, EQ6),
    "double": ({"kind": DOUBLE}, EQ6),
    "flat": ({"shape": (1, ROWS * COLS)}, Answers(values="eq6", acts="greedy", size=SIZE)),
    "codes in floats": ({}, Answers(values="codes", acts="greedy")),
    "codes": ({"kind": UINT8}, Answers(acts="greedy")),
    "codes in whole numbers": ({"kind": INT64}, Answers(acts="greedy")),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_foreign_file_plays_as_it_was_made(kind, tmp_path):
    parts, answers = KINDS[kind]
    policy = added(tmp_path, model(**parts), answers)
    assert policy.size == SIZE
    for codes, _ in observations(SIZE):
        board = codes if "codes" in kind else STATE_VALUES[codes]
        assert policy.act(codes) == best(board)


@pytest.mark.parametrize("frames", ["oldest", "newest"])
@pytest.mark.parametrize("padding", ["zeros", "repeat"])
@pytest.mark.parametrize("is_flat", [False, True])
def test_frames_are_stacked_as_they_are_said_to_be(frames, padding, is_flat, tmp_path):
    shape = (1, 3 * ROWS * COLS) if is_flat else (1, 3, ROWS, COLS)
    answers = Answers(values="eq6", acts="greedy", size=SIZE, frames=frames, padding=padding)
    policy = added(tmp_path, model(shape), answers)
    seen = []
    for codes, is_start in observations(SIZE):
        newest = STATE_VALUES[codes]
        if is_start:
            policy.reset(0)
            seen = 2 * [newest if padding == "repeat" else np.zeros(SIZE)]
        seen = [*seen[-2:], newest]
        assert policy.act(codes) == best(*(seen if frames == "oldest" else seen[::-1]))


def test_states_are_carried_through_an_episode_and_begin_anew_in_the_next(tmp_path):
    states = {"states": (("h", "h_out"),), "initial": "zeros", "start": "first"}
    policy = added(tmp_path, model(states=True), Answers(values="eq6", acts="greedy", **states))
    hidden, starts = np.zeros(4), 0
    for codes, is_start in observations(SIZE):
        if is_start:
            policy.reset(0)
            hidden, starts = np.zeros(4), starts + 1
        scores = STATE_VALUES[codes].reshape(-1) @ WEIGHTS[: ROWS * COLS]
        hidden = scores + 0.1 * hidden + is_start
        assert policy.act(codes) == int(hidden.argmax())
        assert policy.thought()[0] == pytest.approx(np.exp(hidden) / np.exp(hidden).sum(), abs=1e-4)
    assert starts > 3


def test_the_card_says_how_a_file_was_read(tmp_path):
    added(tmp_path, model(name="input"), Answers(values="eq6", acts="samples", scores="logits"))
    card = read_card(tmp_path / "added.onnx")
    assert card["acts"] == "samples"
    assert card["read_as"]["observation"] == "input float[1, 6, 7] holds eq. 6, 6x7"


def test_all_that_is_amiss_is_listed_at_once_with_what_mends_it(tmp_path):
    extra = (helper.make_tensor_value_info("h", FLOAT, [1, 8]),)
    proto = model((5, 3, ROWS, COLS), name="obs", output="scores", extra=extra)
    proto.graph.node[2].domain = "ai.mine"
    proto.graph.node.append(helper.make_node("Multinomial", ["raw"], ["drawn"]))
    tensor = proto.graph.initializer[0]
    onnx.external_data_helper.set_external_data(tensor, "gone.data")
    tensor.ClearField("raw_data")
    (tmp_path / "net.onnx").write_bytes(proto.SerializeToString())
    with pytest.raises(ComplaintsError) as refused:
        adopt(tmp_path / "net.onnx", tmp_path / "added.onnx", Answers(), observations)
    wanted = [
        ("lie in gone.data, which is not beside it", "external_data=False"),
        ("ai.mine.MatMul", "torch.onnx.export"),
        ("the graph draws (Multinomial)", "return the logits"),
        ("the input h float[1, 8] is unexplained", "--state h=OUTPUT"),
        ("whether obs float[5, 3, 6, 7] holds eq. 6", "--values eq6"),
        ("takes the best of scores float[1, 4] or draws", "--acts greedy"),
        ("expected one board at a time", "torch.zeros(1, 3, 6, 7)"),
        ("holds 3 frames", "--frames oldest"),
    ]
    assert len(refused.value.complaints) == len(wanted)
    for amiss, remedy in wanted:
        assert any(amiss in line and remedy in line for line in refused.value.complaints), amiss
    assert not (tmp_path / "added.onnx").exists()


def test_drawing_needs_logits(tmp_path):
    onnx.save(model(), tmp_path / "net.onnx")
    for scores, amiss in (
        (None, "holds logits or Q does not show"),
        ("q", "nothing is drawn from Q"),
    ):
        with pytest.raises(ComplaintsError, match=amiss):
            adopt(
                tmp_path / "net.onnx",
                tmp_path / "x.onnx",
                Answers("eq6", acts="samples", scores=scores),
                observations,
            )


def outside(folder, location, **more):
    """A model whose weights lie in another file."""
    proto = model()
    tensor = proto.graph.initializer[0]
    held = tensor.raw_data
    onnx.external_data_helper.set_external_data(tensor, location, **more)
    tensor.ClearField("raw_data")
    (folder / "net.onnx").write_bytes(proto.SerializeToString())
    return held


def test_weights_beside_a_file_are_put_in(tmp_path):
    held = outside(tmp_path, "net.onnx.data", offset=16, length=ROWS * COLS * 16)
    (tmp_path / "net.onnx.data").write_bytes(b"\0" * 16 + held)
    adopt(tmp_path / "net.onnx", tmp_path / "added.onnx", EQ6, observations)
    (tmp_path / "net.onnx.data").unlink()
    policy = policies.load(tmp_path / "added.onnx")
    for codes, _ in observations(SIZE):
        assert policy.act(codes) == best(STATE_VALUES[codes])


@pytest.mark.parametrize(
    ("kind", "amiss"),
    [
        ("link", "expected a plain file, no link or pipe"),
        ("pipe", "expected a plain file, no link or pipe"),
        ("above", "expected a file in the same folder"),
        ("absolute", "expected a file in the same folder"),
        ("short", "lie outside w"),
        ("far", "lie outside w"),
        ("negative", "lie outside w"),
    ],
)
def test_weights_are_read_from_a_plain_file_beside_it_alone(kind, amiss, tmp_path):
    folder = tmp_path / "models"
    folder.mkdir()
    size = ROWS * COLS * 16
    location = {"above": "../w", "absolute": str(tmp_path / "w")}.get(kind, "w")
    offset = {"far": 2**62, "negative": -16}.get(kind, 0)
    outside(folder, location, offset=offset, length=size)
    (tmp_path / "w").write_bytes(b"\0" * size)
    if kind == "link":
        (folder / "w").symlink_to(tmp_path / "w")
    elif kind == "pipe":
        os.mkfifo(folder / "w")
    else:
        (folder / "w").write_bytes(b"\0" * (size - 4 if kind == "short" else size))
    with pytest.raises(ComplaintsError, match=amiss):
        adopt(folder / "net.onnx", folder / "added.onnx", EQ6, observations)


def test_weights_of_more_than_64_mib_are_refused_unread(tmp_path):
    proto = model()
    proto.graph.initializer[0].dims[0] = 2**40
    onnx.external_data_helper.set_external_data(proto.graph.initializer[0], "w")
    proto.graph.initializer[0].ClearField("raw_data")
    (tmp_path / "net.onnx").write_bytes(proto.SerializeToString())
    with pytest.raises(ComplaintsError, match="take more than 64 MiB"):
        adopt(tmp_path / "net.onnx", tmp_path / "added.onnx", EQ6, observations)


def test_weights_of_a_negative_shape_are_refused_unread(tmp_path):
    proto = model()
    proto.graph.initializer[0].dims[0] = -1
    onnx.external_data_helper.set_external_data(proto.graph.initializer[0], "w")
    proto.graph.initializer[0].ClearField("raw_data")
    (tmp_path / "net.onnx").write_bytes(proto.SerializeToString())
    (tmp_path / "w").write_bytes(b"\0" * 100)
    with pytest.raises(ComplaintsError, match=r"the weights of w have the shape \[-1, 4\]"):
        adopt(tmp_path / "net.onnx", tmp_path / "added.onnx", EQ6, observations)


@pytest.mark.parametrize("shape", [(1, ROWS, COLS), (1, 2, ROWS, COLS)])
def test_a_size_that_contradicts_the_shape_is_refused(shape, tmp_path):
    onnx.save(model(shape), tmp_path / "net.onnx")
    answers = Answers("eq6", (COLS, ROWS), "newest", "zeros", acts="greedy")
    with pytest.raises(ComplaintsError, match=r"--size 7x6 contradicts .*; leave --size out"):
        adopt(tmp_path / "net.onnx", tmp_path / "added.onnx", answers, observations)


@pytest.mark.parametrize("content", [b"", b"not a model", b"PK\x03\x04"])
def test_what_is_no_model_is_refused_with_the_line_that_writes_one(content, tmp_path):
    (tmp_path / "net.onnx").write_bytes(content)
    with pytest.raises(ComplaintsError, match=r"expected an ONNX model.*torch\.onnx\.export"):
        adopt(tmp_path / "net.onnx", tmp_path / "added.onnx", EQ6, observations)


def test_a_file_whose_numbers_are_not_finite_on_real_boards_is_refused(tmp_path):
    proto = model()
    weights = np.full((ROWS * COLS, 4), 3e38, np.float32)
    proto.graph.initializer[0].CopyFrom(numpy_helper.from_array(weights, "w"))
    onnx.save(proto, tmp_path / "net.onnx")
    with pytest.raises(policies.PolicyFileError, match="expected finite numbers"):
        adopt(tmp_path / "net.onnx", tmp_path / "added.onnx", EQ6, observations)


def test_the_command_writes_a_file_that_plays(tmp_path, capsys):
    onnx.save(model(name="input"), tmp_path / "net.onnx")
    out = tmp_path / "mine.onnx"
    code, _, err = command(capsys, "policies", "add", str(tmp_path / "net.onnx"))
    assert (code, err.count("\n- ")) == (2, 2)
    options = ("--values", "eq6", "--acts", "greedy", "--out", str(out))
    code, text, _ = command(capsys, "policies", "add", str(tmp_path / "net.onnx"), *options)
    assert (code, "input float[1, 6, 7] holds eq. 6" in text) == (0, True)
    assert json.loads(command(capsys, "policies", "card", str(out))[1])["acts"] == "greedy"


def test_the_command_names_the_extra_that_it_needs(tmp_path, capsys, monkeypatch):
    onnx.save(model(), tmp_path / "net.onnx")
    for module in ("adopt", "adoption", "adopted_graph"):
        monkeypatch.delitem(sys.modules, f"marsexplorer.policies.files.{module}")
    monkeypatch.setitem(sys.modules, "onnx", None)
    code, _, err = command(capsys, "policies", "add", str(tmp_path / "net.onnx"))
    assert (code, "pip install 'humanplay[mars,onnx]'" in err) == (1, True)
