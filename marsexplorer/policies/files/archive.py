"""Zip archives of weights, read so that nothing in them can run, fill the memory or land on the disk.

Nothing is ever extracted: members are read by name into memory, up to a size. The pickle that names the tensors of a weights
file is read as a list of operations first (`pickletools`, which executes nothing); it may name what tensors are made of and
nothing else. Only then torch reads it, with `weights_only=True`.
"""

from __future__ import annotations

import io
import pickletools
import zipfile
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from marsexplorer.policies.files.card import refuse

LARGEST = 64 << 20
"""Bytes of a file, and of everything in it unpacked."""

LARGEST_PICKLE = 1 << 20
MOST_MEMBERS = 1000
TENSOR_PARTS = {
    "torch._utils _rebuild_tensor_v2",
    "torch._utils _rebuild_parameter",
    "torch FloatStorage",
    "collections OrderedDict",
}
"""All that the pickle of a dictionary of float32 tensors names."""

CALLS = {"STACK_GLOBAL", "INST", "OBJ", "NEWOBJ", "NEWOBJ_EX", "EXT1", "EXT2", "EXT4", "PERSID"}
"""Operations that call or fetch what GLOBAL does not name; weights need none."""


class Archive:
    """A zip file whose names and sizes are as they should be; PolicyFileError otherwise."""

    def __init__(self, path: Path, data: bytes, way_out: str, what: str = "a zip file") -> None:
        self.path, self._way_out = path, way_out
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(data))
            members = self._zip.infolist()
        except (zipfile.BadZipFile, ValueError, NotImplementedError, EOFError) as error:
            raise self.refuse(f"{what} that is whole", str(error)[:80] or "none") from error
        if len(members) > MOST_MEMBERS:
            raise self.refuse(f"at most {MOST_MEMBERS} files in {what}", f"{len(members)}")
        for member in members:
            if member.filename.startswith(("/", "\\")) or ".." in Path(member.filename.replace("\\", "/")).parts:
                raise self.refuse("names that stay inside the archive", repr(member.filename)[:60])
        unpacked = sum(member.file_size for member in members)
        if unpacked > LARGEST:
            raise self.refuse(f"{what} of at most {LARGEST >> 20} MiB unpacked", f"{unpacked >> 20} MiB")
        self.names = [member.filename for member in members]

    def refuse(self, expected: str, came: str) -> Exception:
        """Return the error for this file."""
        return refuse(self.path, expected, came, self._way_out)

    def read(self, name: str, most: int = LARGEST) -> bytes:
        """Return a member's bytes; one that is absent, longer than it says, or longer than `most` is refused."""
        if self.names.count(name) != 1:
            raise self.refuse(f"one file {name} inside", f"{self.names.count(name)}")
        try:
            with self._zip.open(name) as member:
                data = member.read(most + 1)
        except (zipfile.BadZipFile, ValueError, NotImplementedError, EOFError, RuntimeError, OSError) as error:
            raise self.refuse(f"{name} whole", f"{type(error).__name__}: {error}"[:80]) from error
        except Exception as error:  # zlib, lzma and bz2 each have an error of their own
            raise self.refuse(f"{name} whole", f"{type(error).__name__}: {error}"[:80]) from error
        if len(data) > most:
            raise self.refuse(f"{name} of at most {most} bytes", "more")
        return data


def read_file(path: Path, way_out: str) -> bytes:
    """Return a policy file's bytes; PolicyFileError when it is too large or cannot be read."""
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise refuse(path, f"a file of at most {LARGEST >> 20} MiB", f"{size >> 20} MiB", way_out)
        return path.read_bytes()
    except OSError as error:
        raise refuse(path, "a file that can be read", f"{type(error).__name__}: {error.strerror}", way_out) from error


def read_tensors(archive: Archive, name: str) -> dict[str, Tensor]:
    """Return the float32 tensors in a torch weights file inside an archive, by name; PolicyFileError for anything else."""
    data = archive.read(name)
    inner = Archive(archive.path, data, archive._way_out, f"{name}, a zip of torch's,")
    pickles = [one for one in inner.names if one.endswith("data.pkl")]
    if len(pickles) != 1:
        raise archive.refuse(f"{name} with one data.pkl inside", f"{len(pickles)}")
    _check_pickle(inner, pickles[0])
    try:
        loaded: Any = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds for a broken file
        raise archive.refuse(f"weights in {name}", f"{type(error).__name__}: {error}".splitlines()[0][:80]) from error
    if not isinstance(loaded, dict):
        raise archive.refuse(f"a dictionary of tensors in {name}", type(loaded).__name__)
    tensors = {}
    for key, tensor in loaded.items():
        if not isinstance(key, str) or not isinstance(tensor, Tensor) or tensor.dtype != torch.float32:
            raise archive.refuse(f"named float32 tensors in {name}", f"{key!r}: {type(tensor).__name__}"[:80])
        if tensor.layout != torch.strided or tensor.numel() * 4 > LARGEST or not bool(torch.isfinite(tensor).all()):
            raise archive.refuse(f"finite numbers in {key} of {name}", "others")
        tensors[key] = tensor.detach().contiguous()
    return tensors


def _check_pickle(archive: Archive, name: str) -> None:
    """Return when a pickle names only what tensors are made of; nothing of it is executed."""
    try:
        for operation, argument, _ in pickletools.genops(archive.read(name, LARGEST_PICKLE)):
            if operation.name == "GLOBAL" and argument not in TENSOR_PARTS:
                raise archive.refuse("weights and nothing else", f"a pickle that calls {str(argument).replace(' ', '.')[:60]}")
            if operation.name in CALLS:
                raise archive.refuse("weights and nothing else", f"a pickle with the operation {operation.name}")
    except ValueError as error:
        if type(error) is not ValueError:
            raise
        raise archive.refuse("weights that are whole", "a pickle that breaks off") from error
