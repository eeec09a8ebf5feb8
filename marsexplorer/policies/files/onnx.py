"""Policies as ONNX files, run by onnxruntime.

Two kinds are understood.

**A policy of any making.** Input `observation`, float32 (the state matrix of eq. 6) or uint8 (codes), of shape [rows, cols],
[1, rows, cols] or [1, 1, rows, cols]; rows and cols may be left open. Output `logits` float32[4] or [1, 4]; output `value`,
one float32, if there is one. With a further input `action_mask`, bool[4] or [1, 4] (True where valid), invalid moves never win.
A batch dimension, where there is one, must take 1.

**A network over our features**, as `training.network` writes it: inputs `planes` and `moves`, outputs `logits` and, if there
is one, `value`. It plays with memory. A batch dimension that is left open must take any number of boards.

The card under "card" in the metadata may say how a policy "acts": "samples" draws each move from the probabilities, "greedy"
takes the best, "greedy with guard" has the loop guard besides, which networks over our features have unless the card says else.

A file is checked before it is run: at most 64 MiB, standard operators, no control flow, no functions, all weights inside. The
memory that it allocates on the way is bounded, and a model that asks for more is refused.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray
from onnx import numpy_helper

from marsexplorer.policies.base import INVALID_LOGIT, PolicyFileError
from marsexplorer.policies.files.card import FORMAT, refuse
from marsexplorer.policies.files.imported import Evaluate, ImportedPolicy

LARGEST = 64 << 20
"""Bytes of a file; a larger one is refused unread."""
MOST_MEMORY = 256 << 20
"""Bytes that all models of a process may take together while they run."""

PROBE = 21
"""Cells a side of the board that a model of open size is tried on."""


def read_model(path: Path) -> onnx.ModelProto:
    """Return a file's model, unchecked; PolicyFileError when it is too large, cannot be read or is none."""
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise refuse(path, f"a file of at most {LARGEST >> 20} MiB", f"{size >> 20} MiB")
        data = path.read_bytes()
    except OSError as error:
        came = f"{type(error).__name__}: {error.strerror}"
        raise refuse(path, "a file that can be read", came) from error
    try:
        return onnx.load_from_string(data)
    except Exception as error:  # protobuf raises kinds of its own
        raise refuse(path, "an ONNX model", "bytes that are none") from error


def card_in(model: onnx.ModelProto) -> dict[str, Any]:
    """Return the card in a model's metadata, empty when there is none."""
    metadata = {str(one.key): str(one.value) for one in model.metadata_props}
    try:
        card = json.loads(metadata.get("card", "{}"))
    except (ValueError, RecursionError):
        return {}
    return card if isinstance(card, dict) else {}


class OnnxModel:
    """A checked model, ready to run.

    card             see `card_in`
    inputs, outputs  name -> (type, shape), None for an open dimension
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        model = read_model(path)
        self.card, self._graph = card_in(model), model.graph
        if self.card.get("format", FORMAT) != FORMAT:
            raise self.refuse(f"the format {FORMAT}", repr(self.card["format"])[:60])
        self._check(model)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        _bound_memory()
        options.add_session_config_entry("session.use_env_allocators", "1")
        try:
            self._session = onnxruntime.InferenceSession(
                model.SerializeToString(), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            raise self.refuse("a model that onnxruntime can load", _first_line(error)) from error
        self.inputs, self.outputs = (
            {one.name: (one.type, _shape(one.shape)) for one in several}
            for several in (self._session.get_inputs(), self._session.get_outputs())
        )

    def refuse(self, expected: str, came: str) -> PolicyFileError:
        """Return the error for this file."""
        return refuse(self.path, expected, came)

    @property
    def is_own_network(self) -> bool:
        """Whether its inputs are those of our own network."""
        return set(self.inputs) == {"planes", "moves"}

    def acts(self, default: str, *others: str) -> str:
        """Return how the policy acts, by its card; PolicyFileError when it is none of the ways given."""
        found = self.card.get("acts", default)
        if found not in (default, *others):
            raise self.refuse(f'one of {", ".join((default, *others))} as "acts"', repr(found)[:60])
        return str(found)

    def weights(self) -> dict[str, NDArray[Any]]:
        """Return its weights by name."""
        return {str(one.name): numpy_helper.to_array(one) for one in self._graph.initializer}

    def run(self, inputs: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return the outputs by name."""
        return dict(zip(self.outputs, self._session.run(list(self.outputs), inputs), strict=True))

    def try_out(self, inputs: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return the outputs by name; PolicyFileError when the model does not run."""
        try:
            return self.run(inputs)
        except Exception as error:
            raise self.refuse("a model that runs", _first_line(error)) from error

    def _check(self, model: Any) -> None:
        """Refuse a model that is not made of standard operators and weights of its own."""
        external = onnx.TensorProto.EXTERNAL
        tensors = list(model.graph.initializer)
        if len(model.functions) or len(model.graph.sparse_initializer) or len(model.training_info):
            raise self.refuse("one plain graph", "functions, sparse weights or training of its own")
        for node in model.graph.node:
            if node.domain not in ("", "ai.onnx"):
                came = f"the custom operator {node.domain}.{node.op_type}"[:90]
                raise self.refuse("standard operators", came)
            for attribute in node.attribute:
                if attribute.HasField("g") or len(attribute.graphs):
                    came = f"the operator {node.op_type}"
                    raise self.refuse("a graph without control flow", came)
                tensors += [attribute.t] if attribute.HasField("t") else []
                tensors += list(attribute.tensors)
        for tensor in tensors:
            if tensor.data_location == external or len(tensor.external_data):
                came = f"{tensor.name or 'one'} in another file"[:90]
                raise self.refuse("all weights inside the file", came)
        try:
            onnx.checker.check_model(model)
        except Exception as error:
            raise self.refuse("a model that is whole", _first_line(error)) from error


def load_imported(model: OnnxModel) -> ImportedPolicy:
    """Return the policy of an ONNX model that takes observations, named after its file; PolicyFileError for anything else."""
    names = set(model.inputs)
    if not {"observation"} <= names <= {"observation", "action_mask"}:
        came = ", ".join(sorted(names))[:80] or "none"
        raise model.refuse("the input observation, and perhaps action_mask", came)
    kind, shape = model.inputs["observation"]
    if kind not in ("tensor(float)", "tensor(uint8)"):
        raise model.refuse("observation float32 or uint8", kind)
    if not 2 <= len(shape) <= 4 or any(side not in (1, None) for side in shape[:-2]):
        expected = "observation [rows, cols], [1, rows, cols] or [1, 1, rows, cols]"
        raise model.refuse(expected, f"{list(shape)}")
    rows, cols = shape[-2:]
    is_played = all(side is None or 5 <= side <= 1024 for side in (rows, cols))
    if (rows is None) != (cols is None) or not is_played:
        raise model.refuse("rows and cols of 5 to 1024, or both open", f"{list(shape)}")
    size = None if rows is None or cols is None else (rows, cols)
    raw = kind == "tensor(uint8)"
    nothing: NDArray[Any] = np.zeros(size or (PROBE, PROBE), np.uint8 if raw else np.float32)
    check_outputs(model, model.try_out(_inputs_of(model, nothing, np.ones(4, np.bool_))))
    samples = model.acts("greedy", "samples") == "samples"
    masked = "action_mask" in names
    how = (size, raw, masked, samples, "value" in model.outputs)
    return ImportedPolicy(model.path.stem, _evaluation(model), *how)


def _evaluation(model: OnnxModel) -> Evaluate:
    def evaluate(
        observation: NDArray[Any], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], float]:
        outputs = model.run(_inputs_of(model, observation, mask))
        value = float(outputs["value"].reshape(-1)[0]) if "value" in outputs else float("nan")
        return np.nan_to_num(outputs["logits"].reshape(4), nan=INVALID_LOGIT), value

    return evaluate


def _inputs_of(
    model: OnnxModel, observation: NDArray[Any], mask: NDArray[np.bool_]
) -> dict[str, NDArray[Any]]:
    """Return the inputs by name, shaped as the model wants them."""
    shape = model.inputs["observation"][1]
    whole: NDArray[Any] = observation.reshape((1,) * (len(shape) - 2) + observation.shape)
    if "action_mask" not in model.inputs:
        return {"observation": whole}
    ones = (1,) * (len(model.inputs["action_mask"][1]) - 1)
    return {"observation": whole, "action_mask": mask.reshape((*ones, 4))}


def check_outputs(model: OnnxModel, outputs: dict[str, NDArray[Any]], boards: int = 1) -> None:
    """Raise PolicyFileError when the outputs of a first run are not what a policy gives for so many boards."""
    if not {"logits"} <= set(outputs) <= {"logits", "value"}:
        raise model.refuse("the outputs logits, and perhaps value", ", ".join(sorted(outputs))[:80])
    for name, count in (("logits", 4 * boards), ("value", boards)):
        if name in outputs and (outputs[name].dtype != np.float32 or outputs[name].size != count):
            came = f"{outputs[name].dtype} {list(outputs[name].shape)}"
            raise model.refuse(f"{name} of {count} float32", came)
        if name in outputs and not np.isfinite(outputs[name]).all():
            raise model.refuse(f"finite numbers in {name}", "others")


def _shape(given: Any) -> tuple[int | None, ...]:
    return tuple(side if isinstance(side, int) else None for side in given)


@cache
def _bound_memory() -> None:
    """Give onnxruntime one store of MOST_MEMORY for the whole process; it can be given only once."""
    place = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    # 1: takes what is asked for, not the next power of two
    bounds = {"max_mem": MOST_MEMORY, "arena_extend_strategy": 1}
    onnxruntime.create_and_register_allocator(place, onnxruntime.OrtArenaCfg(bounds))


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:90]
