"""Weights in safetensors files, written whole and read so that nothing in a file can run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn

from marsexplorer.files import replace_whole
from marsexplorer.policies.files.card import FORMAT, refuse


def save_network(net: nn.Module, path: Path, card: dict[str, Any]) -> None:
    """Write a policy file, whole or not at all: the weights of a network, and its card with the format added."""
    path.parent.mkdir(parents=True, exist_ok=True)
    own = {name: value for name, value in card.items() if name != "format"}
    metadata = {"card": json.dumps({"format": FORMAT, **own}, indent=1)}
    tensors = {name: each.detach().contiguous().cpu() for name, each in net.state_dict().items()}
    with replace_whole(path) as unfinished:
        save_file(tensors, unfinished, metadata=metadata)


def read_weights(net: nn.Module, path: Path) -> None:
    """Fill a network with the weights of a policy file; PolicyFileError when they are not exactly its tensors."""
    expected = {name: tuple(tensor.shape) for name, tensor in net.state_dict().items()}
    try:
        with safe_open(path, "pt") as file:
            names = list(file.keys())
            if sorted(names) != sorted(expected):
                raise refuse(
                    path, f"the {len(expected)} tensors of the network", f"{len(names)} others"
                )
            tensors = {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError) as error:
        raise refuse(path, "a whole safetensors file", str(error)[:80]) from error
    for name, tensor in tensors.items():
        if tuple(tensor.shape) != expected[name] or tensor.dtype != torch.float32:
            raise refuse(
                path,
                f"{name} float32{list(expected[name])}",
                f"{tensor.dtype} {list(tensor.shape)}",
            )
        if not bool(torch.isfinite(tensor).all()):
            raise refuse(path, f"finite numbers in {name}", "others")
    net.load_state_dict(tensors)
