"""Which extra of the package brings which optional library, so that a missing one is named in a sentence.

This module imports nothing that an extra brings: it is what speaks when click itself is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

EXTRAS: dict[str, tuple[str, ...]] = {
    "maps": ("PIL", "yaml"),
    "play": (
        "viser", "PIL", "msgspec", "zstandard", "fastapi", "starlette", "uvicorn", "h11", "websockets", "sqlite_utils",
        "pydantic_settings", "pydantic", "itsdangerous", "limits", "secure", "jinja2", "click", "rich", "scipy",
        "prometheus_client", "pythonjsonlogger", "argon2",
    ),
    "train": ("torch", "tensorboardX", "matplotlib", "click", "rich", "scipy"),
    "study": ("httpx", "matplotlib", "jinja2", "statsmodels"),
    "export": ("pyarrow", "minari", "h5py", "mlcroissant", "cryptography"),
    "onnx": ("onnx", "onnxruntime"),
    "ray": ("ray",),
    "gymnasium": ("pygame",),
    "hub": ("huggingface_hub", "httpx2", "click", "rich"),
    "video": ("av",),
}  # fmt: skip
"""Extra -> the modules that it brings itself, by the names they are imported by."""

INCLUDED: dict[str, tuple[str, ...]] = {
    "play": ("onnx", "maps"),
    "train": ("onnx",),
    "study": ("play",),
    "export": ("study",),
    "ray": ("train",),
    "gymnasium": ("play",),
    "hub": ("onnx",),
    "video": ("play",),
}
"""Extra -> the extras that it includes."""

EXTRA_OF_COMMAND = {
    "serve": "play",
    "export": "play",
    "replay": "play",
    "evaluate": "play",
    "leaderboard": "play",
    "train": "train",
    "refine": "train",
    "sweep": "train",
    "study": "study",
    "simulate": "study",
    "report": "study",
    "regret": "study",
    "policies": "hub",
    "verify": "study",
    "release": "export",
    "reproduce": "export",
    "import": "export",
    "merge": "play",
    "forget": "study",
    "backup": "play",
    "restore": "play",
    "operator": "play",
}
"""Command -> the extra that brings all it needs."""


def missing_extra(error: ModuleNotFoundError, words: Sequence[str]) -> str | None:
    """Return the sentence that names the extra to install, or None when no extra brings the missing module.

    words   the arguments of `marsexplorer`; the first of them that is a command decides between several extras
    """
    module = (error.name or "").split(".")[0]
    extras = [extra for extra in EXTRAS if module in EXTRAS[extra]]
    if not extras:
        return None
    command = next((word for word in words if word in EXTRA_OF_COMMAND), None)
    extra = EXTRA_OF_COMMAND[command] if command else extras[0]
    if module not in _modules(extra):
        extra = extras[0]
    what = f"marsexplorer {command}" if command else "marsexplorer"
    return f"`{what}` needs the extra [{extra}]: pip install 'marsexplorer-playground[{extra}]'"


def _modules(extra: str) -> Iterator[str]:
    """Yield every module that an extra brings, those of the extras that it includes too."""
    yield from EXTRAS[extra]
    for included in INCLUDED.get(extra, ()):
        yield from _modules(included)
