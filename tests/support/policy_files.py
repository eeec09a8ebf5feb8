"""Policy files for the tests: good ones of every kind, and a corpus of broken and malicious ones."""

import base64
import io
import json
import os
import pickle
import warnings
import zipfile

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn


def runs(marker):
    """Return a pickle that creates the marker when something unpickles it."""

    class Evil:
        def __reduce__(self):
            return os.system, (f"touch {marker}",)

    return Evil()


def sb3_description(size=(6, 7), masked=True, dtype="float32", **kwargs):
    """Return the text that Stable-Baselines3 keeps about a model, as far as it matters."""
    module = (
        "sb3_contrib.common.maskable.policies" if masked else "stable_baselines3.common.policies"
    )
    space = {":type:": "<class 'gymnasium.spaces.box.Box'>", "dtype": dtype, "_shape": list(size)}
    return {
        "policy_class": {":type:": "<class 'abc.ABCMeta'>", "__module__": module},
        "policy_kwargs": {":type:": "<class 'dict'>", **kwargs},
        "observation_space": space,
    }


def flat_weights(size=(6, 7), width=16, seed=0):
    """Return the weights of MlpPolicy with two dense layers for each net, drawn from a seed."""
    torch.manual_seed(seed)
    inside, tensors = size[0] * size[1], {}
    for net in ("policy_net", "value_net"):
        for at, (a, b) in enumerate(((inside, width), (width, width))):
            layer = nn.Linear(a, b)
            tensors[f"mlp_extractor.{net}.{2 * at}.weight"] = layer.weight.data
            tensors[f"mlp_extractor.{net}.{2 * at}.bias"] = layer.bias.data
    for name, out in (("action_net", 4), ("value_net", 1)):
        layer = nn.Linear(width, out)
        tensors |= {f"{name}.weight": layer.weight.data, f"{name}.bias": layer.bias.data}
    return tensors


def terrain_weights(size=(6, 7), seed=0):
    """Return the weights with TerrainFeatures before the dense layers; named three times, as Stable-Baselines3 does."""
    torch.manual_seed(seed)
    pooled = 8 * -(-size[0] // 4) * -(-size[1] // 4)
    parts = {
        "cnn.0": nn.Conv2d(4, 5, 3, 2, 1),
        "cnn.2": nn.Conv2d(5, 8, 3, 2, 1),
        "linear.0": nn.Linear(pooled, 42),
    }
    tensors = flat_weights(size)
    for room in ("features_extractor", "pi_features_extractor", "vf_features_extractor"):
        for name, part in parts.items():
            tensors |= {
                f"{room}.{name}.weight": part.weight.data,
                f"{room}.{name}.bias": part.bias.data,
            }
    return tensors


def saved(thing):
    """Return what torch.save writes."""
    file = io.BytesIO()
    torch.save(thing, file)
    return file.getvalue()


def write_zip(path, members, compression=zipfile.ZIP_STORED):
    """Write members {name: bytes} to a zip."""
    with zipfile.ZipFile(path, "w", compression) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return path


def write_sb3(path, weights=None, about=None, **members):
    """Write a zip as `model.save` does."""
    weights = flat_weights() if weights is None else weights
    about = sb3_description() if about is None else about
    data = {
        "data": json.dumps(about),
        "policy.pth": weights if isinstance(weights, bytes) else saved(weights),
    }
    return write_zip(path, data | {"_stable_baselines3_version": "2.9.2"} | members)


def broken_sb3(kind, path, marker):
    """Write the zip that is broken as `kind` says."""
    evil, weights, about = runs(marker), flat_weights(), sb3_description()
    if kind == "a pickle that runs, in torch's zip":
        return write_sb3(path, saved({"action_net.weight": evil}))
    if kind == "a pickle that runs, in torch's old format":
        return write_sb3(path, pickle.dumps(evil))
    if kind == "a plain pickle":
        path.write_bytes(pickle.dumps(evil))
        return path
    if kind == "torch's own file":
        path.write_bytes(saved({"action_net.weight": evil}))
        return path
    if kind == "a name outside the archive":
        return write_sb3(path, **{f"../../../..{marker}": b"x"})
    if kind == "an absolute name":
        return write_sb3(path, **{str(marker): b"x"})
    if kind == "a bomb":
        members = {"data": json.dumps(about), "policy.pth": b"\0" * (65 << 20)}
        return write_zip(path, members, zipfile.ZIP_DEFLATED)
    if kind == "a bomb within":
        inner = io.BytesIO()
        write_zip(
            inner,
            {"archive/data.pkl": b"", "archive/data/0": b"\0" * (65 << 20)},
            zipfile.ZIP_DEFLATED,
        )
        return write_sb3(path, inner.getvalue())
    if kind == "a bomb of text":
        return write_zip(
            path, {"data": b" " * (20 << 20), "policy.pth": saved(weights)}, zipfile.ZIP_DEFLATED
        )
    if kind == "a thousand files":
        return write_sb3(path, **{f"more/{number}": b"" for number in range(1000)})
    if kind == "a name twice":
        write_sb3(path)
        with warnings.catch_warnings(), zipfile.ZipFile(path, "a") as file:
            warnings.simplefilter("ignore")
            file.writestr("policy.pth", saved({"x": evil}))
        return path
    if kind == "half a file":
        data = write_sb3(path).read_bytes()
        path.write_bytes(data[: len(data) // 2])
        return path
    if kind == "half a file of weights":
        return write_sb3(path, saved(weights)[:-500])
    if kind == "flipped bytes":
        data = bytearray(write_sb3(path).read_bytes())
        at = data.find(b"policy.pth") + 3000
        data[at : at + 200] = bytes(255 - byte for byte in data[at : at + 200])
        path.write_bytes(bytes(data))
        return path
    if kind == "an empty file":
        path.write_bytes(b"")
        return path
    if kind == "a file too large":
        with path.open("wb") as file:
            file.truncate(65 << 20)
        return path
    if kind == "text that is no JSON":
        return write_zip(path, {"data": b"{", "policy.pth": saved(weights)})
    if kind == "JSON without end":
        return write_zip(path, {"data": b"[" * 100_000, "policy.pth": saved(weights)})
    if kind == "no weights":
        return write_zip(path, {"data": json.dumps(about)})
    if kind == "a list of weights":
        return write_sb3(path, saved([torch.zeros(4)]))
    return _odd_sb3(kind, path)


def _odd_sb3(kind, path):
    """Whole zips whose model is none that we know."""
    weights, about = flat_weights(), sb3_description()
    if kind == "not a number":
        weights["action_net.bias"] = torch.full((4,), float("nan"))
    elif kind == "another type":
        weights["action_net.bias"] = torch.zeros(4, dtype=torch.float64)
    elif kind == "five moves":
        weights["action_net.weight"], weights["action_net.bias"] = (
            torch.zeros(5, 16),
            torch.zeros(5),
        )
    elif kind == "layers that do not fit":
        weights["mlp_extractor.policy_net.2.weight"] = torch.zeros(16, 15)
    elif kind == "layers as wide as a planet":
        weights["mlp_extractor.policy_net.0.weight"] = torch.zeros(10_000_000, 1)
        weights["mlp_extractor.policy_net.2.weight"] = torch.zeros(10_000_000, 1)
    elif kind == "a number for a layer":
        weights["action_net.weight"] = torch.tensor(1.0)
    elif kind == "one missing":
        del weights["mlp_extractor.value_net.0.bias"]
    elif kind == "one too many":
        weights["more"] = torch.zeros(2)
    elif kind == "a view of a terabyte":
        weights["action_net.weight"] = torch.zeros(1).expand(4, 10**12)
    elif kind == "a DQN":
        weights = {"q_net.q_net.0.weight": torch.zeros(4, 42), "q_net.q_net.0.bias": torch.zeros(4)}
    elif kind == "a recurrent net":
        weights["lstm_actor.weight_ih_l0"] = torch.zeros(4, 4)
    elif kind == "another extractor":
        weights = terrain_weights()
        weights["features_extractor.cnn.4.weight"] = torch.zeros(8, 8, 3, 3)
    elif kind == "an extractor by another name":
        weights, about = (
            terrain_weights(),
            sb3_description(features_extractor_class="<class 'mine.Extractor'>"),
        )
    elif kind == "another activation":
        about = sb3_description(activation_fn="<class 'mine.Bend'>")
    elif kind == "another board":
        about = sb3_description((7, 7))
    elif kind == "a board of one dimension":
        about = sb3_description((42,))
    elif kind == "a board of text":
        about = sb3_description(("6", "7"))
    else:
        raise AssertionError(kind)
    return write_sb3(path, weights, about)


BROKEN_SB3 = [
    "a pickle that runs, in torch's zip",
    "a pickle that runs, in torch's old format",
    "a plain pickle",
    "torch's own file",
    "a name outside the archive",
    "an absolute name",
    "a bomb",
    "a bomb within",
    "a bomb of text",
    "a thousand files",
    "a name twice",
    "half a file",
    "half a file of weights",
    "flipped bytes",
    "an empty file",
    "a file too large",
    "text that is no JSON",
    "JSON without end",
    "no weights",
    "a list of weights",
    "not a number",
    "another type",
    "five moves",
    "layers that do not fit",
    "layers as wide as a planet",
    "a number for a layer",
    "one missing",
    "one too many",
    "a view of a terabyte",
    "a DQN",
    "a recurrent net",
    "another extractor",
    "an extractor by another name",
    "another activation",
    "another board",
    "a board of one dimension",
    "a board of text",
]


def onnx_model(
    size=(6, 7),
    batch=1,
    masked=False,
    value=True,
    dtype=TensorProto.FLOAT,
    logits=4,
    bias=None,
    names=None,
):
    """Return a linear policy over the flattened board as an ONNX model."""
    rng = np.random.default_rng(0)
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


def write_onnx(path, **given):
    """Write a good model."""
    onnx.save(onnx_model(**given), str(path))
    return path


def broken_onnx(kind, path, marker):
    """Write the model that is broken as `kind` says."""
    model = onnx_model()
    graph = model.graph
    if kind == "a plain pickle":
        path.write_bytes(pickle.dumps(runs(marker)))
        return path
    if kind == "an empty file":
        path.write_bytes(b"")
        return path
    if kind == "half a file":
        data = model.SerializeToString()
        path.write_bytes(data[: len(data) // 2])
        return path
    if kind == "a file too large":
        with path.open("wb") as file:
            file.truncate(65 << 20)
        return path
    if kind == "weights in another file":
        marker.with_suffix(".weights").write_bytes(b"\0" * 10_000)
        onnx.external_data_helper.set_external_data(
            graph.initializer[0], str(marker.with_suffix(".weights"))
        )
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
    elif kind == "an unknown operator":
        graph.node[2].op_type = "Wish"
    elif kind == "a function":
        body = [helper.make_node("Relu", ["x"], ["y"])]
        model.functions.append(
            helper.make_function("ai.mine", "F", ["x"], ["y"], body, [helper.make_opsetid("", 17)])
        )
    elif kind == "a loop":
        body = helper.make_graph(
            [helper.make_node("Identity", ["go"], ["on"])],
            "body",
            [
                helper.make_tensor_value_info("i", TensorProto.INT64, []),
                helper.make_tensor_value_info("go", TensorProto.BOOL, []),
            ],
            [helper.make_tensor_value_info("on", TensorProto.BOOL, [])],
        )
        graph.initializer.append(numpy_helper.from_array(np.array(2**62, np.int64), "many"))
        graph.initializer.append(numpy_helper.from_array(np.array(True), "yes"))
        graph.node.append(helper.make_node("Loop", ["many", "yes"], [], body=body))
    elif kind == "a tensor as large as a planet":
        graph.initializer.append(
            numpy_helper.from_array(np.array([10**6, 10**6], np.int64), "huge")
        )
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
    else:
        model = _odd_onnx(kind)
    path.write_bytes(model.SerializeToString())
    return path


def _output(graph, name):
    """Make the largest number of a tensor an output, so that nobody leaves the tensor out."""
    graph.node.append(helper.make_node("ReduceMax", [name], ["peak"], keepdims=0))
    graph.output.append(helper.make_tensor_value_info("peak", TensorProto.FLOAT, []))


def _odd_onnx(kind):
    """Whole models that are no policy of ours."""
    if kind == "another input":
        return onnx_model(names=("state", "logits"))
    if kind == "another output":
        return onnx_model(names=("observation", "scores"))
    if kind == "five moves":
        return onnx_model(logits=5, value=False)
    if kind == "not a number":
        return onnx_model(bias=np.full(4, np.nan))
    if kind == "whole numbers go in":
        return onnx_model(dtype=TensorProto.INT64)
    if kind == "a batch of two":
        return onnx_model(size=(3, 7), batch=2)
    if kind == "our own inputs in other shapes":
        model = onnx_model(names=("planes", "logits"))
        model.graph.input.append(
            helper.make_tensor_value_info("moves", TensorProto.FLOAT, [1, 4, 3])
        )
        return model
    raise AssertionError(kind)


BROKEN_ONNX = [
    "a plain pickle",
    "an empty file",
    "half a file",
    "a file too large",
    "weights in another file",
    "weights of the system",
    "a constant in another file",
    "a custom operator",
    "an unknown operator",
    "a function",
    "a loop",
    "a tensor as large as a planet",
    "a product as large as a planet",
    "a tensor that grows with the board",
    "another input",
    "another output",
    "five moves",
    "not a number",
    "whole numbers go in",
    "a batch of two",
    "our own inputs in other shapes",
]


def hidden_pickle(marker):
    """Return the base64 of a pickle that runs, as Stable-Baselines3 keeps objects in its text."""
    return base64.b64encode(pickle.dumps(runs(marker))).decode()
