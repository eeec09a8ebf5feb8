"""What an environment of others tells: checked numbers, and observations as bytes and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def finite(name: str, given: Any) -> float:
    """Return what an environment told as a number; ValueError for one that neither database nor JSON holds."""
    if not math.isfinite(value := float(given)):
        raise ValueError(f"its {name} is {value}, which is no finite number")
    return value


def bytes_of(observation: Any) -> bytes:
    """Return an observation as bytes that say its type and shape too."""
    if isinstance(observation, Mapping):
        parts = ((str(key).encode(), bytes_of(observation[key])) for key in sorted(observation))
        return b"".join(part for pair in parts for part in pair)
    if isinstance(observation, tuple):
        return b"".join(map(bytes_of, observation))
    if isinstance(observation, str):
        return observation.encode()
    array = np.asarray(observation)
    whole = np.ascontiguousarray(array)
    return b"".join((f"{array.dtype.str}{array.shape}".encode(), whole.view(np.uint8).data))


def plain(observation: Any) -> Any:
    """Return an observation as JSON holds it: arrays as nested lists, numbers that are not finite as null."""
    if isinstance(observation, Mapping):
        return {str(key): plain(value) for key, value in observation.items()}
    if isinstance(observation, (tuple, list)):
        return [plain(value) for value in observation]
    if isinstance(observation, str):
        return observation
    values = np.asarray(observation)
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        values = values.astype(object)
        values[~np.isfinite(values.astype(float))] = None
    return values.tolist()
