"""Policies as ONNX files, run by onnxruntime; and our own networks written as such.

Two kinds are understood; a batch dimension, where there is one, must take 1.

**A policy of any making.** Input `observation`, float32 (the state matrix of eq. 6) or uint8 (codes), of shape [rows, cols],
[1, rows, cols] or [1, 1, rows, cols]; rows and cols may be left open. Output `logits` float32[4] or [1, 4]; output `value`,
one float32, if there is one. With a further input `action_mask`, bool[4] or [1, 4] (True where valid), invalid moves never win.

**Our own network**, as `write_onnx` writes it: inputs `planes` and `moves` (perception.py), outputs `logits` and `value`, the
card under "card" in the metadata. It plays with memory and guard, as the network it was made from.

A file is checked before it is run: at most 64 MiB, standard operators, no control flow, no functions, all weights inside. What
it allocates on the way is bounded, so a model that asks for a planet of memory is refused instead of getting it. The packages
onnx and onnxruntime are asked for by name when they are missing.
"""

from __future__ import annotations

import json
import warnings
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from marsexplorer.config import ROVER
from marsexplorer.files import replace_whole
from marsexplorer.policies.base import Policy, PolicyFileError
from marsexplorer.policies.files.archive import read_file
from marsexplorer.policies.files.card import refuse
from marsexplorer.policies.files.imported import Decide, ImportedPolicy

WAY_OUT = "give an ONNX model with the inputs and outputs that docs/policies.md lists"
MOST_MEMORY = 256 << 20
"""Bytes that all models of a process may take together while they run."""

PROBE = 21
"""Cells a side of the board that a model of open size is tried on."""


class Session:
    """A checked model, ready to run. `inputs` and `outputs` map names to (type, shape), None for an open dimension."""

    def __init__(self, path: Path) -> None:
        onnx, runtime = _package("onnx"), _package("onnxruntime")
        self.path = path
        data = read_file(path, WAY_OUT)
        try:
            model = onnx.load_from_string(data)
        except Exception as error:  # protobuf raises kinds of its own
            raise self.refuse("an ONNX model", "bytes that are none") from error
        self.metadata = {str(one.key): str(one.value) for one in model.metadata_props}
        self._check(onnx, model)
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        _bound_memory(runtime)
        options.add_session_config_entry("session.use_env_allocators", "1")
        try:
            self._session = runtime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:
            raise self.refuse("a model that onnxruntime can load", _first_line(error)) from error
        self.inputs = {one.name: (one.type, _shape(one.shape)) for one in self._session.get_inputs()}
        self.outputs = {one.name: (one.type, _shape(one.shape)) for one in self._session.get_outputs()}

    def refuse(self, expected: str, came: str) -> PolicyFileError:
        """Return the error for this file."""
        return refuse(self.path, expected, came, WAY_OUT)

    def card(self) -> dict[str, Any]:
        """Return the card in the metadata, empty when there is none."""
        try:
            card = json.loads(self.metadata.get("card", "{}"))
        except (ValueError, RecursionError):
            return {}
        return card if isinstance(card, dict) else {}

    def run(self, given: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return the outputs by name."""
        return dict(zip(self.outputs, self._session.run(list(self.outputs), given), strict=True))

    def try_out(self, given: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return the outputs by name; PolicyFileError when the model does not run."""
        try:
            return self.run(given)
        except Exception as error:
            raise self.refuse("a model that runs", _first_line(error)) from error

    def _check(self, onnx: Any, model: Any) -> None:
        """Return when the model is made of standard operators and weights of its own."""
        external = onnx.TensorProto.EXTERNAL
        tensors = list(model.graph.initializer)
        if len(model.functions) or len(model.graph.sparse_initializer) or len(model.training_info):
            raise self.refuse("one plain graph", "functions, sparse weights or training of its own")
        for node in model.graph.node:
            if node.domain not in ("", "ai.onnx"):
                raise self.refuse("standard operators", f"the custom operator {node.domain}.{node.op_type}"[:90])
            for attribute in node.attribute:
                if attribute.HasField("g") or len(attribute.graphs):
                    raise self.refuse("a graph without control flow", f"the operator {node.op_type}")
                tensors += [attribute.t] if attribute.HasField("t") else []
                tensors += list(attribute.tensors)
        for tensor in tensors:
            if tensor.data_location == external or len(tensor.external_data):
                raise self.refuse("all weights inside the file", f"{tensor.name or 'one'} in another file"[:90])
        try:
            onnx.checker.check_model(model)
        except Exception as error:
            raise self.refuse("a model that is whole", _first_line(error)) from error


def load_onnx(path: Path, sensor_radius: int) -> Policy:
    """Return the policy in an ONNX file, named after the file; PolicyFileError for anything else."""
    session = Session(path)
    names = set(session.inputs)
    if names == {"planes", "moves"}:
        return _own(session, sensor_radius)
    if not {"observation"} <= names <= {"observation", "action_mask"}:
        raise session.refuse("the input observation, and perhaps action_mask", ", ".join(sorted(names))[:80] or "none")
    kind, shape = session.inputs["observation"]
    if kind not in ("tensor(float)", "tensor(uint8)"):
        raise session.refuse("observation float32 or uint8", kind)
    if not 2 <= len(shape) <= 4 or any(side not in (1, None) for side in shape[:-2]):
        raise session.refuse("observation [rows, cols], [1, rows, cols] or [1, 1, rows, cols]", f"{list(shape)}")
    rows, cols = shape[-2:]
    if (rows is None) != (cols is None) or not all(side is None or 5 <= side <= 1024 for side in (rows, cols)):
        raise session.refuse("rows and cols of 5 to 1024, or both open", f"{list(shape)}")
    size = None if rows is None or cols is None else (rows, cols)
    decide = _decide(session)
    raw = kind == "tensor(uint8)"
    nothing: NDArray[Any] = np.zeros(size or (PROBE, PROBE), np.uint8 if raw else np.float32)
    _check_outputs(session, session.try_out(_given(session, nothing, np.ones(4, np.bool_))))
    return ImportedPolicy(path.stem, decide, size, raw, "action_mask" in names)


def describe_onnx(path: Path) -> str:
    """Return the sentence in a model's card, or one for models without."""
    return str(Session(path).card().get("summary", "A policy from an ONNX file."))[:300]


def write_onnx(policy_file: str | Path, path: Path) -> None:
    """Write a policy of our own (name or .safetensors file) as an ONNX file, its card in the metadata; whole or not at all."""
    onnx = _package("onnx")
    from marsexplorer import policies
    from marsexplorer.policies.files.card import read_card
    from marsexplorer.policies.network.model import load_net

    source = policies.file_of(str(policy_file))
    net = load_net(source)
    samples = tuple(torch.from_numpy(one) for one in _perceived().values())
    names = {"input_names": ["planes", "moves"], "output_names": ["logits", "value"]}
    with replace_whole(path) as unfinished:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the exporter speaks of its successor, which needs packages of its own
            torch.onnx.export(net, samples, str(unfinished), dynamo=False, **names)  # type: ignore[arg-type]
        model = onnx.load(str(unfinished))
        model.metadata_props.add(key="card", value=json.dumps(read_card(source)))
        onnx.save(model, str(unfinished))


def _perceived() -> dict[str, NDArray[Any]]:
    """Return what our own network is shown of the smallest board: planes uint8[1, ...] and moves float32[1, 4, ...]."""
    from marsexplorer.policies.network.features import Perception

    codes = np.ones((1, 5, 5), np.uint8)
    codes[0, 0, 0] = ROVER
    planes, moves = Perception(1, 5, 5, 1)(codes, np.zeros(1, np.int64), np.zeros((1, 25), np.uint8), np.ones(1, np.int64))
    return {"planes": planes.copy(), "moves": moves.copy()}


def _own(session: Session, sensor_radius: int) -> Policy:
    """Return our own network, run by onnxruntime in the place of torch."""
    from marsexplorer.policies.network.model import FORMAT, NetworkPolicy

    sample = _perceived()
    for name, array in sample.items():
        kind = f"tensor({'uint8' if array.dtype == np.uint8 else 'float'})"
        if session.inputs[name] not in ((kind, array.shape), (kind, (None, *array.shape[1:]))):
            raise session.refuse(
                f"{name} {kind} {list(array.shape)}", f"{session.inputs[name][0]} {list(session.inputs[name][1])}"
            )
    if session.card().get("format") != FORMAT:
        raise session.refuse(f"the format {FORMAT} in its card", repr(session.card().get("format"))[:60])
    _check_outputs(session, session.try_out(sample))

    return NetworkPolicy(session.path.stem, OwnNet(session), sensor_radius)  # type: ignore[arg-type]  # it decides as a Net does


class OwnNet:
    """Our own network in an ONNX file; `decide` is that of network.Net, one board after the other."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def decide(self, planes: NDArray[np.uint8], moves: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (logits float32[num, 4], values float32[num]) of stacks of what `Perception` shows."""
        found = [self._session.run({"planes": planes[i : i + 1], "moves": moves[i : i + 1]}) for i in range(len(planes))]
        return (
            np.concatenate([one["logits"].reshape(1, 4) for one in found]),
            np.concatenate([one["value"].reshape(1) for one in found]),
        )


def _decide(session: Session) -> Decide:
    def decide(observation: NDArray[Any], valid: NDArray[np.bool_]) -> tuple[NDArray[np.float32], float]:
        found = session.run(_given(session, observation, valid))
        value = float(found["value"].reshape(-1)[0]) if "value" in found else float("nan")
        return np.nan_to_num(found["logits"].reshape(4), nan=-1e9), value

    return decide


def _given(session: Session, observation: NDArray[Any], valid: NDArray[np.bool_]) -> dict[str, NDArray[Any]]:
    """Return what goes in, shaped as the model wants it."""
    shape = session.inputs["observation"][1]
    given: dict[str, NDArray[Any]] = {"observation": observation.reshape((1,) * (len(shape) - 2) + observation.shape)}
    if "action_mask" in session.inputs:
        given["action_mask"] = valid.reshape((1,) * (len(session.inputs["action_mask"][1]) - 1) + (4,))
    return given


def _check_outputs(session: Session, found: dict[str, NDArray[Any]]) -> None:
    """Return when the outputs of a first run are what a policy says."""
    if not {"logits"} <= set(found) <= {"logits", "value"}:
        raise session.refuse("the outputs logits, and perhaps value", ", ".join(sorted(found))[:80])
    for name, count in (("logits", 4), ("value", 1)):
        if name in found and (found[name].dtype != np.float32 or found[name].size != count):
            raise session.refuse(f"{name} of {count} float32", f"{found[name].dtype} {list(found[name].shape)}")
        if name in found and not np.isfinite(found[name]).all():
            raise session.refuse(f"finite numbers in {name}", "others")


def _shape(given: Any) -> tuple[int | None, ...]:
    return tuple(side if isinstance(side, int) else None for side in given)


@cache
def _bound_memory(runtime: Any) -> None:
    """Give onnxruntime one store of MOST_MEMORY for the whole process; it can be given only once."""
    place = runtime.OrtMemoryInfo("Cpu", runtime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, runtime.OrtMemType.DEFAULT)
    bounds = {"max_mem": MOST_MEMORY, "arena_extend_strategy": 1}  # 1: takes what is asked for, not the next power of two
    runtime.create_and_register_allocator(place, runtime.OrtArenaCfg(bounds))


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:90]


def _package(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise PolicyFileError(
            f'ONNX files need the package {name}, which is not installed; pip install "marsexplorer-playground[onnx]"'
        ) from error
