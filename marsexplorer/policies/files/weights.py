"""Weights, read so that nothing in a file can run: safetensors of our own networks, and torch files inside zips.

The pickle that names the tensors of a torch file is read as a list of operations first (`pickletools`, which executes nothing);
it may name what tensors are made of and nothing else. Only then torch reads it, with `weights_only=True`.
"""

from __future__ import annotations

import io
import json
import pickletools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from marsexplorer.files import replace_whole
from marsexplorer.policies.files.archive import LARGEST, Archive
from marsexplorer.policies.files.card import read_stored_card, refuse
from marsexplorer.policies.files.formats import NETWORK_FORMAT, current_tensor_names

LARGEST_PICKLE = 1 << 20
TENSOR_PARTS = {
    "torch._utils _rebuild_tensor_v2",
    "torch._utils _rebuild_parameter",
    "torch FloatStorage",
    "collections OrderedDict",
}
"""All that the pickle of a dictionary of float32 tensors names."""

CALLING_OPERATIONS = {
    "STACK_GLOBAL",
    "INST",
    "OBJ",
    "NEWOBJ",
    "NEWOBJ_EX",
    "EXT1",
    "EXT2",
    "EXT4",
    "PERSID",
}
"""Operations that call or fetch what GLOBAL does not name; weights need none."""


def save_network(
    net: nn.Module, path: Path, card: dict[str, Any], file_format: str = NETWORK_FORMAT
) -> None:
    """Write a policy file, whole or not at all: the weights of a network, and its card with the format added."""
    save_tensors(net.state_dict(), path, card, file_format)


def save_tensors(
    tensors: Mapping[str, Tensor], path: Path, card: dict[str, Any], file_format: str
) -> None:
    """Write a policy file, whole or not at all: weights by name, and their card with the format in the place of its own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    own = {name: value for name, value in card.items() if name != "format"}
    stored = {name: tensor.detach().contiguous().cpu() for name, tensor in tensors.items()}
    with replace_whole(path) as unfinished:
        save_file(
            stored,
            unfinished,
            metadata={"card": json.dumps({"format": file_format, **own}, indent=1)},
        )


def read_weights(net: nn.Module, path: Path) -> None:
    """Fill a network with the weights of a policy file; PolicyFileError when they are not exactly its tensors."""
    expected = {name: tuple(tensor.shape) for name, tensor in net.state_dict().items()}
    try:
        with safe_open(path, "pt") as file:
            names = current_tensor_names(read_stored_card(path).get("format"), list(file.keys()))
            if sorted(names.values()) != sorted(expected):
                raise refuse(
                    path, f"the {len(expected)} tensors of the network", f"{len(names)} others"
                )
            tensors = {current: file.get_tensor(stored) for stored, current in names.items()}
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


def read_torch_tensors(archive: Archive, name: str) -> dict[str, Tensor]:
    """Return the float32 tensors in a torch weights file inside an archive, by name; PolicyFileError for anything else."""
    data = archive.read(name)
    inner = Archive(archive.path, data, archive.advice, f"{name}, a zip of torch's,")
    pickles = [one for one in inner.names if one.endswith("data.pkl")]
    if len(pickles) != 1:
        raise archive.refuse(f"{name} with one data.pkl inside", f"{len(pickles)}")
    _check_pickle(inner, pickles[0])
    try:
        loaded: Any = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds for a broken file
        raise archive.refuse(
            f"weights in {name}", f"{type(error).__name__}: {error}".splitlines()[0][:80]
        ) from error
    if not isinstance(loaded, dict):
        raise archive.refuse(f"a dictionary of tensors in {name}", type(loaded).__name__)
    tensors = {}
    for key, tensor in loaded.items():
        if (
            not isinstance(key, str)
            or not isinstance(tensor, Tensor)
            or tensor.dtype != torch.float32
        ):
            raise archive.refuse(
                f"named float32 tensors in {name}", f"{key!r}: {type(tensor).__name__}"[:80]
            )
        if (
            tensor.layout != torch.strided
            or tensor.numel() * 4 > LARGEST
            or not bool(torch.isfinite(tensor).all())
        ):
            raise archive.refuse(f"finite numbers in {key} of {name}", "others")
        tensors[key] = tensor.detach().contiguous()
    return tensors


def _check_pickle(archive: Archive, name: str) -> None:
    """Refuse a pickle that names more than what tensors are made of; nothing of it is executed."""
    try:
        for operation, argument, _ in pickletools.genops(archive.read(name, LARGEST_PICKLE)):
            if operation.name == "GLOBAL" and argument not in TENSOR_PARTS:
                raise archive.refuse(
                    "weights and nothing else",
                    f"a pickle that calls {str(argument).replace(' ', '.')[:60]}",
                )
            if operation.name in CALLING_OPERATIONS:
                raise archive.refuse(
                    "weights and nothing else", f"a pickle with the operation {operation.name}"
                )
    except ValueError as error:
        if type(error) is not ValueError:
            raise
        raise archive.refuse("weights that are whole", "a pickle that breaks off") from error
