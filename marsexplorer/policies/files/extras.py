"""Say in one sentence which extra is missing when a library that a policy file needs is not installed."""

from __future__ import annotations

from importlib import import_module

from marsexplorer.policies.base import PolicyFileError

LIBRARIES = {"networks": ("torch", "safetensors"), "onnx": ("onnx", "onnxruntime")}
"""Extra of this package -> the libraries that it installs."""


def check_extra(extra: str) -> None:
    """Import the libraries of an extra; PolicyFileError when one is missing, with what to install."""
    for library in LIBRARIES[extra]:
        try:
            import_module(library)
        except ModuleNotFoundError as error:
            raise PolicyFileError(
                f"such policy files need the package {library}, which is not installed; "
                f"pip install 'marsexplorer-playground[{extra}]'"
            ) from error
