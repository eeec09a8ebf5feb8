"""Policies of Stable-Baselines3 and sb3-contrib, from the zip that `model.save` writes: weights only, never unpickled.

Understood are actor-critic policies (PPO, A2C, TRPO, MaskablePPO) with `MlpPolicy` on the flattened state matrix, or with the
`TerrainFeatures` of examples/sb3_maskable_ppo.py before it. Layer sizes are read off the weights; the activation, the size of
the board and whether invalid moves are masked from the plain text in the zip. Everything else is refused by name.
"""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from marsexplorer.policies.base import PolicyFileError
from marsexplorer.policies.files.archive import Archive, read_file
from marsexplorer.policies.files.imported import ImportedPolicy
from marsexplorer.policies.files.weights import read_torch_tensors

SB3_ADVICE = (
    "save a PPO, A2C, TRPO or MaskablePPO with MlpPolicy, or with the TerrainFeatures of examples/sb3_maskable_ppo.py, "
    "and give that zip"
)
ACTIVATIONS = {
    "Tanh": nn.Tanh,
    "ReLU": nn.ReLU,
    "ELU": nn.ELU,
    "LeakyReLU": nn.LeakyReLU,
    "GELU": nn.GELU,
    "SiLU": nn.SiLU,
}
LARGEST_TEXT = 8 << 20
OTHERS = {
    "q_net": "a DQN",
    "quantile_net": "a QR-DQN",
    "lstm_actor": "a RecurrentPPO",
    "actor": "an off-policy actor",
    "log_std": "a policy for continuous actions",
}
"""First part of a tensor's name -> what it belongs to."""


class TerrainFeatures(nn.Module):
    """The convolutions of examples/sb3_maskable_ppo.py: state matrix float32[b, rows, cols] -> features float32[b, width]."""

    def __init__(self, channels: tuple[int, int], size: tuple[int, int], width: int) -> None:
        super().__init__()
        narrow, wide = channels
        self.cnn = nn.Sequential(
            nn.Conv2d(4, narrow, 3, 2, 1),
            nn.ReLU(),
            nn.Conv2d(narrow, wide, 3, 2, 1),
            nn.ReLU(),
            nn.Flatten(),
        )
        self.linear = nn.Sequential(
            nn.Linear(wide * -(-size[0] // 4) * -(-size[1] // 4), width), nn.ReLU()
        )

    def forward(self, observation: Tensor) -> Tensor:
        codes = (observation * 3.2).round().long().clamp(0, 3)
        features: Tensor = self.linear(
            self.cnn(nn.functional.one_hot(codes, 4).permute(0, 3, 1, 2).float())
        )
        return features


class MlpExtractor(nn.Module):
    """Dense layers for the policy and others for the value, an activation after each."""

    def __init__(
        self, policy_sizes: list[int], value_sizes: list[int], activation: type[nn.Module]
    ) -> None:
        super().__init__()
        self.policy_net, self.value_net = (
            dense(policy_sizes, activation),
            dense(value_sizes, activation),
        )


class ActorCritic(nn.Module):
    """An ActorCriticPolicy of Stable-Baselines3, its modules and so its tensors named as there; shapes as in `tensors`."""

    def __init__(
        self, tensors: dict[str, Tensor], size: tuple[int, int], activation: type[nn.Module]
    ) -> None:
        super().__init__()
        self.features_extractor: nn.Module = nn.Flatten()
        width = size[0] * size[1]
        if "features_extractor.linear.0.weight" in tensors:
            narrow, wide = (
                tensors[f"features_extractor.cnn.{at}.weight"].shape[0] for at in (0, 2)
            )
            width = tensors["features_extractor.linear.0.weight"].shape[0]
            self.features_extractor = TerrainFeatures((narrow, wide), size, width)
        policy_sizes, value_sizes = (
            [width, *widths(tensors, net)] for net in ("policy_net", "value_net")
        )
        self.mlp_extractor = MlpExtractor(policy_sizes, value_sizes, activation)
        self.action_net = nn.Linear(policy_sizes[-1], 4)
        self.value_net = nn.Linear(value_sizes[-1], 1)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits float32[b, 4] and values float32[b] of observations float32[b, rows, cols]."""
        features = self.features_extractor(observation)
        logits = self.action_net(self.mlp_extractor.policy_net(features))
        return logits, self.value_net(self.mlp_extractor.value_net(features)).squeeze(1)


def dense(sizes: list[int], activation: type[nn.Module]) -> nn.Sequential:
    """Return dense layers of these sizes with an activation after each, numbered 0, 2, 4, ... as Stable-Baselines3 does."""
    return nn.Sequential(
        *(
            part
            for inside, out in pairwise(sizes)
            for part in (nn.Linear(inside, out), activation())
        )
    )


def widths(tensors: dict[str, Tensor], net: str) -> list[int]:
    """Return the widths of the dense layers of `policy_net` or `value_net`, first to last."""
    found = {}
    for name, tensor in tensors.items():
        match = re.fullmatch(rf"mlp_extractor\.{net}\.(\d{{1,3}})\.weight", name)
        if match and tensor.ndim == 2:
            found[int(match[1])] = tensor.shape[0]
    return [found[at] for at in sorted(found)]


def load_sb3(path: Path) -> ImportedPolicy:
    """Return the policy in a zip of Stable-Baselines3, named after the file; PolicyFileError for anything else."""
    archive = Archive(path, read_file(path, SB3_ADVICE), SB3_ADVICE)
    description = _description(archive)
    tensors = read_torch_tensors(archive, "policy.pth")
    size, raw = _board(archive, description)
    _check_extractor(archive, description)
    net = _filled(archive, tensors, size, _activation(archive, description))

    def evaluate(
        observation: NDArray[Any], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], float]:
        if torch.get_num_threads() != 1:
            torch.set_num_threads(1)
        with torch.inference_mode():
            logits, value = net(torch.from_numpy(observation.astype(np.float32))[None])
        return logits[0].numpy(), float(value[0])

    masked = "maskable" in str(description.get("policy_class", {}).get("__module__", ""))
    return ImportedPolicy(path.stem, evaluate, size, raw, masked)


def _description(archive: Archive) -> dict[str, Any]:
    """Return the plain text that the zip has about the model: its JSON, where the pickled parts are left as text."""
    try:
        description = json.loads(archive.read("data", LARGEST_TEXT))
    except (ValueError, RecursionError) as error:
        if isinstance(error, PolicyFileError):
            raise
        raise archive.refuse("a file named data that is JSON", "bytes that are none") from error
    if not isinstance(description, dict) or not isinstance(
        description.get("policy_class", {}), dict
    ):
        raise archive.refuse("a description of the model in data", type(description).__name__)
    return description


def _board(archive: Archive, description: dict[str, Any]) -> tuple[tuple[int, int], bool]:
    """Return the size of the board that the model was made for, and whether it saw uint8 codes."""
    space = description.get("observation_space")
    shape, kind = (
        (space.get("_shape"), str(space.get("dtype"))) if isinstance(space, dict) else (None, "")
    )
    if (
        not isinstance(shape, list)
        or len(shape) != 2
        or not all(type(side) is int and 5 <= side <= 1024 for side in shape)
    ):
        raise archive.refuse("observations [rows, cols]", f"the shape {shape}"[:60])
    if kind not in ("float32", "uint8"):
        raise archive.refuse("observations float32 or uint8", kind[:40])
    return (shape[0], shape[1]), kind == "uint8"


def _check_extractor(archive: Archive, description: dict[str, Any]) -> None:
    """Refuse a features extractor that is not Stable-Baselines3's own flattening or TerrainFeatures, by name."""
    given = description.get("policy_kwargs")
    name = (
        str(given.get("features_extractor_class", "FlattenExtractor"))
        if isinstance(given, dict)
        else "FlattenExtractor"
    )
    if re.split(r"[.\s]", name.removesuffix("'>"))[-1] not in (
        "FlattenExtractor",
        "TerrainFeatures",
    ):
        raise archive.refuse(
            "MlpPolicy alone or with TerrainFeatures", f"the features extractor {name}"[:90]
        )


def _activation(archive: Archive, description: dict[str, Any]) -> type[nn.Module]:
    """Return the activation of the dense layers, Tanh when none is named."""
    given = description.get("policy_kwargs")
    name = (
        str(given["activation_fn"])
        if isinstance(given, dict) and "activation_fn" in given
        else "Tanh"
    )
    match = re.fullmatch(r"<class 'torch\.nn\.modules\.activation\.(\w+)'>|(\w+)", name)
    word = (match[1] or match[2]) if match else ""
    if word not in ACTIVATIONS:
        raise archive.refuse(f"an activation among {', '.join(ACTIVATIONS)}", name[:60])
    return ACTIVATIONS[word]


def _filled(
    archive: Archive, tensors: dict[str, Tensor], size: tuple[int, int], activation: type[nn.Module]
) -> ActorCritic:
    """Return the network with the weights in it; weights that are not its own are refused by name."""
    for name in tensors:
        if (owner := OTHERS.get(name.split(".")[0])) is not None:
            raise archive.refuse("an actor-critic policy", f"{owner} ({name})"[:80])
    own = {
        name: tensor
        for name, tensor in tensors.items()
        if not name.startswith(("pi_features_", "vf_features_"))
    }
    missing = next(
        (name for name in ("action_net.weight", "value_net.weight") if name not in own), None
    )
    if missing:
        raise archive.refuse("an actor-critic policy", f"no {missing}")
    seen = {name for name in own if name.startswith("features_extractor.")}
    expected = {
        f"features_extractor.{part}.{kind}"
        for part in ("cnn.0", "cnn.2", "linear.0")
        for kind in ("weight", "bias")
    }
    if seen and seen != expected:
        odd = min(seen ^ expected)
        raise archive.refuse(
            "MlpPolicy alone or with TerrainFeatures",
            f"a features extractor of its own ({odd})"[:90],
        )
    flat = next((name for name, tensor in own.items() if not 1 <= tensor.ndim <= 4), None)
    if flat:
        raise archive.refuse(f"weights in {flat}", f"a tensor of {own[flat].ndim} dimensions")
    with torch.device("meta"):  # shapes alone: nothing is allocated before they are checked
        net = ActorCritic(own, size, activation).eval()
    expected_tensors = net.state_dict()
    if odd_names := set(own) ^ set(expected_tensors):
        raise archive.refuse(
            "the weights of MlpPolicy alone or with TerrainFeatures", f"{min(odd_names)}"[:80]
        )
    for name, tensor in expected_tensors.items():
        if own[name].shape != tensor.shape:
            raise archive.refuse(f"{name} {list(tensor.shape)}", f"{list(own[name].shape)}")
    net.load_state_dict(own, assign=True)
    return net
