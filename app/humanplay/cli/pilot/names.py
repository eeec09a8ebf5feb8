"""By which name other processes import a class or a function."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from types import FunctionType


def importable_name(function: Callable[..., object]) -> str:
    """MODULE:NAME by which other processes import a class or function; empty if none."""
    module = getattr(function, "__module__", None) or "__main__"
    name = getattr(function, "__qualname__", "")
    if (
        module == "__main__"
        or not name.isidentifier()
        or not isinstance(function, type | FunctionType)
    ):
        return ""
    member = getattr(sys.modules.get(module) or import_module(module), name, None)
    return f"{module}:{name}" if member is function else ""
