"""Policies as ONNX files, run by onnxruntime.

Two kinds are understood.

**A policy of any making.** Input `observation`, float32 (the state matrix of eq. 6) or uint8
(codes), of shape [rows, cols], [1, rows, cols] or [1, 1, rows, cols]; rows and cols may be left
open. Output `logits` float32[4] or [1, 4]; output `value`, one float32, if there is one. With a
further input `action_mask`, bool[4] or [1, 4] (True where valid), invalid moves never win. A batch
dimension, where there is one, must take 1. An input `state_NAME`, float32 of a fixed shape, is
zeros at an episode's start and then the output `next_state_NAME` of the move before. An input
`start`, float32[1], is 1 at the start, 0 after it.

**A network over our features**, as `training.network` writes it: inputs `planes` and `moves`,
outputs `logits` and, if there is one, `value`. It plays with memory. A batch dimension that is left
open must take any number of boards.

The card under "card" in the metadata may say how a policy "acts": "samples" draws each move from
the probabilities, "greedy" takes the best, "greedy with guard" has the loop guard besides, which
networks over our features have unless the card says else.

A file is checked before it is run: at most 64 MiB, standard operators, no control flow, no
functions, all weights inside. The memory that it allocates on the way is bounded, and a model that
asks for more is refused.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from marsexplorer.policies.base import INVALID_LOGIT, PolicyFileError
from marsexplorer.policies.files.card import FORMAT, card_in
from marsexplorer.policies.files.imported import ImportedPolicy
from marsexplorer.policies.files.model import Model, refuse

MOST_MEMORY = 256 << 20
"""Bytes that all models of a process may take together while they run."""

MOST_STATES = 1 << 20
"""Numbers that all states of a model hold together at most."""

PROBE = 21
"""Cells a side of the board that a model of open size is tried on."""


class OnnxModel:
    """A checked model, ready to run.

    card             that in its metadata, empty when there is none
    inputs, outputs  name -> (type, shape), None for an open dimension
    """

    def __init__(self, path: Path) -> None:
        self.path, self._file = path, Model(path)
        self.card = card_in(self._file)
        if self.card.get("format", FORMAT) != FORMAT:
            raise self.refuse(f"the format {FORMAT}", repr(self.card["format"])[:60])
        self._file.check()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        _bound_memory()
        options.add_session_config_entry("session.use_env_allocators", "1")
        try:
            self._session = onnxruntime.InferenceSession(
                self._file.data,
                options,
                providers=["CPUExecutionProvider"],
                enable_fallback=0,  # else it prints, and tries the same once more
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
        """How the policy acts, by its card; PolicyFileError if it is none of these ways."""
        way = self.card.get("acts", default)
        if way not in (default, *others):
            raise self.refuse(f'one of {", ".join((default, *others))} as "acts"', repr(way)[:60])
        return str(way)

    def weights(self) -> dict[str, NDArray[Any]]:
        """Return its weights by name."""
        return self._file.weights()

    def run(self, inputs: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return the outputs by name."""
        return dict(zip(self.outputs, self._session.run(list(self.outputs), inputs), strict=True))

    def try_out(self, inputs: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return the outputs by name; PolicyFileError when the model does not run."""
        try:
            return self.run(inputs)
        except Exception as error:
            raise self.refuse("a model that runs", _first_line(error)) from error


def load_imported(model: OnnxModel) -> ImportedPolicy:
    """The policy of an ONNX model that takes observations, named after its file.

    Raises PolicyFileError for any other file.
    """
    states = {name for name in model.inputs if name.startswith("state_")}
    names = set(model.inputs) - states
    if not {"observation"} <= names <= {"observation", "action_mask", "start"}:
        came = ", ".join(sorted(names))[:80] or "none"
        raise model.refuse("the input observation, and perhaps action_mask", came)
    for name in states:
        if model.inputs[name][0] != "tensor(float)" or None in model.inputs[name][1]:
            raise model.refuse(f"{name} float32 of a fixed shape", str(model.inputs[name])[:60])
    numbers = sum(math.prod(side or 1 for side in model.inputs[name][1]) for name in states)
    if numbers > MOST_STATES:
        raise model.refuse(f"at most {MOST_STATES:,} numbers in states", f"{numbers:,}")
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
    evaluation = OnnxEvaluation(model)
    first = model.try_out(evaluation.inputs_of(nothing, np.ones(4, np.bool_)))
    check_outputs(model, first, states=states)
    samples = model.acts("greedy", "samples") == "samples"
    masked = "action_mask" in names
    how = (size, raw, masked, samples, "value" in model.outputs)
    return ImportedPolicy(model.path.stem, evaluation, *how)


class OnnxEvaluation:
    """A model that takes observations (`imported.Evaluation`)."""

    def __init__(self, model: OnnxModel) -> None:
        self._model = model
        self.begin()

    def begin(self) -> None:
        """Start an episode: forget the states."""
        shapes = {  # without an open side, which `load_imported` refuses
            name: [side for side in shape if side is not None]
            for name, (_, shape) in self._model.inputs.items()
            if name.startswith("state_")
        }
        self._states = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
        self._is_start = True

    def evaluate(
        self, observation: NDArray[Any], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], float]:
        """The logits and the value for an observation and a mask; the states are kept."""
        outputs = self.run(observation, mask)
        value = float(outputs["value"].reshape(-1)[0]) if "value" in outputs else float("nan")
        return np.nan_to_num(outputs["logits"].reshape(4), nan=INVALID_LOGIT), value

    def run(self, observation: NDArray[Any], mask: NDArray[np.bool_]) -> dict[str, NDArray[Any]]:
        """The model's own outputs by name; the states are carried on."""
        outputs = self._model.run(self.inputs_of(observation, mask))
        self._states = {name: outputs[f"next_{name}"] for name in self._states}
        self._is_start = False
        return outputs

    def inputs_of(
        self, observation: NDArray[Any], mask: NDArray[np.bool_]
    ) -> dict[str, NDArray[Any]]:
        """The inputs by name, shaped as the model wants them."""
        inputs = self._model.inputs
        shape = inputs["observation"][1]
        whole = observation.reshape((1,) * (len(shape) - 2) + observation.shape)
        feed: dict[str, NDArray[Any]] = {"observation": whole, **self._states}
        if "action_mask" in inputs:
            feed["action_mask"] = mask.reshape((*(1,) * (len(inputs["action_mask"][1]) - 1), 4))
        if "start" in inputs:
            feed["start"] = np.array([self._is_start], np.float32)
        return feed


def check_outputs(
    model: OnnxModel,
    outputs: dict[str, NDArray[Any]],
    boards: int = 1,
    states: Collection[str] = (),
) -> None:
    """Raise PolicyFileError if the outputs of a first run are not those of a policy."""
    following = {f"next_{name}" for name in states}
    if not {"logits"} | following <= set(outputs) <= {"logits", "value"} | following:
        raise model.refuse("the outputs logits, and perhaps value", ", ".join(sorted(outputs))[:80])
    for name in states:
        after = outputs[f"next_{name}"]
        if after.dtype != np.float32 or after.shape != model.inputs[name][1]:
            raise model.refuse(f"next_{name} as {name} is", f"{after.dtype} {list(after.shape)}")
    for name, count in (("logits", 4 * boards), ("value", boards)):
        if name in outputs and (outputs[name].dtype != np.float32 or outputs[name].size != count):
            came = f"{outputs[name].dtype} {list(outputs[name].shape)}"
            raise model.refuse(f"{name} of {count} float32", came)
        if name in outputs and not np.isfinite(outputs[name]).all():
            raise model.refuse(f"finite numbers in {name}", "others")


def _shape(shape: Any) -> tuple[int | None, ...]:
    return tuple(side if isinstance(side, int) else None for side in shape)


@cache
def _bound_memory() -> None:
    """Give onnxruntime one store of MOST_MEMORY for the process; it takes only one."""
    place = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    # 1: takes what is asked for, not the next power of two
    bounds = {"max_mem": MOST_MEMORY, "arena_extend_strategy": 1}
    onnxruntime.create_and_register_allocator(place, onnxruntime.OrtArenaCfg(bounds))


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:90]
