"""Which extra of the package brings which optional library.

So a missing library is named in a sentence.
"""

from __future__ import annotations

from collections.abc import Iterator

EXTRAS: dict[str, tuple[str, ...]] = {
    "mars": ("numba", "llvmlite"),
    "play": ("onnxruntime", "viser", "msgspec", "zstandard", "yaml"),
    "onnx": ("onnx", "onnxruntime"),
    "train": ("torch", "tensorboardX", "matplotlib", "huggingface_hub", "httpx2"),
    "study": ("httpx", "matplotlib", "scipy"),
    "export": ("pyarrow", "minari", "h5py", "mlcroissant", "cryptography"),
    "ray": ("ray",),
    "video": ("av",),
    "agents": ("cryptography",),
}
"""Extra -> the modules that it brings itself and a command needs, by the names they are imported by.

If a command names no extra with the missing module, the first one here that brings it is named.
"""

INCLUDED: dict[str, tuple[str, ...]] = {
    "play": ("mars",),
    "train": ("mars", "onnx"),
    "export": ("study",),
    "ray": ("train",),
    "video": ("play",),
    "agents": ("study",),
}
"""Extra -> the extras that it includes."""


def missing_extra(error: ModuleNotFoundError, command: str, extra: str) -> str | None:
    """Name the extra to install; None if no extra brings the missing module.

    Args:
        error: what the import raised.
        command: the command as it was typed, without its arguments.
        extra: the extra that brings all that the command needs; "" if it needs none.
    """
    module = (error.name or "").split(".")[0]
    extras = [name for name in EXTRAS if module in EXTRAS[name]]
    if not extras:
        return None
    wanted = extra if extra and module in _modules(extra) else extras[0]
    return f"`{command}` needs the extra [{wanted}]: pip install 'humanplay[{wanted}]'"


def _modules(extra: str) -> Iterator[str]:
    yield from EXTRAS[extra]
    for included in INCLUDED.get(extra, ()):
        yield from _modules(included)
