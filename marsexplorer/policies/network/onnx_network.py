"""Networks over our features as ONNX files: written from a policy file, and played by onnxruntime in the place of torch."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray

from marsexplorer.config import ROVER
from marsexplorer.files import replace_whole
from marsexplorer.policies.files.card import read_card, shipped
from marsexplorer.policies.files.onnx import OnnxModel, check_outputs
from marsexplorer.policies.network.features import ACTION_FEATURES, MOVE_NUMBERS, FeatureExtractor
from marsexplorer.policies.network.model import ACTS, NetworkPolicy, load_net


class OnnxNet:
    """A network in an ONNX file; `infer` is that of `model.Net`, one board after the other.

    has_value  whether it gives a value; else values are NaN
    """

    def __init__(self, model: OnnxModel) -> None:
        self._model, self._numbers = model, model.inputs["moves"][1][-1]
        self.has_value = "value" in model.outputs

    def rules_that_count(self, rows: int, cols: int) -> tuple[int, ...] | None:
        """Return no rule where it is given the numbers without prices alone, else None: all."""
        del rows, cols
        return () if self._numbers == ACTION_FEATURES else None

    def infer(
        self, planes: NDArray[np.uint8], moves: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (logits float32[num, 4], values float32[num]) of what `FeatureExtractor` gives."""
        outputs = [
            self._model.run(
                {"planes": planes[i : i + 1], "moves": moves[i : i + 1, :, : self._numbers]}
            )
            for i in range(len(planes))
        ]
        logits = np.concatenate([each["logits"].reshape(1, 4) for each in outputs])
        if not self.has_value:
            return logits, np.full(len(planes), np.nan, np.float32)
        return logits, np.concatenate([each["value"].reshape(1) for each in outputs])


def load_onnx_network(model: OnnxModel, sensor_radius: int) -> NetworkPolicy:
    """Return the policy of a model with the inputs planes and moves; PolicyFileError when they are not of our features."""
    is_unpriced = model.inputs["moves"][1][-1] == ACTION_FEATURES
    sample = sample_inputs(ACTION_FEATURES if is_unpriced else MOVE_NUMBERS)
    for name, array in sample.items():
        kind = f"tensor({'uint8' if array.dtype == np.uint8 else 'float'})"
        if model.inputs[name] not in ((kind, array.shape), (kind, (None, *array.shape[1:]))):
            came = f"{model.inputs[name][0]} {list(model.inputs[name][1])}"
            raise model.refuse(f"{name} {kind} {list(array.shape)}", came)
    check_outputs(model, model.try_out({name: array.copy() for name, array in sample.items()}))
    return NetworkPolicy(model.path.stem, OnnxNet(model), sensor_radius, model.acts(*ACTS))


def write_onnx(policy_file: str | Path, path: Path) -> None:
    """Write a policy of our own (name or .safetensors file) as an ONNX file, its card in the metadata; whole or not at all."""
    source = shipped().get(str(policy_file), Path(policy_file))
    net = load_net(source)
    samples = tuple(torch.from_numpy(each) for each in sample_inputs(MOVE_NUMBERS).values())
    names = {"input_names": ["planes", "moves"], "output_names": ["logits", "value"]}
    with replace_whole(path) as unfinished:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # the exporter speaks of its successor, which needs packages of its own
            torch.onnx.export(net, samples, str(unfinished), dynamo=False, **names)  # type: ignore[arg-type]
        model = onnx.load(str(unfinished))
        model.metadata_props.add(key="card", value=json.dumps(read_card(source)))
        onnx.save(model, str(unfinished))


def sample_inputs(numbers: int) -> dict[str, NDArray[np.uint8] | NDArray[np.float32]]:
    """Return the inputs for one board of the smallest size: planes uint8[1, ...] and moves float32[1, 4, numbers]."""
    codes = np.ones((1, 5, 5), np.uint8)
    codes[0, 0, 0] = ROVER
    planes, moves = FeatureExtractor(1, 5, 5, 1)(
        codes, np.zeros(1, np.int64), np.zeros((1, 25), np.uint8), np.ones(1, np.int64)
    )
    return {"planes": planes, "moves": moves[:, :, :numbers].copy()}
