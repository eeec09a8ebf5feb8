"""The trained network, written as the ONNX model that plays, and read from it.

The model's metadata holds the card. Weights have the same names in the file as here, so `load_net`
finds them.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from marsexplorer.files import replace_whole
from marsexplorer.policies.base import INVALID_LOGIT
from marsexplorer.policies.files.card import FORMAT
from marsexplorer.policies.files.onnx import OnnxModel
from marsexplorer.policies.network.features import MOVE_NUMBERS, PICTURE_CELLS, PLANES, SCALES
from marsexplorer.policies.network.policy import sample_inputs
from marsexplorer.training.prior import prior_logits, prior_weights


class Net(nn.Module):
    """Score each move by one head, from a trunk over the pictures and its features.

    forward(planes uint8[b, PLANES, PICTURE_CELLS], moves float32[b, 4, MOVE_NUMBERS])
        -> logits float32[b, 4] (INVALID_LOGIT for invalid moves), value float32[b]

    prior  float32[SIDES, MOVE_NUMBERS], the weights that add the logits of priced rules, see
           `prior`
    """

    def __init__(self, wide: int = 384, hidden: int = 128) -> None:
        super().__init__()
        first = nn.Linear(PLANES * PICTURE_CELLS, wide)
        self.trunk = nn.Sequential(first, nn.ReLU(), nn.Linear(wide, hidden), nn.ReLU())
        first = nn.Linear(hidden + MOVE_NUMBERS + 4, 64)
        self.policy_head = nn.Sequential(first, nn.ReLU(), nn.Linear(64, 1))
        first = nn.Linear(hidden + 4 * MOVE_NUMBERS, 64)
        self.value_head = nn.Sequential(first, nn.ReLU(), nn.Linear(64, 1))
        initialize_orthogonal(self)
        nn.init.orthogonal_(self.policy_head[-1].weight, 0.01)  # type: ignore[arg-type]
        self.prior = nn.Parameter(prior_weights())

    def forward(self, planes: Tensor, moves: Tensor) -> tuple[Tensor, Tensor]:
        hidden = self.trunk(planes.flatten(1).to(moves.dtype) * (1 / 255))
        batch = planes.shape[0]  # unlike len(), not fixed by the export
        move_numbers = torch.eye(4, dtype=moves.dtype, device=moves.device).expand(batch, 4, 4)
        by_move = torch.cat([hidden[:, None].expand(batch, 4, -1), moves, move_numbers], dim=2)
        logits = self.policy_head(by_move).squeeze(2).float()
        logits = logits + prior_logits(moves, self.prior)
        value = self.value_head(torch.cat([hidden, moves.flatten(1)], dim=1)).squeeze(1).float()
        return logits.masked_fill(moves[:, :, 0] < 0.5, INVALID_LOGIT), value * 5


def _transposed_cells() -> Tensor:
    parts, start = [], 0
    for side, _ in SCALES:
        parts.append(torch.arange(start, start + side * side).view(side, side).T.flatten())
        start += side * side
    return torch.cat(parts)


TRANSPOSED = _transposed_cells()
"""Where each cell of the planes lies once rows and columns are exchanged: int64[PICTURE_CELLS]."""


def mixed_precision(device: str = "cpu") -> torch.autocast:
    """A block that computes networks in bfloat16 if the processor does so natively.

    Elsewhere float32 is no slower.
    """
    capabilities = getattr(torch.cpu, "get_capabilities", dict)  # torch 2.4 does not have it
    able: Mapping[str, Any] = capabilities()
    has_it = device == "cpu" and any(able.get(flag) for flag in ("amx_bf16", "avx512_bf16", "bf16"))
    return torch.autocast(device, torch.bfloat16, enabled=has_it)


def initialize_orthogonal(net: nn.Module) -> None:
    """Draw orthogonal weights with gain sqrt 2 and zero biases (Saxe et al. 2014)."""
    for module in net.modules():
        if isinstance(module, (nn.Linear, nn.Conv2d)):
            nn.init.orthogonal_(module.weight, 2**0.5)
            assert module.bias is not None
            nn.init.zeros_(module.bias)


def save_network(net: Net, path: Path, card: Mapping[str, Any]) -> None:
    """Write a network as a policy file for any number of boards, with its card.

    The file is written whole or not at all.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fields = {name: content for name, content in card.items() if name != "format"}
    samples, outputs = sample_inputs(MOVE_NUMBERS), ["logits", "value"]
    # The exporter makes equal weights one unless they are trained.
    copy = deepcopy(net).cpu().train()
    export_onnx(copy, path, samples, outputs, {"format": FORMAT, **fields}, any_number=True)


def export_onnx(
    net: nn.Module,
    path: Path,
    samples: Mapping[str, NDArray[Any]],
    outputs: Sequence[str],
    card: Mapping[str, Any],
    any_number: bool = False,
) -> None:
    """Write a module as an ONNX model with its card, whole or not at all.

    Args:
        net: The module, in training or not.
        path: Of the file.
        samples: An input of each name, for one board.
        outputs: Their names.
        card: For the model's metadata.
        any_number: Whether the first dimension of all inputs and outputs is left open.
    """
    arrays = tuple(torch.from_numpy(sample) for sample in samples.values())
    open_axes = {name: {0: "boards"} for name in (*samples, *outputs)} if any_number else None
    with replace_whole(path) as unfinished:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the exporter speaks of its successor
            torch.onnx.export(
                net,
                arrays,
                str(unfinished),
                training=torch.onnx.TrainingMode.PRESERVE,
                dynamo=False,  # the successor needs packages of its own
                # folding would rename weights; onnxruntime folds them as it loads
                do_constant_folding=False,
                input_names=list(samples),
                output_names=list(outputs),
                dynamic_axes=open_axes,
            )
        model = onnx.load(str(unfinished))
        model.metadata_props.add(key="card", value=json.dumps(card, indent=1))
        onnx.save(model, str(unfinished))


def load_net(path: Path) -> Net:
    """The network in a policy file, to be trained on.

    PolicyFileError if its weights are not those of `Net`.
    """
    model, net = OnnxModel(path), Net()
    weights = model.weights()
    expected = {name: tuple(tensor.shape) for name, tensor in net.state_dict().items()}
    if sorted(weights) != sorted(expected):
        raise model.refuse(f"the {len(expected)} weights of our network", f"{len(weights)} others")
    for name, array in weights.items():
        if array.shape != expected[name] or array.dtype != np.float32:
            came = f"{array.dtype} {list(array.shape)}"
            raise model.refuse(f"{name} float32{list(expected[name])}", came)
        if not np.isfinite(array).all():
            raise model.refuse(f"finite numbers in {name}", "others")
    net.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in weights.items()})
    return net.eval()
