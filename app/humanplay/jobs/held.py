"""Functions that a running program holds and that nobody can import.

A lambda is one, or what a notebook defines. They travel to the processes of that program over its
pipes, as bytes of cloudpickle. No database and no file has them, and none is ever read from one.
"""

from __future__ import annotations

import base64
import hashlib
import pickle
import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import gymnasium

    Creator = Callable[..., gymnasium.Env[object, object]]

SCHEME = "held"
"""What stands before the colon in the id of such an environment, where others have their module."""
_payloads: dict[str, bytes] = {}


def hold(function: Callable[..., object], title: str = "") -> str:
    """Hold a function while this process lives.

    Returns:
        Its name, which begins with its title.
    """
    import cloudpickle  # the confined process of a board needs none

    payload: bytes = cloudpickle.dumps(function)
    title = title or getattr(function, "__name__", "environment")
    words = re.sub(r"[^\w.]+", "-", title).strip("-.")
    name = f"{words[:40] or 'environment'}-{hashlib.sha256(payload).hexdigest()[:8]}"
    _payloads[name] = payload
    return name


def payloads() -> dict[str, str]:
    """The functions that are held, for a process that this one starts."""
    return {name: base64.b64encode(payload).decode() for name, payload in _payloads.items()}


def take(payloads: Mapping[str, str]) -> None:
    """Hold what the process that started this one holds."""
    _payloads.update((name, base64.b64decode(text)) for name, text in payloads.items())


def function_of(name: str) -> Creator:
    """The function of a name; ValueError if no program that runs holds it."""
    if name not in _payloads:
        raise ValueError(
            f"{name}: its function is gone with the program that held it; move it into a module, which is found by its name"
        )
    return _loaded(name)


@cache
def _loaded(name: str) -> Creator:
    function: Creator = pickle.loads(_payloads[name])
    return function
