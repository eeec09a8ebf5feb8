"""What an environment of others tells: checked numbers, and observations as bytes, packed, and as JSON."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def finite(name: str, given: Any) -> float:
    """Return what an environment told as a number; ValueError for one that neither database nor JSON holds."""
    if not math.isfinite(value := float(given)):
        raise ValueError(f"its {name} is {value}, which is no finite number")
    return value


def two_of(came: object) -> tuple[object, dict[str, object]]:
    """Return what reset returned as observation and info; ValueError for anything else."""
    if isinstance(came, tuple) and len(came) == 2 and isinstance(came[1], dict):
        return came
    raise ValueError(
        f"reset returned {type(came).__name__}: expected (observation, info), as Gymnasium has it"
    )


def reward_of(env_id: str, given: object) -> float:
    """Return a reward as a number; ValueError, with the ways out, for one of several numbers."""
    size = np.asarray(given).size
    if size == 1:
        return float(np.asarray(given).item())
    raise ValueError(
        f"{env_id} pays a reward of {size} numbers, and one is expected: name a wrapper such as "
        "mo_gymnasium.wrappers.LinearReward, with its weights, in a function that makes the environment, and what else "
        'counts by score = "info.NAME"'
    )


def bytes_of(observation: object) -> bytes:
    """Return an observation as bytes that say its type and shape too."""
    if isinstance(observation, Mapping):
        parts = ((str(key).encode(), bytes_of(observation[key])) for key in sorted(observation))
        return b"".join(part for pair in parts for part in pair)
    if isinstance(observation, tuple):
        return b"".join(map(bytes_of, observation))
    if isinstance(observation, str):
        return observation.encode()
    array = _numbers(observation)
    whole = np.ascontiguousarray(array)
    return b"".join((f"{array.dtype.str}{array.shape}".encode(), whole.view(np.uint8).data))


def _numbers(observation: object) -> NDArray[np.generic]:
    """Return a part of an observation as an array; ValueError where it holds Python's own objects."""
    array = np.asarray(observation)
    if array.dtype.hasobject:
        raise ValueError(
            f"its observation holds {type(observation).__name__} of objects: return numbers and texts, and dictionaries "
            "and tuples of them"
        )
    return array


def packed(observation: object) -> bytes:
    """Pack an observation with the types and shapes of its arrays."""
    arrays: list[bytes] = []
    shape = json.dumps(_shape_of(observation, arrays)).encode()
    content = b"".join(arrays)
    return struct.pack(">IQ", len(shape), len(content)) + shape + content


def _shape_of(observation: object, arrays: list[bytes]) -> list[object]:
    """Return what an observation is made of, and add the content of its arrays."""
    if isinstance(observation, Mapping):
        parts = [[str(key), _shape_of(part, arrays)] for key, part in observation.items()]
        return ["dict", parts]
    if isinstance(observation, tuple):
        return ["tuple", [_shape_of(part, arrays) for part in observation]]
    if isinstance(observation, str):
        return ["text", observation]
    array = _numbers(observation)
    arrays.append(array.tobytes())
    return ["array", array.dtype.str, list(array.shape)]


def unpacked(content: bytes) -> Iterator[object]:
    """Yield the observations that were packed one after the other."""
    start = 0
    while start < len(content):
        shape_bytes, array_bytes = struct.unpack_from(">IQ", content, start)
        start += 12
        shape = json.loads(content[start : start + shape_bytes])
        start += shape_bytes
        yield _rebuilt(shape, memoryview(content)[start : start + array_bytes], [0])
        start += array_bytes


def _rebuilt(shape: list[Any], content: memoryview, start: list[int]) -> object:
    """Return the observation of a shape; `start` holds where its next array begins."""
    kind, *rest = shape
    if kind == "dict":
        return {key: _rebuilt(part, content, start) for key, part in rest[0]}
    if kind == "tuple":
        return tuple(_rebuilt(part, content, start) for part in rest[0])
    if kind == "text":
        return str(rest[0])
    dtype, size = np.dtype(rest[0]), tuple(rest[1])
    array = np.frombuffer(content, dtype, math.prod(size), start[0]).reshape(size)
    start[0] += array.nbytes
    return (
        array.copy() if size else array[()]
    )  # a number is one of NumPy's, as environments return them


def plain(observation: object) -> object:
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
