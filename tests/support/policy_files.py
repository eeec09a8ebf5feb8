"""Policy files for the tests: good ones, and broken and malicious ones."""

import json
import os
import pickle
import zipfile

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper

from marsexplorer import policies
from marsexplorer.policies.network.features import MOVE_NUMBERS, PICTURE_CELLS, PLANES
from marsexplorer.training.network import Net, save_network


def write_network(path):
    """Write a network of ours that has learnt nothing; return its path."""
    torch.manual_seed(1)
    save_network(Net(), path, {"summary": "Untrained.", "limits": "None known."})
    return path


def playing(net, folder):
    """Return a network as it plays, by way of a file in a folder."""
    save_network(net, folder / "net.onnx", {"summary": "Untrained."})
    return policies.load(folder / "net.onnx").net


def runs(marker):
    """Return a pickle that creates the marker when something unpickles it."""

    class Evil:
        def __reduce__(self):
            return os.system, (f"touch {marker}",)

    return Evil()


def onnx_model(
    size=(6, 7), batch=1, masked=False, value=True, dtype=TensorProto.FLOAT, logits=4, bias=None, names=None, seed=0
):  # fmt: skip
    """Return a linear policy over the flattened board, with weights from a seed."""
    rng = np.random.default_rng(seed)
    cells = size[0] * size[1]
    name, out = names or ("observation", "logits")
    nodes = [helper.make_node("Cast", [name], ["floats"], to=TensorProto.FLOAT)]
    nodes += [helper.make_node("Reshape", ["floats", "flat_shape"], ["flat"])]
    nodes += [helper.make_node("Gemm", ["flat", "w", "b"], [out])]
    bias = np.zeros(logits) if bias is None else bias
    held = {"w": rng.normal(size=(cells, logits)), "b": bias}
    initializers = [
        numpy_helper.from_array(array.astype(np.float32), key) for key, array in held.items()
    ]
    initializers += [numpy_helper.from_array(np.array([1, cells], np.int64), "flat_shape")]
    shape = [*([batch] if batch else []), *size]
    inputs = [helper.make_tensor_value_info(name, dtype, shape)]
    outputs = [helper.make_tensor_value_info(out, TensorProto.FLOAT, [1, logits])]
    if masked:
        inputs += [helper.make_tensor_value_info("action_mask", TensorProto.BOOL, [1, 4])]
    if value:
        nodes += [helper.make_node("ReduceMean", [out], ["value"], keepdims=0)]
        outputs += [helper.make_tensor_value_info("value", TensorProto.FLOAT, [])]
    graph = helper.make_graph(nodes, "policy", inputs, outputs, initializers)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def write_onnx(path, card=None, **given):
    """Write a good model, with a card in its metadata if one is given."""
    model = onnx_model(**given)
    if card is not None:
        model.metadata_props.add(key="card", value=json.dumps(card))
    onnx.save(model, str(path))
    return path


def broken_onnx(kind, path, marker):
    """Write the model that is broken as `kind` says."""
    model = onnx_model()
    graph = model.graph
    if kind in NO_MODELS:
        path.write_bytes(NO_MODELS[kind](marker))
        return path
    if kind == "a zip of pickles":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("data.pkl", pickle.dumps(runs(marker)))
        return path
    if kind == "a file too large":
        with path.open("wb") as file:
            file.truncate(65 << 20)
        return path
    if kind == "weights in another file":
        marker.with_suffix(".weights").write_bytes(b"\0" * 10_000)
        weights = str(marker.with_suffix(".weights"))
        onnx.external_data_helper.set_external_data(graph.initializer[0], weights)
        graph.initializer[0].ClearField("raw_data")
    elif kind == "weights of the system":
        onnx.external_data_helper.set_external_data(graph.initializer[0], "../../../../etc/passwd")
        graph.initializer[0].ClearField("raw_data")
    elif kind == "a constant in another file":
        tensor = numpy_helper.from_array(np.zeros(4, np.float32), "c")
        onnx.external_data_helper.set_external_data(tensor, "elsewhere")
        tensor.ClearField("raw_data")
        graph.node.append(helper.make_node("Constant", [], ["c"], value=tensor))
    elif kind == "a custom operator":
        graph.node[2].domain = "ai.mine"
        model.opset_import.append(helper.make_opsetid("ai.mine", 1))
    elif kind == "a custom operator in the second of two domains":
        model.opset_import.append(helper.make_opsetid("ai.mine", 1))
        path.write_bytes(model.SerializeToString() + _second_graph(b"\x3a\x00\x3a\x07ai.mine"))
        return path
    elif kind == "a loop in the second of two graphs":
        graph.node.add(op_type="If").attribute.add(name="then_branch").g.name = "then"
        loop = graph.node.pop().SerializeToString()
        path.write_bytes(model.SerializeToString() + _second_graph(loop))
        return path
    elif kind == "weights in another file, by a number too long":
        tensor = b"\x08\x04\x10\x01\x42\x01b\x70\x81\x80\x80\x80\x80\x80\x80\x80\x80\x01"
        graph.node.add(op_type="Constant", output=["c"]).attribute.add(name="value", type=4)
        node = graph.node.pop().SerializeToString() + _field(5, _field(5, tensor))
        path.write_bytes(model.SerializeToString() + _second_graph(node))
        return path
    elif kind == "sparse weights in another file":
        tensor = numpy_helper.from_array(np.zeros(4, np.float32), "c")
        onnx.external_data_helper.set_external_data(tensor, "elsewhere")
        tensor.ClearField("raw_data")
        sparse = onnx.SparseTensorProto(values=tensor, dims=[4])
        graph.node.append(helper.make_node("Constant", [], ["c"], sparse_value=sparse))
    elif kind == "fewer weights than their shape says":
        graph.initializer[0].raw_data = graph.initializer[0].raw_data[:-4]
    elif kind == "weights as large as a planet":
        graph.initializer[0].dims[0] = 2**50
    elif kind == "a field that the format does not have":
        path.write_bytes(model.SerializeToString() + _field(99, b"more"))
        return path
    elif kind == "a hundred thousand fields too many":
        path.write_bytes(model.SerializeToString() + 100_000 * b"\x08\x08")
        return path
    elif kind == "an unknown operator":
        graph.node[2].op_type = "Wish"
    elif kind == "a function":
        body = [helper.make_node("Relu", ["x"], ["y"])]
        opset = [helper.make_opsetid("", 17)]
        model.functions.append(helper.make_function("ai.mine", "F", ["x"], ["y"], body, opset))
    elif kind == "a loop":
        kinds = {"i": TensorProto.INT64, "go": TensorProto.BOOL, "on": TensorProto.BOOL}
        i, go, on = (
            helper.make_tensor_value_info(*name_and_kind, []) for name_and_kind in kinds.items()
        )
        nodes = [helper.make_node("Identity", ["go"], ["on"])]
        body = helper.make_graph(nodes, "body", [i, go], [on])
        graph.initializer.append(numpy_helper.from_array(np.array(2**62, np.int64), "many"))
        graph.initializer.append(numpy_helper.from_array(np.array(True), "yes"))
        graph.node.append(helper.make_node("Loop", ["many", "yes"], [], body=body))
    elif kind == "a tensor as large as a planet":
        huge = numpy_helper.from_array(np.array([10**6, 10**6], np.int64), "huge")
        graph.initializer.append(huge)
        graph.node.append(helper.make_node("ConstantOfShape", ["huge"], ["planet"]))
        _output(graph, "planet")
    elif kind == "a product as large as a planet":
        for name, shape in (("tall", (1_000_000, 1)), ("wide", (1, 1_000_000))):
            graph.initializer.append(numpy_helper.from_array(np.zeros(shape, np.float32), name))
        graph.node.append(helper.make_node("MatMul", ["tall", "wide"], ["planet"]))
        _output(graph, "planet")
    elif kind == "a tensor that grows with the board":
        graph.node.append(helper.make_node("ReduceSum", ["floats"], ["sum"], keepdims=0))
        graph.initializer.append(numpy_helper.from_array(np.array([1], np.int64), "once"))
        graph.initializer.append(numpy_helper.from_array(np.array(1e11, np.float32), "much"))
        graph.node.append(helper.make_node("Add", ["sum", "much"], ["most"]))
        graph.node.append(helper.make_node("Cast", ["most"], ["whole"], to=TensorProto.INT64))
        graph.node.append(helper.make_node("Reshape", ["whole", "once"], ["shape"]))
        graph.node.append(helper.make_node("ConstantOfShape", ["shape"], ["planet"]))
        _output(graph, "planet")
    elif kind == "a state as large as a planet":
        huge = helper.make_tensor_value_info("state_h", TensorProto.FLOAT, [2**20, 2**20])
        graph.input.append(huge)
        graph.node.append(helper.make_node("Identity", ["state_h"], ["next_state_h"]))
        graph.output.append(
            helper.make_tensor_value_info("next_state_h", TensorProto.FLOAT, [2**20, 2**20])
        )
    elif kind == "our own inputs in other shapes":
        model = onnx_model(names=("planes", "logits"))
        moves = helper.make_tensor_value_info("moves", TensorProto.FLOAT, [1, 4, 3])
        model.graph.input.append(moves)
    elif kind == "any number of our boards in name alone":
        model = _network_of_one_board()
    else:
        model = onnx_model(**ODD_MODELS[kind])
    path.write_bytes(model.SerializeToString())
    return path


def _field(number, content):
    """Return a field of bytes as protobuf writes it."""
    header = number << 3 | 2
    tag = bytes([header]) if header < 128 else bytes([header & 127 | 128, header >> 7])
    return tag + bytes([len(content)]) + content


def _second_graph(node):
    """Return another part of a model's graph, one node: protobuf joins parts."""
    return _field(7, _field(1, node))


def _output(graph, name):
    """Make a tensor's largest number an output, so that no optimiser drops it."""
    graph.node.append(helper.make_node("ReduceMax", [name], ["peak"], keepdims=0))
    graph.output.append(helper.make_tensor_value_info("peak", TensorProto.FLOAT, []))


def _network_of_one_board():
    """A network with an open number of boards that gives the logits of one."""
    nodes = [
        helper.make_node("ReduceSum", ["moves", "axes"], ["sums"]),
        helper.make_node("Reshape", ["sums", "shape"], ["logits"]),
    ]
    held = {"axes": [0, 2], "shape": [1, 4]}
    initializers = [
        numpy_helper.from_array(np.array(numbers), name) for name, numbers in held.items()
    ]
    planes = helper.make_tensor_value_info(
        "planes", TensorProto.UINT8, [None, PLANES, PICTURE_CELLS]
    )
    moves = helper.make_tensor_value_info("moves", TensorProto.FLOAT, [None, 4, MOVE_NUMBERS])
    logits = helper.make_tensor_value_info("logits", TensorProto.FLOAT, [1, 4])
    graph = helper.make_graph(nodes, "policy", [planes, moves], [logits], initializers)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


NO_MODELS = {
    "a plain pickle": lambda marker: pickle.dumps(runs(marker)),
    "a text": lambda marker: b"not a policy at all",
    "an empty file": lambda marker: b"",
    "half a file": lambda marker: onnx_model().SerializeToString()[:400],
}
"""What it is called -> the bytes of a file that holds no model."""
ODD_MODELS = {
    "another input": {"names": ("state", "logits")},
    "another output": {"names": ("observation", "scores")},
    "five moves": {"logits": 5, "value": False},
    "not a number": {"bias": np.full(4, np.nan)},
    "whole numbers go in": {"dtype": TensorProto.INT64},
    "a batch of two": {"size": (3, 7), "batch": 2},
}
"""What it is called -> the arguments of `onnx_model` for a whole model that is no policy of ours."""
BROKEN_ONNX = [
    *NO_MODELS,
    *ODD_MODELS,
    "a zip of pickles",
    "a file too large",
    "weights in another file",
    "weights of the system",
    "a constant in another file",
    "a custom operator",
    "a custom operator in the second of two domains",
    "a loop in the second of two graphs",
    "weights in another file, by a number too long",
    "sparse weights in another file",
    "fewer weights than their shape says",
    "weights as large as a planet",
    "a field that the format does not have",
    "a hundred thousand fields too many",
    "an unknown operator",
    "a function",
    "a loop",
    "a tensor as large as a planet",
    "a product as large as a planet",
    "a tensor that grows with the board",
    "a state as large as a planet",
    "our own inputs in other shapes",
    "any number of our boards in name alone",
]
